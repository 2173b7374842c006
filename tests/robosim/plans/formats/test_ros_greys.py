"""Unknown of ROS maps whose greys are not exactly those of map_saver: against the cells that were drawn."""

import logging

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from robosim.commands.shared_options import PlanOptions, read
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, MapError
from tests.robosim.plans.formats.test_ros_map import write_map


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
