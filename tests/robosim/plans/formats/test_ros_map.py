"""ROS maps: map_server's rules for every pixel, by its documentation; unusual greys of unknown cells; round trips."""

import logging
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from robosim.commands.shared_options import PlanOptions, read
from robosim.plans.files import read_plan, write_ros
from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, FloorPlan, MapError
from robosim.plans.formats.ros_header import read_header

HEADER = {
    "image": "map.png",
    "resolution": 0.05,
    "origin": [0.0, 0.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}


def write_map(folder, pixels, **keys):
    """A map of one image, whose last row gets a white and a black pixel so that something is always free."""
    Image.fromarray(pixels).save(folder / "map.png")
    path = folder / "map.yaml"
    path.write_text(yaml.safe_dump({**HEADER, **keys}))
    return path


def documented_state(pixel, mode, negate, free_thresh, occupied_thresh):
    """State of one pixel (r, g, b, a) in 0..255, after map_server's documentation, in fractions."""
    r, g, b, a = (Fraction(int(v), 255) for v in pixel)
    free_at, occupied_at = Fraction(str(free_thresh)), Fraction(str(occupied_thresh))
    if mode == "raw":
        percent = int((r + g + b) / 3 * 255 + Fraction(1, 2))
        if percent > 100:
            return UNKNOWN
        if percent <= round(100 * free_thresh):
            return FREE
        return OCCUPIED if percent >= round(100 * occupied_thresh) else UNKNOWN
    if mode == "scale" and a < 1:
        return UNKNOWN
    light = (r + g + b + a) / 4 if mode == "trinary" else (r + g + b) / 3
    p = light if negate else 1 - light
    if p > occupied_at:
        return OCCUPIED
    return FREE if p < free_at else UNKNOWN


@pytest.mark.parametrize("thresholds", [(0.196, 0.65), (0.25, 0.65), (0.1, 0.9), (0.5, 0.5), (0.2, 0.2)])
@pytest.mark.parametrize("negate", [0, 1])
@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_each_pixel_follows_the_documented_rule(tmp_path, mode, negate, thresholds):
    """Every cell of a random RGBA image has the state that the documented formulas give in exact fractions."""
    rng = np.random.default_rng(1)
    pixels = rng.integers(0, 256, (24, 40, 4)).astype(np.uint8)
    pixels[:12, :, :3] = pixels[:12, :, :1]  # half of it grey
    pixels[:, ::2, 3] = 255  # every other column opaque
    pixels[0, 0] = 255 if not negate else (0, 0, 0, 255)
    pixels[1, :, :] = [204, 204, 204, 255] if not negate else [51, 51, 51, 255]
    if mode == "raw" or (mode == "trinary" and negate):
        pixels[0, 1:8] = 0
    free_thresh, occupied_thresh = thresholds
    path = write_map(
        tmp_path, pixels, mode=mode, negate=negate, free_thresh=free_thresh, occupied_thresh=occupied_thresh
    )
    got = read_plan(path).occupancy[::-1]
    expected = [[documented_state(pixel, mode, negate, *thresholds) for pixel in row] for row in pixels]
    np.testing.assert_array_equal(got, expected)


@pytest.mark.parametrize(("free_thresh", "state"), [(0.196, UNKNOWN), (0.1, UNKNOWN), (0.25, FREE)])
def test_grey_205_is_unknown_up_to_the_usual_threshold_by_the_letter(tmp_path, free_thresh, state):
    """1 - 205/255 = 0.19608 is above 0.196 by a hair; 0.25 makes it free."""
    pixels = np.array([[254, 205, 0, 100]], np.uint8)
    path = write_map(tmp_path, pixels, free_thresh=free_thresh)
    assert read_plan(path, map_reading="letter").occupancy[0, 1] == state
    assert read_plan(path).occupancy[0, 1] == UNKNOWN


@pytest.mark.parametrize("channels", [1, 3])
def test_grey_205_of_map_saver_is_unknown_at_any_threshold(tmp_path, caplog, channels):
    """Nav2's map_saver writes 205 for unknown with free_thresh 0.25: by the letter, outdoors is free."""
    grey = np.array([[254, 205, 0]], np.uint8)
    pixels = grey if channels == 1 else np.repeat(grey[..., None], 3, axis=-1)
    path = write_map(tmp_path, pixels, free_thresh=0.25)
    with caplog.at_level(logging.WARNING):
        plan = read_plan(path)
    np.testing.assert_array_equal(plan.occupancy, [[FREE, UNKNOWN, OCCUPIED]])
    assert "205" in caplog.text
    assert str(path) in caplog.text


def test_alpha_that_changes_cells_is_said(tmp_path, caplog):
    """Averaging alpha makes an opaque 205 free by map_server's rule (mean 217.5), which is unexpected."""
    pixels = np.full((2, 2, 4), 255, np.uint8)
    pixels[1, :, :3] = 205
    path = write_map(tmp_path, pixels)
    with caplog.at_level(logging.WARNING):
        plan = read_plan(path)
    assert (plan.occupancy == [[UNKNOWN], [FREE]]).all()
    assert "alpha" in caplog.text
    assert (read_plan(path, map_reading="letter").occupancy == FREE).all()


def test_what_the_top_row_of_the_image_shows_lies_at_the_largest_y(tmp_path):
    """Origin (1, 2), turned by 90 degrees: the lower left pixel's centre lies at (0.95, 2.05)."""
    pixels = np.array([[0, 0, 0], [254, 0, 0]], np.uint8)
    plan = read_plan(write_map(tmp_path, pixels, resolution=0.1, origin=[1.0, 2.0, np.pi / 2]))
    np.testing.assert_array_equal(plan.free, [[True, False, False], [False, False, False]])
    np.testing.assert_allclose(plan.centres(plan.free), [[0.95, 2.05]], atol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "image: map.png\nresolution: 5e-2\norigin: [-1, 2.5, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196",
        "image: 'map.png'\nresolution: '0.05'\norigin: [-1., +2.5]\nnegate: no\n"
        "occupied_thresh: .65\nfree_thresh: .196",
        'image: "map.png"\r\nresolution: 0.05\r\norigin:\r\n- -1\r\n- 2.5\r\n- 0\r\nnegate: false\r\n'
        "occupied_thresh: 0.65\r\nfree_thresh: 0.196\r\nmode: Trinary\r\n",
        "# a map\n---\nimage: ./map.png # here\nresolution: 0.050000\norigin: [-1.0, 2.5, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\nframe_id: map\n",
        "\ufeff{image: map.png, resolution: 0.05, origin: [-1, 2.5, 0], negate: 0, occupied_thresh: 0.65, "
        "free_thresh: 0.196}",
    ],
)
def test_all_spellings_of_yaml_mean_the_same(tmp_path, text):
    """Quoted names and numbers, exponents, block lists, CRLF, byte-order mark, comments, no final newline."""
    Image.fromarray(np.array([[254]], np.uint8)).save(tmp_path / "map.png")
    (tmp_path / "map.yaml").write_text(text, encoding="utf-8", newline="")
    header = read_header(tmp_path / "map.yaml")
    assert header.resolution_m == 0.05
    assert header.origin == (-1.0, 2.5, 0.0)
    assert (header.negate, header.mode, header.thresholds.free) == (False, "trinary", 0.196)
    assert read_plan(tmp_path / "map.yaml").name == "map"


