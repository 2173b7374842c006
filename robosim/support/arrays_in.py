"""NumPy files from outside, single arrays (`.npy`) and archives of them (`.npz`); images from outside.

The header of an array is compared with the bytes of the file before any memory is allocated, and with the kinds of
numbers, shapes and bounds that the reader expects. No pickles. Only expected arrays of an archive are unpacked.
Images are opened by Pillow: the size that a header declares is checked before anything is unpacked.

For use inside of `robosim.support.reading.reading`, which adds the name of the file to errors.
"""

import io
import math
import os
import struct
import sys
import zipfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import IO, NamedTuple

import numpy as np
from numpy.lib import format as npy
from PIL import Image, UnidentifiedImageError

#: Bytes of all arrays of an archive together, unpacked, unless the reader says otherwise.
MOST_BYTES = 200_000_000
#: Positions and sizes are at most so large [m, and whatever else is of that order].
FAR = 1e7
#: Bytes that the directory of an archive and the header of an array may have.
_MOST_DIRECTORY, _MOST_HEADER = 100_000, 10_000


class Array(NamedTuple):
    """Requirements of an array of a file."""

    kinds: str
    """Kinds of numbers that it may hold, by NumPy's letters and where it matters their bytes: "i u", "u2", "U"."""
    axes: str
    """Its axes as in type annotations, "n 3": numbers, and names that are of one length in all arrays of a file."""
    max_abs: float | None = None
    """Its numbers are finite and at most so large; None for any."""


def read_npz(
    file: IO[bytes],
    expected: Mapping[str, Array],
    *,
    optional: Collection[str] = (),
    most_bytes: int = MOST_BYTES,
) -> dict[str, np.ndarray]:
    """Arrays of an archive that are `expected`, or `optional` and present; others are ignored.

    Raises:
        ValueError: If an array is not as expected, or all together have more than `most_bytes`.
        Exception: Any error of a reader of a damaged archive.
    """
    _check_directory(file)
    arrays: dict[str, np.ndarray] = {}
    sizes: dict[str, int] = {}
    left = most_bytes
    with zipfile.ZipFile(file) as archive:
        for name, array in expected.items():
            member = archive.getinfo(f"{name}.npy") if f"{name}.npy" in archive.NameToInfo else None
            if member is None and name in optional:
                continue
            if member is None:
                raise ValueError(f"the array {name} is missing")
            left -= member.file_size
            if left < 0:
                raise ValueError(f"unpacked it has more than {most_bytes} bytes")
            if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError(f"{name} is not compressed by NumPy's method")
            arrays[name] = checked(parse_npy(archive.read(member), name), array, name, sizes)
    return arrays


def parse_npy(content: bytes, name: str = "the array") -> np.ndarray:
    """The array of an `.npy` file, writable; ValueError if it is damaged, or of objects or records."""
    stream = io.BytesIO(content)
    version = npy.read_magic(stream)
    read_header = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(version)
    if read_header is None:
        raise ValueError(f"{name} is of version {version[0]}.{version[1]} of the format")
    shape, in_columns, kind = read_header(stream, max_header_size=_MOST_HEADER)
    if kind.kind not in "biufU" or kind.subdtype is not None:
        raise ValueError(f"{name} holds {kind}, expected plain numbers or text")
    data = stream.read()
    size, there = math.prod(shape) * kind.itemsize, len(data)
    if min(shape, default=0) < 0 or size > there:
        raise ValueError(f"{name} is declared as {shape} of {kind}, but {there} bytes are there")
    flat = np.empty(0, kind)
    if size:
        flat = np.frombuffer(data, kind, count=math.prod(shape))
    # A copy that may be written to, in the machine's own order of bytes; of truth values whatever is not 0 is true.
    array = flat.view(np.uint8) != 0 if kind.kind == "b" else flat.astype(kind.newbyteorder("="))
    return array.reshape(shape, order="F" if in_columns else "C")


