"""Portable graymaps, judged by Pillow's own reader and by hand-written files."""

import io

import numpy as np
import pytest
from PIL import Image

from robosim.plans.formats.pgm import decode_pgm, encode_pgm


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
