"""Portable graymaps, the images that ROS maps come with: P2 (decimal text) and P5 (bytes).

A header gives width, height and the value of white, with comments from `#` to the end of the line
anywhere between them. Samples of P5 take one byte, or two (the high one first) where white is above 255.
Values above white count as white, and bytes after the last sample are ignored, as other readers do.
Left out: several images in one file.

Reference: Netpbm, "pgm format specification" (2016).
"""

import re

import numpy as np
from jaxtyping import UInt8, UInt16

from robosim.plans.floorplan import MAX_CELLS

_BLANK = rb"(?:\s|#[^\r\n]*[\r\n])+"
_HEADER = re.compile(rb"P([25])" + 3 * (_BLANK + rb"(\d{1,9})") + rb"(?:\s|(?=#))")
#: Bytes of a header with its comments.
_MOST_HEADER = 100_000
_COMMENT = re.compile(rb"#[^\r\n]*")
_BETWEEN = re.compile(rb"\s+")
#: Bytes of decimal numbers that are parsed at once.
_PIECE = 4_000_000


def is_pgm(content: bytes) -> bool:
    """Whether bytes start like a portable graymap."""
    return content[:2] in (b"P2", b"P5")


def decode_pgm(content: bytes) -> tuple[UInt8[np.ndarray, "h w"] | UInt16[np.ndarray, "h w"], int]:
    """Samples of a portable graymap, row 0 at the top, and the value of white.

    Raises:
        ValueError: If the header is not one, the image is absurdly large, or samples are missing.
    """
    header = _HEADER.match(content[:_MOST_HEADER])
    if header is None:
        raise ValueError(f"it starts with {content[:24]!r}, expected a PGM header such as 'P5 200 100 255'")
    plain = header[1] == b"2"
    width, height, white = (int(number) for number in header.groups()[1:])
    if not (width and height and width * height <= MAX_CELLS):
        raise ValueError(
            f"the header says {width} x {height} pixels, expected 1 to {MAX_CELLS:.2g} in all; crop or downsample it"
        )
    if not 1 <= white <= 65535:
        raise ValueError(f"the header says {white} for white, expected 1 to 65535")
    read = _plain_samples if plain else _raw_samples
    samples = read(memoryview(content)[header.end() :], width * height, white)
    if len(samples) < width * height:
        raise ValueError(f"cut off after {len(samples)} samples, but the header says {width} x {height}")
    kind = np.uint8 if white < 256 else np.uint16
    return np.minimum(samples, white).astype(kind, copy=False).reshape(height, width), white


def _plain_samples(raster: memoryview, count: int, white: int) -> np.ndarray:
    text = _COMMENT.sub(b"", raster)
    strange = text.translate(None, b"0123456789 \t\r\n\v\f")
    if strange:
        raise ValueError(f"{strange[:1]!r} among the samples, expected decimal numbers only")
    # In pieces that end between numbers, since parsing takes four times the memory.
    parts, start, found = [np.empty(0, np.uint16)], 0, 0
    while start < len(text) and found < count:
        blank = _BETWEEN.search(text, start + _PIECE)
        stop = blank.end() if blank else len(text)
        if piece := text[start:stop].strip():
            numbers = np.fromstring(piece.decode("ascii"), np.float64, sep=" ")
            parts.append(np.minimum(numbers, white).astype(np.uint16))
            found += len(numbers)
        start = stop
    return np.concatenate(parts)[:count]


def _raw_samples(raster: memoryview, count: int, white: int) -> np.ndarray:
    kind = np.dtype(np.uint8 if white < 256 else ">u2")
    available = min(count, len(raster) // kind.itemsize)
    return np.frombuffer(raster, kind, count=available)


def encode_pgm(samples: UInt8[np.ndarray, "h w"]) -> bytes:
    """A P5 file of 8-bit samples, row 0 at the top."""
    height, width = samples.shape
    return b"P5\n%d %d\n255\n" % (width, height) + np.ascontiguousarray(samples).tobytes()