def test_image_path_counts_from_the_yaml_file_or_is_absolute(tmp_path, monkeypatch):
    """The working folder must not matter."""
    (tmp_path / "images").mkdir()
    (tmp_path / "other").mkdir()
    Image.fromarray(np.array([[254, 0]], np.uint8)).save(tmp_path / "images" / "a b.png")
    monkeypatch.chdir(tmp_path / "other")
    for image in ("images/a b.png", str(tmp_path / "images" / "a b.png")):
        (tmp_path / "map.yaml").write_text(yaml.safe_dump({**HEADER, "image": image}))
        assert read_plan("../map.yaml").shape == (1, 2)


BAD_HEADERS = [
    ({"mode": "binary"}, ["mode", "binary", "trinary"]),
    ({"resolution": 0}, ["resolution", "'0'", "positive"]),
    ({"resolution": -0.05}, ["resolution", "-0.05", "positive"]),
    ({"resolution": float("nan")}, ["resolution", "nan", "metres"]),
    ({"resolution": "five"}, ["resolution", "five", "0.05"]),
    ({"resolution": [0.05]}, ["resolution", "metres"]),
    ({"free_thresh": 0.7}, ["free_thresh", "0.7", "swapped"]),
    ({"occupied_thresh": 65}, ["occupied_thresh", "65", "between 0 and 1"]),
    ({"origin": [0.0]}, ["origin", "radians"]),
    ({"origin": [0.0, 0.0, 0.0, 1.0]}, ["origin", "radians"]),
    ({"origin": "here"}, ["origin", "here"]),
    ({"origin": [0.0, float("inf"), 0.0]}, ["origin", "inf"]),
    ({"negate": "perhaps"}, ["negate", "perhaps"]),
    ({"image": ""}, ["image", "name of an image"]),
    ({"image": "mpa.png"}, ["image", "mpa.png", "Did you mean 'map.png'"]),
    ({"image": "/nowhere/map.png"}, ["/nowhere/map.png", "Did you mean 'map.png'", "folder of the YAML"]),
    ({"image": "."}, ["folder"]),
    ({"wall_line": "middle"}, ["wall_line", "middle", "cell_centre"]),
    ({"eroded_m": -1}, ["eroded_m", "-1"]),
    ({"name": "a/b"}, ["a/b", "slashes"]),
]


