"""Images whose headers declare a size: what is too large is rejected before any memory is allocated."""

import io
import struct
import zlib
from itertools import product

import numpy as np
import pytest
from PIL import Image, ImageFile

from robosim.support.images_in import FORMATS, opened_image


def png(width: int, height: int) -> bytes:
    """An image of one row of data, which declares any size."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b"\0"))
        + chunk(b"IEND", b"")
    )


def bmp(width: int, height: int) -> bytes:
    return (
        b"BM"
        + struct.pack("<IHHI", 54, 0, 0, 54)
        + struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, *[0] * 6)
    )


def ppm(width: int, height: int) -> bytes:
    return b"P5 %d %d 255\n" % (width, height) + b"\0" * 9


def gif(width: int, height: int) -> bytes:
    frame = struct.pack("<HHHHB", 0, 0, width, height, 0)
    return b"GIF89a" + struct.pack("<HHBBB", width, height, 0, 0, 0) + b"," + frame + b"\x02\x01\x44\x00;"


def tiff(width: int, height: int) -> bytes:
    entries = {256: width, 257: height, 258: 8, 259: 1, 262: 1, 273: 8, 277: 1, 278: height, 279: 9}
    fields = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in entries.items())
    return b"II*\0" + struct.pack("<IH", 8, len(entries)) + fields + b"\0" * 4


@pytest.mark.parametrize(
    ("declared", "size"), [*product((png, bmp, ppm, gif, tiff), (5_000, 60_000)), (ppm, 2**31 - 1)]
)
def test_a_declared_size_is_bounded_before_anything_is_unpacked(declared, size, monkeypatch):
    """Files of some hundred bytes that need 25 MB to 10 GB; from 0.18 gigapixels on, Pillow rejects them itself."""

    def load(image):
        raise AssertionError("unpacked")

    monkeypatch.setattr(ImageFile.ImageFile, "load", load)
    with (
        pytest.raises((ValueError, Image.DecompressionBombError)) as raised,
        opened_image(declared(size, size), 10_000_000),
    ):
        pass
    expected = (f"{size} x {size} pixels, expected at most 1e+07 in all", "exceeds limit")
    assert any(words in str(raised.value) for words in expected)


def test_no_pixels_are_no_image():
    with pytest.raises((ValueError, OSError)), opened_image(png(0, 5), 100):
        pass


@pytest.mark.parametrize("kind", FORMATS)
def test_an_image_of_the_largest_size_is_read(kind):
    content = io.BytesIO()
    Image.fromarray(np.full((8, 5), 77, np.uint8)).save(content, kind)
    with opened_image(content.getvalue(), 40) as image:
        assert image.size == (5, 8)
    with pytest.raises(ValueError, match="5 x 8 pixels"), opened_image(content.getvalue(), 39):
        pass


def test_a_format_that_calls_another_program_is_not_opened():
    """Pillow hands EPS to Ghostscript."""
    content = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n"
    with pytest.raises(ValueError, match="unknown format, expected PNG"), opened_image(content, 100):
        pass
