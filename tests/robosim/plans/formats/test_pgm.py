"""Portable graymaps, judged by hand-written files."""

import numpy as np
import pytest
from PIL import Image

from robosim.plans.floorplan import MapError
from robosim.plans.formats.plan_image import encode_pgm, read_image


def plain(samples, white):
    rows = "\n".join(" ".join(str(v) for v in row) for row in samples)
    return f"P2\n{samples.shape[1]} {samples.shape[0]}\n{white}\n{rows}\n".encode()


def raw(samples, white):
    kind = np.uint8 if white < 256 else ">u2"
    return b"P5 %d %d %d\n" % (*samples.shape[::-1], white) + samples.astype(kind).tobytes()


@pytest.mark.parametrize("form", [plain, raw])
@pytest.mark.parametrize("white", [255, 65535])
def test_samples_and_white_are_exact(tmp_path, form, white):
    """Both depths, text or bytes: what was put in comes out, two bytes high first."""
    samples = np.random.default_rng(white).integers(0, white + 1, (7, 5))
    (tmp_path / "map.pgm").write_bytes(form(samples, white))
    image = read_image(tmp_path / "map.pgm")
    np.testing.assert_array_equal(image.light, samples)
    assert image.white == white


def test_samples_are_written(tmp_path):
    samples = np.random.default_rng(0).integers(0, 256, (9, 4)).astype(np.uint8)
    (tmp_path / "map.pgm").write_bytes(encode_pgm(samples))
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "map.pgm")), samples)
    assert encode_pgm(samples) == b"P5\n4 9\n255\n" + samples.tobytes()


@pytest.mark.parametrize(
    "content",
    [
        b"P2 # made by hand\n#\n3 2 # size\n# white:\n9\n0 1 2\n3 4 5",
        b"P2\t3\r\n2\r\n9\r\n0 1 2\r\n3 4 5\r\n",
        b"P2\n3 2\n9\n0 1 2 # first row\n3 4 5 6 7 8\n",
        b"P5 3 2 9\n\x00\x01\x02\x03\x04\x05 and more",
    ],
)
def test_comments_and_blanks_stand_anywhere(tmp_path, content):
    """Comments in the header and among decimal samples, Windows line ends, and something after the end."""
    (tmp_path / "map.pgm").write_bytes(content)
    image = read_image(tmp_path / "map.pgm")
    np.testing.assert_array_equal(image.light, np.rint(np.array([[0, 1, 2], [3, 4, 5]]) * 255 / 9))


@pytest.mark.parametrize(
    "content",
    [
        b"P5 3 2 255\n\x00\x01\x02\x03\x04",
        b"P5 3 1 65535\n\x00\x01\x02\x03\x04",
        b"P5 3 2 9\n\x00\x01\x02\x03\x04",
        b"P2 3 2 255\n0 1 2 3 4",
        b"P2 3 2 255\n",
        b"P2 3 1 255\n0 -1 2",
        b"P2 3 1 255\n0 1.5 2",
        b"P2 3 1 255\n0 256 2",
        b"P5 0 2 255\n",
        b"P5 3 2 0\n123456",
        b"P5 3 2 65536\n123456",
        b"P5 99999 99999 255\n",
        b"P5 3",
        b"P5 three two 255\n",
    ],
)
def test_broken_files_are_rejected(tmp_path, content):
    """In one line with the file's name; an absurd size fails by its header alone."""
    (tmp_path / "map.pgm").write_bytes(content)
    with pytest.raises(MapError) as error:
        read_image(tmp_path / "map.pgm")
    assert "map.pgm" in str(error.value)
    assert "\n" not in str(error.value)