@pytest.mark.parametrize(
    ("keys", "words"), BAD_HEADERS, ids=lambda v: str(v)[:40] if isinstance(v, dict) else ""
)
def test_bad_values_are_named_with_file_and_fix(tmp_path, keys, words):
    """One MapError in one line, which names the file, the key, the value and what was expected."""
    path = write_map(tmp_path, np.array([[254, 0]], np.uint8), **keys)
    with pytest.raises(MapError) as error:
        read_plan(path)
    for word in [*words, str(path)]:
        assert word in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("key", [*HEADER, "nothing"])
def test_missing_keys_are_named_with_a_line_to_add(tmp_path, key):
    path = write_map(tmp_path, np.array([[254, 0]], np.uint8))
    keys = {k: v for k, v in HEADER.items() if k != key}
    path.write_text(yaml.safe_dump(keys))
    if key == "nothing":
        assert read_plan(path).shape == (1, 2)
        return
    with pytest.raises(MapError, match=f"key '{key}' is missing.*'{key}: "):
        read_plan(path)


@pytest.mark.parametrize(
    "text", ["", "just words", "- a\n- b\n", "a: [", "\x00\x01", "!!python/name:os.system", "42"]
)
def test_what_is_no_mapping_is_said(tmp_path, text):
    path = tmp_path / "map.yaml"
    path.write_text(text)
    with pytest.raises(MapError, match=r"map\.yaml"):
        read_plan(path)


