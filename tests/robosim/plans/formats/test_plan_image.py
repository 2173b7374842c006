"""Images of floor plans: the grey levels that were put in; graymaps judged by Pillow and by hand-written files."""

import io
import struct
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from robosim.plans.files import read_plan, write_png
from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, FloorPlan, MapError
from robosim.plans.formats.plan_image import decode_image, decode_pgm, encode_pgm

GREY = np.array([[0, 205, 254], [255, 100, 1]], np.uint8)


def encoded(image, kind="PNG", **options):
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def palette_image(transparent=None):
    image = Image.new("P", (3, 2))
    image.putdata(list(range(6)))
    image.putpalette([int(v) for grey in GREY.ravel() for v in (grey, grey, grey)])
    return encoded(image, **({} if transparent is None else {"transparency": transparent}))


def rgb(grey):
    return np.repeat(grey[..., None], 3, axis=-1)


@pytest.mark.parametrize(
    "content",
    [
        encoded(Image.fromarray(GREY)),
        encoded(Image.fromarray(rgb(GREY))),
        palette_image(),
        encoded(Image.fromarray(GREY), "BMP"),
        encoded(Image.fromarray(GREY), "TIFF"),
        encoded(Image.fromarray(GREY), "GIF"),
        encoded(Image.fromarray(GREY), "PPM"),
        encoded(Image.fromarray(GREY.astype(np.uint16) * 257)),
        cv2.imencode(".png", rgb(GREY).astype(np.uint16) * 257)[1].tobytes(),
    ],
    ids=["grey", "rgb", "palette", "bmp", "tiff", "gif", "pgm", "grey16", "rgb16"],
)
def test_grey_levels_are_exact_in_every_kind(content):
    image = decode_image(content)
    np.testing.assert_array_equal(image.light / image.white, GREY / 255)
    assert not image.see_through.any()


@pytest.mark.parametrize("channels", [1, 3])
def test_sixteen_bits_keep_their_depth(channels):
    """Pillow alone would drop the low byte of colour images; 50000 and 50001 must stay apart."""
    pixels = np.array([[50000, 50001, 65535]], np.uint16)
    pixels = pixels if channels == 1 else rgb(pixels)
    image = decode_image(cv2.imencode(".png", pixels)[1].tobytes())
    np.testing.assert_array_equal(
        image.light.astype(np.int64) * 65535 // image.white, [[50000, 50001, 65535]]
    )


def test_decode_image_inverts_deep_tiff_whose_zero_is_white():
    """PhotometricInterpretation 0 (TIFF 6.0, page 37): Pillow inverts 8 bits, but not 16."""
    image = decode_image(encoded(Image.fromarray(GREY.astype(np.uint16) * 257), "TIFF", tiffinfo={262: 0}))
    np.testing.assert_allclose(image.light / image.white, 1 - GREY / 255, atol=1e-12)


def test_one_bit_images_are_black_and_white():
    image = decode_image(encoded(Image.fromarray(np.array([[True, False]]))))
    np.testing.assert_array_equal(image.light / image.white, [[1.0, 0.0]])


GREY_ALPHA = np.stack([GREY, np.array([[255, 254, 0], [255, 255, 128]], np.uint8)], axis=-1)


@pytest.mark.parametrize(
    "content",
    [
        encoded(Image.fromarray(GREY_ALPHA)),
        encoded(Image.fromarray(np.concatenate([rgb(GREY), GREY_ALPHA[..., 1:]], axis=-1))),
        cv2.imencode(
            ".png", np.concatenate([rgb(GREY), GREY_ALPHA[..., 1:]], axis=-1).astype(np.uint16) * 257
        )[1].tobytes(),
        palette_image(bytes([255, 254, 0, 255, 255, 128])),
    ],
    ids=["grey+alpha", "rgba", "rgba16", "palette"],
)
def test_transparency_is_found_in_every_kind(content):
    image = decode_image(content)
    np.testing.assert_array_equal(image.light / image.white, GREY / 255)
    np.testing.assert_array_equal(image.see_through, GREY_ALPHA[..., 1] < 255)


