"""Portable graymaps, the images that ROS maps come with: P2 (decimal text) and P5 (bytes).

A header gives width, height and the value of white, with comments from `#` to the end of the line
anywhere between them. Samples of P5 take one byte, or two (the high one first) where white is above 255.
Values above white are taken for white, and what follows the last sample is ignored, as other readers do.
Left out: several images in one file.

Reference: Netpbm, "pgm format specification" (2016).
"""

import re

import numpy as np
from jaxtyping import UInt8, UInt16

from robosim.floorplan import MAX_CELLS, MapError

_BLANK = rb"(?:\s|#[^\r\n]*[\r\n])+"
_HEADER = re.compile(rb"P([25])" + 3 * (_BLANK + rb"(\d{1,9})") + rb"(?:\s|(?=#))")
_COMMENT = re.compile(rb"#[^\r\n]*")


def is_pgm(content: bytes) -> bool:
    """Whether bytes start like a portable graymap."""
    return content[:2] in (b"P2", b"P5")


def decode_pgm(content: bytes, source: str) -> tuple[UInt16[np.ndarray, "h w"], int]:
    """Samples of a portable graymap, row 0 at the top, and the value of white.

    Args:
        content: The bytes of the file.
        source: Name of the file, for messages.

    Raises:
        MapError: If the header is not one, the image is absurdly large, or samples are missing.
    """
    header = _HEADER.match(content)
    if header is None:
        raise MapError(
            f"{source}: starts with {content[:24]!r}, expected a PGM header such as 'P5 200 100 255'. "
            "Export the image again."
        )
    plain = header[1] == b"2"
    width, height, white = (int(number) for number in header.groups()[1:])
    if not (width and height and width * height <= MAX_CELLS):
        raise MapError(
            f"{source}: the header says {width} x {height} pixels, expected 1 to {MAX_CELLS:.0e} in all. "
            "Crop or downsample the image, or export it again."
        )
    if not 1 <= white <= 65535:
        raise MapError(
            f"{source}: the header says {white} for white, expected 1 to 65535. Export the image again."
        )
    read = _plain_samples if plain else _raw_samples
    samples = read(content[header.end() :], width * height, white, source)
    if len(samples) < width * height:
        raise MapError(
            f"{source}: cut off after {len(samples)} samples, but the header says {width} x {height}. "
            "Copy or export the image again."
        )
    return np.minimum(samples, white).astype(np.uint16).reshape(height, width), white


def _plain_samples(raster: bytes, count: int, white: int, source: str) -> np.ndarray:
    raster = _COMMENT.sub(b"", raster)
    strange = raster.translate(None, b"0123456789 \t\r\n\v\f")
    if strange:
        raise MapError(
            f"{source}: {strange[:1]!r} among the samples, expected decimal numbers only. Export it again."
        )
    return (
        np.fromstring(raster.decode("ascii"), np.float64, count=-1, sep=" ")[:count]
        if raster.strip()
        else np.empty(0)
    )


def _raw_samples(raster: bytes, count: int, white: int, source: str) -> np.ndarray:
    kind = np.dtype(np.uint8 if white < 256 else ">u2")
    available = min(count, len(raster) // kind.itemsize)
    return np.frombuffer(raster, kind, count=available)


def encode_pgm(samples: UInt8[np.ndarray, "h w"]) -> bytes:
    """A P5 file of 8-bit samples, row 0 at the top."""
    height, width = samples.shape
    return b"P5\n%d %d\n255\n" % (width, height) + np.ascontiguousarray(samples).tobytes()