def checked(array: np.ndarray, expected: Array, name: str, sizes: dict[str, int]) -> np.ndarray:
    """The array, if it is as expected; lengths of new named axes are added to `sizes`.

    Raises:
        ValueError: If it is not.
    """
    axes = expected.axes.split()
    kinds = expected.kinds.split()
    # The kind of an empty array means nothing.
    fits = not array.size or array.dtype.kind in kinds or array.dtype.str[1:] in kinds
    if not fits or array.ndim != len(axes):
        raise ValueError(
            f"{name} is {array.dtype} of shape {array.shape}, expected {expected.axes or 'one value'}"
        )
    for axis, length in zip(axes, array.shape, strict=True):
        wanted = int(axis) if axis.isdecimal() else sizes.setdefault(axis, length)
        if length != wanted:
            raise ValueError(f"{name} has shape {array.shape}, expected {expected.axes} with {axis} {wanted}")
    if array.dtype.kind == "U":
        letters = array.reshape(-1).view(np.uint32)
        if letters.size and (letters.max() > 0x10FFFF or ((letters >= 0xD800) & (letters < 0xE000)).any()):
            raise ValueError(f"{name} is no text")
    elif expected.max_abs is not None and array.size:
        # NaN fails every comparison.
        low, high = float(array.min()), float(array.max())
        if not (-expected.max_abs <= low and high <= expected.max_abs):
            raise ValueError(f"{name} goes from {low:g} to {high:g}, expected at most {expected.max_abs:g}")
    return array


def ragged(name: str, arrays: Sequence[np.ndarray], empty: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Arrays of any length as one of a name, and their lengths as `NAME_count`; `empty` is the shape of none."""
    joined = np.concatenate(arrays) if len(arrays) else np.zeros(empty)
    return {name: joined, f"{name}_count": np.array([len(array) for array in arrays], np.int64)}


def parts(arrays: Mapping[str, np.ndarray], name: str) -> list[np.ndarray]:
    """The arrays that `ragged` has joined; ValueError if their lengths do not sum up."""
    joined, lengths = arrays[name], arrays[f"{name}_count"]
    # Each is checked before their sum, which may overflow.
    if len(lengths) and not (lengths.min() >= 0 and lengths.max() <= len(joined) == lengths.sum()):
        raise ValueError(f"the lengths of {name} do not sum up to {len(joined)}")
    return np.split(joined, np.cumsum(lengths)[:-1]) if len(lengths) else []


def _check_directory(file: IO[bytes]) -> None:
    """Reject an archive whose directory alone would fill the memory."""
    file.seek(max(0, file.seek(0, io.SEEK_END) - (1 << 16)))
    tail = file.read()
    at = tail.rfind(b"PK\x05\x06")
    if at < 0 or len(tail) < at + 22:
        raise ValueError("the end of the archive is missing")
    (size,) = struct.unpack_from("<L", tail, at + 12)
    # Archives of more than 4 GB have their directory in another place.
    if size > _MOST_DIRECTORY or tail[:at][-20:-16] == b"PK\x06\x07":
        raise ValueError("its directory is larger than that of arrays")
    file.seek(0)


#: Formats that are read: Pillow knows about forty more, a few of which call other programs.
FORMATS = ("PNG", "PPM", "BMP", "TIFF", "GIF", "JPEG", "WEBP")


@contextmanager
def opened_image(
    content: bytes, most_pixels: int, formats: tuple[str, ...] = FORMATS
) -> Iterator[Image.Image]:
    """An image, loaded, of at most so many pixels.

    Raises:
        ValueError: If it is of another format, or too large.
        Exception: Whatever damaged content makes its decoder raise.
    """
    with silenced():
        try:
            image = Image.open(io.BytesIO(content), formats=formats)
        except UnidentifiedImageError as error:
            raise ValueError(f"of unknown format, expected {', '.join(formats)}") from error
        width, height = image.size
        if not 0 < width * height <= most_pixels:
            raise ValueError(f"{width} x {height} pixels, expected at most {most_pixels:.2g} in all")
        image.load()
    with image:
        yield image


@contextmanager
def silenced() -> Iterator[None]:
    """Suppress standard error, to which decoders in C print what they also return."""
    sys.stderr.flush()
    stderr, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(nowhere)
