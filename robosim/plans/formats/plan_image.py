"""Images of floor plans: decoding to exact grey levels, and occupancy from how dark a pixel is.

A pixel is as dark as the mean of its red, green and blue; darkness is the probability of being occupied. Values stay
integers (the sum of the colour channels) until they are compared with the thresholds, so that 16-bit images keep
their depth and no rounding decides a cell. Decoded are portable graymaps and all that Pillow reads: PNG of every
kind, BMP, TIFF, GIF, JPEG, WebP. JPEG blurs edges; avoid it. Left out: colour profiles, orientation tags but those of
TIFF, all frames but the first.

Portable graymaps, the images that ROS maps come with, are P2 (decimal text) or P5 (bytes). A header gives width,
height and the value of white, with comments from `#` to the end of the line anywhere between them. Samples of P5 take
one byte, or two (the high one first) where white is above 255. Values above white count as white, and bytes after the
last sample are ignored, as other readers do. Left out: several images in one file.

Reference: Netpbm, "pgm format specification" (2016).
"""

import io
import re
from colorsys import hsv_to_rgb
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Shaped, UInt, UInt8, UInt16
from PIL import Image

from robosim.plans.floorplan import (
    MAX_CELLS,
    UNKNOWN,
    FloorPlan,
    MapError,
    ReadingOptions,
    check_size,
)
from robosim.plans.formats.drawing import without_frame, without_strokes
from robosim.plans.formats.thresholds import Thresholds
from robosim.support.arrays_in import opened_image, silenced
from robosim.support.files import write_whole
from robosim.support.reading import reading

_BLANK = rb"(?:\s|#[^\r\n]*[\r\n])+"
_HEADER = re.compile(rb"P([25])" + 3 * (_BLANK + rb"(\d{1,9})") + rb"(?:#[^\r\n]*)?\s")
#: Bytes of a header with its comments.
_MOST_HEADER = 100_000
_COMMENT = re.compile(rb"#[^\r\n]*")
_BETWEEN = re.compile(rb"\s+")
#: Tag of TIFF: whether 0 is white or black.
_PHOTOMETRIC = 262
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
    parts, start, n_read = [np.empty(0, np.uint16)], 0, 0
    while start < len(text) and n_read < count:
        blank = _BETWEEN.search(text, start + _PIECE)
        stop = blank.end() if blank else len(text)
        if piece := text[start:stop].strip():
            numbers = np.fromstring(piece.decode("ascii"), np.float64, sep=" ")
            parts.append(np.minimum(numbers, white).astype(np.uint16))
            n_read += len(numbers)
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


#: Grey levels that ROS's map_saver writes for FREE, OCCUPIED and UNKNOWN.
GREY = np.array([254, 0, 205], np.uint8)
_WHAT = "a floor plan image (PNG, PGM, BMP, TIFF, GIF, JPEG or WebP)"


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanImage:
    """Brightness and transparency of each pixel, row 0 at the top."""

    light: UInt[np.ndarray, "h w"]
    """Sum of the colour channels: 0 is black."""
    white: int
    """Sum of the colour channels of a white pixel."""
    alpha: UInt16[np.ndarray, "h w"] | None = None
    """Opacity, or None for images without an alpha channel."""
    opaque: int = 255
    """Value of `alpha` for a fully opaque pixel."""
    colour: UInt8[np.ndarray, "h w 3"] | None = None
    """Red, green and blue, or None for grey images."""

    @property
    def see_through(self) -> Bool[np.ndarray, "h w"]:
        """Pixels that are not fully opaque."""
        if self.alpha is None:
            return np.zeros(self.light.shape, bool)
        return self.alpha < self.opaque


def read_image(path: Path) -> PlanImage:
    """Decode an image of a floor plan; MapError if it is none, damaged, or too large by its header."""
    with reading(path, _WHAT, "Export it again.", kind=MapError) as file:
        return decode_image(file.read())


def decode_image(content: bytes) -> PlanImage:
    """Decode the bytes of an image; raises what the decoder does for damaged content."""
    if is_pgm(content):
        samples, white = decode_pgm(content)
        return PlanImage(light=samples, white=white)
    with opened_image(content, MAX_CELLS) as image:
        return _levels(image, content)


def _levels(image: Image.Image, content: bytes) -> PlanImage:
    """Grey levels of a loaded image, whatever its mode."""
    if image.format == "PNG" and image.mode in ("1", "L") and "transparency" in image.info:
        # Pillow spreads samples of few bits over 8, but not the one that is transparent; 11.0 does so with 1 bit, too.
        scale = 255 // (2 ** min(content[24], 8) - 1)
        image.info["transparency"] = min(image.info["transparency"] * scale, 255)
    see_through = "transparency" in image.info or image.mode in ("LA", "PA", "La", "RGBa", "RGBA")
    if image.format == "PNG" and image.mode in ("RGB", "RGBA") and content[24] == 16:
        # Pillow keeps 8 of the 16 bits of a colour PNG.
        with silenced():
            deep = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        if deep is None:
            raise ValueError("its pixels are damaged")
        return _from_channels(np.asarray(deep)[..., [2, 1, 0, *range(3, deep.shape[-1])]], 65535)
    if image.mode.startswith("I;16"):
        samples = np.asarray(image).astype(np.uint16)
        if getattr(image, "tag_v2", {}).get(_PHOTOMETRIC) == 0:  # white is 0, which Pillow leaves as it is
            samples = ~samples
        key = image.info.get("transparency")
        alpha = np.where(samples == key, 0, 65535).astype(np.uint16) if isinstance(key, int) else None
        return PlanImage(light=samples, white=65535, alpha=alpha, opaque=65535)
    if image.mode in ("I", "F"):
        raise ValueError(f"pixels are {'32-bit integers' if image.mode == 'I' else 'floating-point numbers'}")
    if image.mode in ("1", "L") and not see_through:
        return PlanImage(light=np.asarray(image.convert("L")), white=255)
    return _from_channels(np.asarray(image.convert("RGBA" if see_through else "RGB")), 255)


