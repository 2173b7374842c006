"""Files of arrays and images whose headers are compared with the content, before any memory is allocated."""

import io
import struct
import tempfile
import zipfile
import zlib
from itertools import product

import numpy as np
import pytest
from PIL import Image, ImageFile

from robosim.support.arrays_in import FORMATS, Array, opened_image, parse_npy, read_npz

EXPECTED = {
    "pose": Array("f", "n 3", 1e6),
    "count": Array("i u", "n"),
    "text": Array("U", "n"),
    "scale": Array("f", ""),
}


def arrays(n=4):
    rng = np.random.default_rng(0)
    return {
        "pose": rng.normal(size=(n, 3)),
        "count": np.arange(n, dtype=np.uint16),
        "text": np.array(["a", "bé", "", "d" * 9][:n]),
        "scale": np.array(2.5, np.float32),
        "other": np.array([object()], object),
    }


def archive(write=np.savez, **changes) -> bytes:
    file = io.BytesIO()
    write(file, **{name: value for name, value in {**arrays(), **changes}.items() if value is not None})
    return file.getvalue()


def unpacked(content: bytes, expected=None, **options):
    """Read from a file, as all are."""
    with tempfile.TemporaryFile() as file:
        file.write(content)
        file.seek(0)
        return read_npz(file, EXPECTED if expected is None else expected, **options)


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def forged(header: str, data: bytes = b"") -> bytes:
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


@pytest.mark.parametrize("write", [np.savez, np.savez_compressed])
def test_what_numpy_writes_is_read_the_same(write):
    """The pickle next to them is not read."""
    found = unpacked(archive(write))
    assert set(found) == set(EXPECTED)
    for name, array in found.items():
        np.testing.assert_array_equal(array, arrays()[name])
        assert array.dtype == arrays()[name].dtype


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", ["?", "<i4", ">i4", "u1", ">f8", "f2", "<U3", ">U3"])
def test_any_order_of_bytes_and_axes_is_read(kind, order):
    array = np.array([[0, 1, 2], [3, 4, 0]]).astype(kind, order=order)
    np.testing.assert_array_equal(parse_npy(npy(array)), array)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"pose": None}, "pose is missing"),
        ({"pose": np.zeros((4, 2))}, r"pose has shape \(4, 2\), expected n 3 with 3 3"),
        ({"pose": np.zeros((5, 3))}, r"count has shape \(4,\), expected n with n 5"),
        ({"pose": np.zeros(4)}, r"pose is float64 of shape \(4,\), expected n 3"),
        ({"pose": np.zeros((4, 3), int)}, "pose is int64"),
        ({"pose": np.full((4, 3), np.nan)}, "pose goes from nan"),
        ({"pose": np.full((4, 3), -1e7)}, "pose goes from -1e[+]07 to -1e[+]07, expected at most 1e[+]06"),
        ({"scale": np.zeros(1)}, "scale is float64 of shape .1,., expected one value"),
        ({"text": np.full(4, 0xD800, np.uint32).view("<U1")}, "text is no text"),
        ({"text": np.full(4, 0xFFFFFFFF, np.uint32).view("<U1")}, "text is no text"),
        ({"count": np.array([None] * 4)}, "count"),
    ],
)
def test_other_arrays_than_expected_are_said(changes, words):
    with pytest.raises(ValueError, match=words):
        unpacked(archive(**changes))


@pytest.mark.parametrize(
    "content",
    [
        forged("{'descr': '<f8', 'fortran_order': False, 'shape': (999999999999999,)}"),
        forged("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}", bytes(8)),
        forged("{'descr': '<f8', 'fortran_order': False, 'shape': (3,)}", bytes(23)),
        forged("{'descr': '|O', 'fortran_order': False, 'shape': (1,)}", b"cos\nsystem\n"),
        forged("{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (1,)}", bytes(8)),
        forged("{'descr': ('<f8', (1000000, 1000000)), 'fortran_order': False, 'shape': (1,)}", bytes(8)),
        forged("{'descr': '<U0', 'fortran_order': False, 'shape': (999999999999,)}"),
        forged("{'descr': '<M8[s]', 'fortran_order': False, 'shape': (1,)}", bytes(8)),
        forged("{'descr': '<f8', 'fortran_order': False, 'shape': " + "(" * 5000),
        forged("__import__('os').system('exit 1')"),
        b"\x93NUMPY\x03\x00" + bytes(100),
        b"\x93NUMPY",
        b"no array",
    ],
)
def test_forged_headers_are_errors_before_memory_is_allocated(content):
    with pytest.raises(Exception):  # noqa: B017 - NumPy's parser of headers raises many kinds
        parse_npy(content)


def test_an_archive_that_unpacks_to_too_much_is_an_error_by_its_directory():
    bomb = io.BytesIO()
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as file:
        for name in ("pose", "count"):
            file.writestr(f"{name}.npy", npy(np.zeros(180_000)))
    with pytest.raises(ValueError, match="unpacked it has more than 2000000 bytes"):
        unpacked(bomb.getvalue(), {name: Array("f", "n") for name in ("pose", "count")}, most_bytes=2_000_000)


def test_other_compressions_are_errors():
    """LZMA would allocate whatever its header says."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_LZMA) as packed:
        packed.writestr("pose.npy", npy(np.zeros((1, 3))))
    with pytest.raises(ValueError, match="not compressed by NumPy's method"):
        unpacked(file.getvalue(), {"pose": Array("f", "n 3")})


def test_a_directory_of_many_files_is_not_read():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as packed:
        for i in range(3000):
            packed.writestr(f"{i}", b"")
    with pytest.raises(ValueError, match="directory"):
        unpacked(file.getvalue(), {})
    with pytest.raises(ValueError, match="end of the archive is missing"):
        unpacked(file.getvalue()[:-30], {})


def test_flipped_bits_are_found():
    content = bytearray(archive(np.savez_compressed))
    content[content.index(b"pose.npy") + 60] ^= 4
    with pytest.raises(Exception):  # noqa: B017 - whichever of the two notices it: deflate or the check sum
        unpacked(bytes(content))


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