def test_lists_that_unfold_without_end_are_not_written_out(tmp_path):
    """Aliases of aliases: 200 bytes that would make a message of a hundred gigabytes."""
    levels = [f"k{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
    (tmp_path / "map.yaml").write_text("\n".join(["k0: &a0 [x]", *levels, "image: *a11"]))
    with pytest.raises(MapError, match=r"map\.yaml: .*aliases are not supported") as error:
        read_plan(tmp_path / "map.yaml")
    assert len(str(error.value)) < 1000


def test_yaw_of_more_than_a_turn_is_suspected_to_be_degrees(tmp_path, caplog):
    """90 is a legal number of radians, so it is accepted and reported."""
    path = write_map(tmp_path, np.array([[254, 0]], np.uint8), origin=[0.0, 0.0, 90.0])
    with caplog.at_level(logging.WARNING):
        assert read_plan(path).origin == (0.0, 0.0, 90.0)
    assert "degrees" in caplog.text


def random_plan(seed, **keys):
    rng = np.random.default_rng(seed)
    occupancy = rng.integers(0, 3, rng.integers(1, 40, 2)).astype(np.uint8)
    occupancy[0, 0] = FREE
    return FloorPlan(occupancy=occupancy, **keys)


place = st.floats(-1e7, 1e7)
names = st.text(
    st.characters(exclude_categories=["C", "Z"], exclude_characters="/\\"), min_size=1, max_size=20
)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    resolution_m=st.floats(0.001, 10.0),
    origin=st.tuples(place, place, st.floats(-1e3, 1e3)),
    name=names,
    wall_line=st.sampled_from(["cell_edge", "cell_centre"]),
    eroded_m=st.floats(0, 10.0),
    image=st.sampled_from(["pgm", "png"]),
)
def test_a_written_map_reads_back_bit_for_bit(
    tmp_path_factory, seed, resolution_m, origin, name, wall_line, eroded_m, image
):
    """Occupancy, resolution, origin with yaw, name, wall line and margin, for any numbers and names.

    Catches rounding in the text, YAML 1.1's dislike of 1e-05, and names that look like null or a date.
    """
    keys = {"origin": origin, "name": name, "wall_line": wall_line, "eroded_m": eroded_m}
    plan = random_plan(seed, resolution_m=resolution_m, **keys)
    path = tmp_path_factory.mktemp("map") / "map.yaml"
    write_ros(plan, path, image=image)
    again = read_plan(path)
    np.testing.assert_array_equal(again.occupancy, plan.occupancy)
    assert again.resolution_m == resolution_m
    assert {key: getattr(again, key) for key in keys} == keys


def test_written_maps_keep_to_map_servers_keys_where_they_can(tmp_path):
    """A plain plan gives nothing but map_server's own keys; 205, 254 and 0 stand for the three states."""
    plan = FloorPlan(occupancy=np.array([[0, 1, 2]], np.uint8), resolution_m=0.05, name="map")
    write_ros(plan, tmp_path / "deep" / "map.yaml")
    keys = yaml.safe_load((tmp_path / "deep" / "map.yaml").read_text())
    assert set(keys) == {*HEADER, "mode"}
    assert keys["image"] == "map.pgm"
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "deep" / "map.pgm")), [[254, 0, 205]])