@pytest.mark.parametrize("grey", [205, 50000])
def test_one_transparent_grey_is_found(grey):
    """PNG may name one grey that is transparent, in 8 and in 16 bits."""
    pixels = np.array([[grey, 0]], np.uint8 if grey < 256 else np.uint16)
    image = decode_image(encoded(Image.fromarray(pixels), transparency=grey))
    np.testing.assert_array_equal(image.see_through, [[True, False]])


def png_of_few_bits(depth, samples, transparent):
    """A grey PNG of one row, one of whose samples is transparent."""

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    bits = "".join(f"{sample:0{depth}b}" for sample in samples)
    row = int(bits, 2).to_bytes(len(bits) // 8, "big")
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", len(samples), 1, depth, 0, 0, 0, 0))
        + chunk(b"tRNS", struct.pack(">H", transparent))
        + chunk(b"IDAT", zlib.compress(b"\0" + row))
        + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize("depth", [1, 2, 4, 8])
def test_decode_image_reads_the_transparent_grey_of_few_bits(depth):
    """The sample of tRNS has the depth of the image (PNG 11.3.2): 1 of 1, 1 of 3, 1 of 15."""
    image = decode_image(png_of_few_bits(depth, [0, 1, 0, 1, 1, 0, 0, 0], 1))
    np.testing.assert_array_equal(image.see_through, [[False, True, False, True, True, False, False, False]])


def test_an_image_alone_needs_its_scale(tmp_path):
    """The message says how, and names the YAML file next to the image."""
    path = tmp_path / "office.png"
    path.write_bytes(encoded(Image.fromarray(GREY)))
    with pytest.raises(MapError, match=r"office\.png.*--resolution 0\.05"):
        read_plan(path)
    (tmp_path / "office.yaml").write_text("image: office.png")
    with pytest.raises(MapError, match=r"Read .*office\.yaml instead"):
        read_plan(path)


def test_an_image_alone_is_light_free_dark_occupied_grey_and_transparent_unknown(tmp_path):
    path = tmp_path / "office.png"
    pixels = np.full((2, 3, 4), 255, np.uint8)
    pixels[0, :, :3] = np.array([0, 205, 254])[:, None]
    pixels[1, 2, 3] = 254
    Image.fromarray(pixels).save(path)
    plan = read_plan(path, resolution_m=0.1)
    np.testing.assert_array_equal(plan.occupancy, [[FREE, FREE, UNKNOWN], [OCCUPIED, UNKNOWN, FREE]])
    assert (plan.resolution_m, plan.origin, plan.name) == (0.1, (0.0, 0.0, 0.0), "office")


def test_a_written_png_reads_back(tmp_path):
    occupancy = np.random.default_rng(3).integers(0, 3, (20, 30)).astype(np.uint8)
    plan = FloorPlan(occupancy=occupancy, resolution_m=0.05)
    write_png(plan, tmp_path / "plan.png")
    np.testing.assert_array_equal(read_plan(tmp_path / "plan.png", resolution_m=0.05).occupancy, occupancy)


def bomb(width, height):
    """A PNG of a few bytes that claims to be enormous."""
    header = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([1, 0, 0, 0, 0])

    def chunk(kind, data):
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    rows = zlib.compress(bytes(1000))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


@pytest.mark.parametrize("content", [bomb(200_000, 200_000), bomb(20_000, 6_000), bomb(2**31 - 1, 2**31 - 1)])
def test_image_bombs_fail_by_their_header(tmp_path, content):
    path = tmp_path / "bomb.png"
    path.write_bytes(content)
    with pytest.raises(MapError, match=r"bomb\.png"):
        read_plan(path, resolution_m=0.05)


@pytest.mark.parametrize("content", [b"", b"not an image", encoded(Image.fromarray(GREY))[:45]])
def test_damaged_images_are_said(tmp_path, content):
    path = tmp_path / "bad.png"
    path.write_bytes(content)
    with pytest.raises(MapError, match=r"bad\.png"):
        read_plan(path, resolution_m=0.05)


def test_images_of_real_numbers_are_rejected(tmp_path):
    """Thresholds of such values would be a guess."""
    Image.fromarray(np.zeros((2, 2), np.float32)).save(tmp_path / "map.tif")
    with pytest.raises(MapError, match="floating-point"):
        read_plan(tmp_path / "map.tif", resolution_m=0.05)


def test_all_black_has_no_free_space(tmp_path):
    path = tmp_path / "black.png"
    Image.fromarray(np.zeros((2, 2), np.uint8)).save(path)
    with pytest.raises(MapError, match=r"black\.png.*no free space.*negate"):
        read_plan(path, resolution_m=0.05)


def plain(samples, white, comment=""):
    rows = "\n".join(" ".join(str(v) for v in row) for row in samples)
    return f"P2{comment}\n{samples.shape[1]}{comment} {samples.shape[0]}\n{white}\n{rows}\n".encode()


def raw(samples, white):
    kind = np.uint8 if white < 256 else ">u2"
    return b"P5 %d %d %d\n" % (*samples.shape[::-1], white) + samples.astype(kind).tobytes()


@pytest.mark.parametrize("form", [plain, raw])
@pytest.mark.parametrize("white", [1, 15, 255, 256, 1000, 65535])
def test_samples_and_white_are_exact(form, white):
    """Any depth, text or bytes: what was put in comes out, two bytes high first."""
    samples = np.random.default_rng(white).integers(0, white + 1, (7, 5))
    got, got_white = decode_pgm(form(samples, white))
    np.testing.assert_array_equal(got, samples)
    assert got_white == white


@pytest.mark.parametrize("form", [plain, raw])
def test_pillow_reads_the_same(form):
    samples = np.random.default_rng(0).integers(0, 256, (9, 4))
    content = form(samples, 255)
    np.testing.assert_array_equal(decode_pgm(content)[0], np.asarray(Image.open(io.BytesIO(content))))


def test_pillow_reads_what_is_written():
    samples = np.random.default_rng(0).integers(0, 256, (9, 4)).astype(np.uint8)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(encode_pgm(samples)))), samples)