def _from_channels(pixels: np.ndarray, full: int) -> PlanImage:
    """From (h, w, 3 or 4) channels: red, green, blue, alpha."""
    light = np.zeros(pixels.shape[:2], np.uint16 if 3 * full < 1 << 16 else np.uint32)
    for channel in range(3):
        light += pixels[..., channel]
    alpha = pixels[..., 3].astype(np.uint16) if pixels.shape[-1] == 4 else None
    colour = (pixels[..., :3] >> (8 if full > 255 else 0)).astype(np.uint8)
    return PlanImage(light=light, white=3 * full, alpha=alpha, opaque=full, colour=colour)


def three_states(
    light: UInt[np.ndarray, "h w"], white: int, negate: bool, thresholds: Thresholds
) -> UInt8[np.ndarray, "h w"]:
    """States by map_server's rule: the probability is one minus the brightness, or the brightness if `negate`."""
    level = np.arange(white + 1)
    return looked_up(thresholds.states((level if negate else white - level) / white), light)


def looked_up(state: Shaped[np.ndarray, " n"], light: UInt[np.ndarray, "h w"]) -> Shaped[np.ndarray, "h w"]:
    """The state of each pixel by its brightness; a few rows at a time, since NumPy's indices take 8 bytes each."""
    states = np.empty(light.shape, state.dtype)
    rows = max(1, 1_000_000 // light.shape[1])
    for first in range(0, len(light), rows):
        states[first : first + rows] = state[light[first : first + rows]]
    return states


def read_image_plan(path: Path, options: ReadingOptions) -> FloorPlan:
    """Floor plan from an image alone: light is free, dark occupied, grey and transparent unknown.

    The lower left corner of the image becomes the origin of `map`. A frame around the drawing is read as paper
    (`robosim.plans.formats.drawing`). Uses `resolution_m`, `thinnest_wall_m` and `allow_large`.
    """
    if options.resolution_m is None:
        maps = [p for p in (path.with_suffix(".yaml"), path.with_suffix(".yml")) if p.is_file()]
        hint = f"Read {maps[0]} instead, or pass" if maps else "Pass"
        raise MapError(
            f"{path}: an image does not say how large a pixel is. {hint} the resolution, for example 0.05 "
            "for 5 cm (resolution_m=0.05, or --resolution 0.05)."
        )
    image = read_image(path)
    states = three_states(image.light, image.white, False, Thresholds())
    states[image.see_through] = UNKNOWN
    if not options.allow_large:
        check_size(states.shape, options.resolution_m)
    states = without_frame(states, options.resolution_m, path)
    states = without_strokes(states, options.thinnest_wall_m, options.resolution_m, path)
    return FloorPlan(occupancy=states[::-1].copy(), resolution_m=options.resolution_m, name=path.stem)


def write_png(plan: FloorPlan, path: str | Path) -> None:
    """Write the occupancy as a PNG (free 254, occupied 0, unknown 205), whole or not at all.

    It is grey, except for walls with materials, which have the colours of `colours_of`. `read_image_plan` with the
    plan's resolution reads the same occupancy; origin, names and materials are not written.
    """
    buffer, pixels = io.BytesIO(), GREY[plan.occupancy[::-1]]
    if plan.material is not None:
        colours = np.array([(0, 0, 0), *colours_of(len(plan.materials))], np.uint8)
        of_wall = plan.material[::-1]
        pixels = np.where(of_wall[..., None] > 0, colours[of_wall], pixels[..., None])
    Image.fromarray(pixels).save(buffer, "PNG", optimize=True)
    write_whole(Path(path), buffer.getvalue())


def colours_of(count: int) -> list[tuple[int, int, int]]:
    """Colours (red, green, blue) that are dark enough to be walls, and far from each other."""
    hues = (0.62 + 0.618034 * np.arange(count)) % 1.0
    shades = (hsv_to_rgb(hue, 1.0, 0.5 + 0.2 * (i % 2)) for i, hue in enumerate(hues))
    return [(round(150 * r), round(150 * g), round(150 * b)) for r, g, b in shades]


def write_pgm(plan: FloorPlan, path: str | Path) -> None:
    """Write the occupancy as a P5 graymap (free 254, occupied 0, unknown 205), whole or not at all."""
    write_whole(Path(path), encode_pgm(GREY[plan.occupancy[::-1]]))