@pytest.mark.parametrize("image", ["pgm", "png"])
def test_a_write_that_fails_leaves_the_old_map(tmp_path, monkeypatch, image):
    """The disk fills up halfway: what was there stays readable, and no remains lie about."""
    path = tmp_path / "map.yaml"
    old = random_plan(1, resolution_m=0.05, name="map")
    write_ros(old, path, image=image)

    def half(self, content):
        with open(self, "wb") as file:
            file.write(content[: len(content) // 2])
        raise OSError("no space left on device")

    monkeypatch.setattr(Path, "write_bytes", half)
    with pytest.raises(OSError, match="no space"):
        write_ros(random_plan(2, resolution_m=0.1, name="map"), path, image=image)
    monkeypatch.undo()
    np.testing.assert_array_equal(read_plan(path).occupancy, old.occupancy)
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"map.{image}", "map.yaml"]


def test_wrong_arguments_of_the_writer_are_rejected(tmp_path):
    plan = random_plan(1, resolution_m=0.05)
    with pytest.raises(ValueError, match=r"ends in \.yaml"):
        write_ros(plan, tmp_path / "map.pgm")


def test_maps_of_others_load_export_and_reload_equal(shared, tmp_path):
    """Every real ROS map: shape and states by Pillow, and the same after writing and reading."""
    paths = sorted((shared / "maps" / "ros").glob("*.yaml"))
    assert len(paths) >= 5
    for path in paths:
        plan = read_plan(path)
        grey = np.asarray(Image.open(path.with_suffix(".pgm")))[::-1]
        assert plan.shape == grey.shape
        assert (plan.occupancy[grey >= 254] == FREE).all()
        assert (plan.occupancy[grey == 0] == OCCUPIED).all()
        assert (plan.occupancy[grey == 205] == UNKNOWN).all()
        for image in ("pgm", "png"):
            write_ros(plan, tmp_path / image / path.name, image=image)
            again = read_plan(tmp_path / image / path.name)
            np.testing.assert_array_equal(again.occupancy, plan.occupancy)
            assert (again.resolution_m, again.origin, again.name) == (
                plan.resolution_m,
                plan.origin,
                plan.name,
            )


def greys(unknown=205, free=254, occupied=0):
    """A house of two rooms, scanned from within: what is around it is unknown."""
    pixels = np.full((100, 120), unknown, np.uint8)
    pixels[20:80, 20:100] = occupied
    pixels[22:78, 22:98] = free
    pixels[22:60, 58:60] = occupied
    return pixels


TRUTH = np.where(greys() == 254, FREE, np.where(greys() == 205, UNKNOWN, OCCUPIED))[::-1]
FREE_CELLS = int((TRUTH == FREE).sum())


def read_free(folder, pixels, caplog, **keys):
    """Free cells of a map, and what was said of it."""
    path = write_map(folder, pixels, **{"free_thresh": 0.25, **keys})
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        plan = read_plan(path)
    return plan, caplog.text


def dotted(pixels, grey):
    pixels = pixels.copy()
    pixels[40, 40] = grey
    return pixels


CASES = {
    "one retouched pixel": (dotted(greys(), 120), {}),
    "black is 1": (greys(occupied=1), {}),
    "white is 255": (greys(free=255), {}),
    "a high free_thresh": (greys(), {"free_thresh": 0.6}),
    "scale": (greys(), {"mode": "scale"}),
    "negate": (255 - greys(), {"negate": 1}),
    "negate, retouched": (dotted(255 - greys(), 130), {"negate": 1}),
    "in colour": (np.repeat(greys()[..., None], 3, axis=-1), {}),
    "opaque alpha": (cv2.cvtColor(greys(), cv2.COLOR_GRAY2BGRA), {"free_thresh": 0.196}),
    "unknown 200": (greys(200), {"free_thresh": 0.22}),
    "unknown 208": (greys(208), {"free_thresh": 0.196}),
    "unknown 210": (greys(210), {}),
    "unknown 192": (greys(192), {}),
    "unknown 220": (greys(220), {}),
    "raw": (greys(), {"mode": "raw"}),
}


@pytest.mark.parametrize("case", CASES)
def test_unknown_is_not_free(tmp_path, caplog, case):
    """As many free cells as were drawn, where map_server's rule gives others; a warning names the file and a remedy."""
    pixels, keys = CASES[case]
    plan, said = read_free(tmp_path, pixels, caplog, **keys)
    assert abs(int(plan.free.sum()) - FREE_CELLS) <= 1
    assert "map.yaml" in said and "--map-reading letter" in said
    letter = read_plan(tmp_path / "map.yaml", map_reading="letter")
    assert abs(int(letter.free.sum()) - FREE_CELLS) > 100


@pytest.mark.parametrize("unknown", [127, 128, 150, 205])
def test_nothing_is_said_where_both_agree(tmp_path, caplog, unknown):
    plan, said = read_free(tmp_path, greys(unknown), caplog, free_thresh=0.196)
    np.testing.assert_array_equal(plan.occupancy, TRUTH)
    assert not said


def test_a_map_without_unknown_is_as_it_was(tmp_path, caplog):
    """Greys between black and white of walls that were drawn smoothly are no unknown."""
    smooth = cv2.GaussianBlur(np.where(greys() == 0, 0, 254).astype(np.uint8), (5, 5), 1.0)
    plan, said = read_free(tmp_path, smooth, caplog)
    assert not said
    np.testing.assert_array_equal(
        plan.occupancy, read_plan(tmp_path / "map.yaml", map_reading="letter").occupancy
    )


@pytest.mark.parametrize("quality", [30, 60, 90])
def test_unknown_survives_lossy_compression(tmp_path, caplog, quality):
    """JPEG spreads 205 over some greys: at most 1 % of the free cells differ."""
    ok, content = cv2.imencode(".jpg", greys(), [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert ok
    path = write_map(tmp_path, greys(), free_thresh=0.25, image="map.jpg")
    (tmp_path / "map.jpg").write_bytes(content.tobytes())
    assert (read_plan(path).free != (TRUTH == FREE)).sum() < 0.01 * FREE_CELLS


@settings(max_examples=60, deadline=None)
@given(
    unknown=st.integers(196, 214),
    free=st.integers(240, 255),
    occupied=st.integers(0, 40),
    noise=st.integers(0, 6),
    dots=st.lists(st.integers(0, 255), max_size=5),
    negate=st.booleans(),
    free_thresh=st.floats(0.25, 0.6),
    seed=st.integers(0, 99),
)
def test_whatever_the_greys(
    tmp_path_factory, unknown, free, occupied, noise, dots, negate, free_thresh, seed
):
    """Noise on every grey, a few others, black and white swapped: the cells that were drawn, but for the dots."""
    rng = np.random.default_rng(seed)
    pixels = greys(unknown, free, occupied).astype(int) + rng.integers(-noise, noise + 1, TRUTH.shape)
    for k, grey in enumerate(dots):
        pixels[30 + k, 30] = grey
    pixels = np.clip(pixels, 0, 255).astype(np.uint8)
    path = write_map(
        tmp_path_factory.mktemp("map"),
        255 - pixels if negate else pixels,
        negate=int(negate),
        free_thresh=free_thresh,
    )
    assert (read_plan(path).free != (TRUTH == FREE)).sum() <= len(dots)


def test_transparent_is_unknown(tmp_path, caplog):
    """Transparent black, which map_server treats as walls, and transparent white, which it may treat as free."""
    for colour in (0, 255):
        pixels = cv2.cvtColor(greys(), cv2.COLOR_GRAY2BGRA)
        pixels[greys() == 205] = (colour, colour, colour, 0)
        plan, said = read_free(tmp_path, pixels, caplog, free_thresh=0.3)
        np.testing.assert_array_equal(plan.occupancy, TRUTH)
        assert "alpha" in said


def test_the_option_is_of_ros_maps(tmp_path):
    """On the command line too; for an image there is nothing to choose."""
    path = write_map(tmp_path, greys(), free_thresh=0.25)
    assert read(str(path), PlanOptions(map_reading="letter")).free.sum() > FREE_CELLS
    with pytest.raises(MapError, match="no ROS map"):
        read_plan(tmp_path / "map.png", resolution_m=0.05, map_reading="letter")


def test_the_remedy_settles_it(tmp_path, caplog):
    """With the free_thresh that the warning gives, the map reads the same, and nothing is said."""
    plan, said = read_free(tmp_path, greys(207), caplog)
    value = float(said.split("free_thresh: ")[1].split("'")[0])
    again, silence = read_free(tmp_path, greys(207), caplog, free_thresh=value)
    np.testing.assert_array_equal(plan.occupancy, again.occupancy)
    assert not silence


def test_16_bits_are_counted_as_8(tmp_path):
    Image.fromarray(greys().astype(np.uint16) * 257).save(tmp_path / "deep.png")
    path = write_map(tmp_path, greys(), free_thresh=0.25, image="deep.png")
    np.testing.assert_array_equal(read_plan(path).occupancy, TRUTH)