@pytest.mark.parametrize(
    "content",
    [
        b"P2 # made by hand\n#\n3 2 # size\n# white:\n9\n0 1 2\n3 4 5",
        b"P2\t3\r\n2\r\n9\r\n0 1 2\r\n3 4 5\r\n",
        b"P2\n3 2\n9\n0 1 2 # first row\n3 4 5 6 7 8\n",
        b"P5 3 2\n9# white\n\x00\x01\x02\x03\x04\x05",
        b"P5 3 2#one byte each\n9\n\x00\x01\x02\x03\x04\x05 and more",
    ],
)
def test_comments_and_blanks_stand_anywhere(content):
    """Comments in the header and among decimal samples, Windows line ends, and something after the end."""
    samples, white = decode_pgm(content)
    np.testing.assert_array_equal(samples, [[0, 1, 2], [3, 4, 5]])
    assert white == 9


def test_values_above_white_are_white():
    np.testing.assert_array_equal(decode_pgm(b"P2 3 1 10 5 10 999999999999")[0], [[5, 10, 10]])


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"P5 3 2 255\n\x00\x01\x02\x03\x04", "cut off after 5"),
        (b"P5 3 1 65535\n\x00\x01\x02\x03\x04", "cut off after 2"),
        (b"P2 3 2 255\n0 1 2 3 4", "cut off after 5"),
        (b"P2 3 2 255\n", "cut off after 0"),
        (b"P2 3 1 255\n0 -1 2", "b'-'"),
        (b"P2 3 1 255\n0 1.5 2", "b'.'"),
        (b"P5 0 2 255\n", "0 x 2"),
        (b"P5 3 2 0\n123456", "0 for white"),
        (b"P5 3 2 65536\n123456", "65536 for white"),
        (b"P5 99999 99999 255\n", "99999 x 99999"),
        (b"P5 3", "header"),
        (b"P5 three two 255\n", "header"),
    ],
)
def test_broken_files_are_said(content, word):
    """An absurd size fails by its header alone, before any memory is allocated."""
    with pytest.raises(ValueError) as error:
        decode_pgm(content)
    assert word in str(error.value)
