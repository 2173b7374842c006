"""Images of floor plans: decoding to exact grey levels, and occupancy from how dark a pixel is.

A pixel is as dark as the mean of its red, green and blue; the darker, the surer it is occupied. Values stay
integers (the sum of the colour channels) until they meet the thresholds, so that 16-bit images keep their
depth and no rounding decides a cell. Decoded are portable graymaps and whatever Pillow reads: PNG of every
kind, BMP, TIFF, GIF, JPEG, WebP. JPEG blurs edges; avoid it.
Left out: colour profiles, orientation tags, all frames but the first.
"""

import io
import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, UInt8, UInt16, UInt32
from PIL import Image, UnidentifiedImageError

from robosim.floorplan import FREE, MAX_CELLS, OCCUPIED, UNKNOWN, FloorPlan, MapError
from robosim.formats.pgm import decode_pgm, encode_pgm, is_pgm
from robosim.formats.plan_bytes import read_plan_bytes
from robosim.support.files import whole_file

#: Grey levels that ROS's map_saver writes for FREE, OCCUPIED and UNKNOWN.
GREY = np.array([254, 0, 205], np.uint8)
#: map_server's usual thresholds of the probability of being occupied. The grey 205 lies just between them.
FREE_THRESH, OCCUPIED_THRESH = 0.196, 0.65


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanImage:
    """Brightness and transparency of each pixel, row 0 at the top."""

    light: UInt32[np.ndarray, "h w"]
    """Sum of the colour channels: 0 is black."""
    white: int
    """The same sum for a white pixel."""
    alpha: UInt16[np.ndarray, "h w"] | None = None
    """How opaque, or None for images without an alpha channel."""
    opaque: int = 255
    """Value of `alpha` for a fully opaque pixel."""

    @property
    def see_through(self) -> Bool[np.ndarray, "h w"]:
        """Pixels that are not fully opaque."""
        if self.alpha is None:
            return np.zeros(self.light.shape, bool)
        return self.alpha < self.opaque


def read_image(path: Path) -> PlanImage:
    """Decode an image of a floor plan.

    Raises:
        MapError: If the file is missing, no image, damaged, or absurdly large by its header (before
            anything is unpacked).
    """
    return decode_image(read_plan_bytes(path, "floor plan image"), str(path))


def decode_image(content: bytes, source: str) -> PlanImage:
    """Decode the bytes of an image; `source` names it in messages. Raises as `read_image` does."""
    if is_pgm(content):
        samples, white = decode_pgm(content, source)
        return PlanImage(light=samples.astype(np.uint32), white=white)
    try:
        with warnings.catch_warnings():
            # Pillow warns of large images by a limit of its own; ours is checked below.
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(content)) as image:
                _check_size(image, source)
                image.load()
                return _levels(image, content)
    except MapError:
        raise
    except Exception as error:  # damaged files make decoders fail in many ways
        unknown = isinstance(error, UnidentifiedImageError)
        reason = "of unknown format" if unknown else " ".join(str(error).split()) or type(error).__name__
        raise MapError(
            f"{source}: not a readable image ({reason[:200]}). "
            "Expected PNG, PGM, BMP, TIFF, GIF, JPEG or WebP: export it again."
        ) from error


def _check_size(image: Image.Image, source: str) -> None:
    width, height = image.size
    if not 0 < width * height <= MAX_CELLS:
        raise MapError(
            f"{source}: {width} x {height} pixels, expected at most {MAX_CELLS:.0e} in all. Downsample it."
        )


def _levels(image: Image.Image, content: bytes) -> PlanImage:
    """Grey levels of a loaded image, whatever its mode."""
    see_through = "transparency" in image.info or image.mode in ("LA", "PA", "La", "RGBa", "RGBA")
    if image.format == "PNG" and image.mode in ("RGB", "RGBA") and content[24] == 16:
        # Pillow keeps 8 of the 16 bits of a colour PNG.
        deep = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        return _from_channels(np.asarray(deep), 65535)
    if image.mode.startswith("I;16"):
        samples = np.asarray(image).astype(np.uint16)
        key = image.info.get("transparency")
        alpha = np.where(samples == key, 0, 65535).astype(np.uint16) if isinstance(key, int) else None
        return PlanImage(light=samples.astype(np.uint32), white=65535, alpha=alpha, opaque=65535)
    if image.mode in ("I", "F"):
        raise ValueError(f"pixels are {'32-bit integers' if image.mode == 'I' else 'floating-point numbers'}")
    if image.mode in ("1", "L") and not see_through:
        return PlanImage(light=np.asarray(image.convert("L")).astype(np.uint32), white=255)
    return _from_channels(np.asarray(image.convert("RGBA" if see_through else "RGB")), 255)


def _from_channels(pixels: np.ndarray, full: int) -> PlanImage:
    """From (h, w, 3 or 4) channels, alpha last."""
    light = pixels[..., :3].sum(axis=-1, dtype=np.uint32)
    alpha = pixels[..., 3].astype(np.uint16) if pixels.shape[-1] == 4 else None
    return PlanImage(light=light, white=3 * full, alpha=alpha, opaque=full)


def three_states(
    light: UInt32[np.ndarray, "h w"], white: int, negate: bool, free_thresh: float, occupied_thresh: float
) -> UInt8[np.ndarray, "h w"]:
    """FREE, OCCUPIED or UNKNOWN by map_server's rule.

    The probability of being occupied is one minus the brightness (the brightness itself if `negate`). Below
    `free_thresh` a cell is free, above `occupied_thresh` occupied, and unknown at both or between.
    """
    level = np.arange(white + 1)
    occupied = (level if negate else white - level) / white
    state = np.full(white + 1, UNKNOWN, np.uint8)
    state[occupied < free_thresh] = FREE
    state[occupied > occupied_thresh] = OCCUPIED
    return state[light]


def read_image_plan(path: Path, resolution_m: float | None) -> FloorPlan:
    """Floor plan from an image alone: light is free, dark occupied, grey and transparent unknown.

    Args:
        path: The image. Its lower left corner becomes the origin of `map`.
        resolution_m: Metres per pixel.

    Raises:
        MapError: If the scale is not given, or the image cannot be read or has no free pixel.
    """
    if resolution_m is None:
        beside = [p for p in (path.with_suffix(".yaml"), path.with_suffix(".yml")) if p.is_file()]
        hint = f"Read {beside[0]} instead, or pass" if beside else "Pass"
        raise MapError(
            f"{path}: an image does not say how large a pixel is. {hint} the resolution, for example 0.05 "
            "for 5 cm (resolution_m=0.05, or --resolution 0.05)."
        )
    image = read_image(path)
    states = three_states(image.light, image.white, False, FREE_THRESH, OCCUPIED_THRESH)
    states[image.see_through] = UNKNOWN
    return FloorPlan(occupancy=states[::-1].copy(), resolution_m=resolution_m, name=path.stem)


def write_png(plan: FloorPlan, path: str | Path) -> None:
    """Write the occupancy as a grey PNG (free 254, occupied 0, unknown 205), whole or not at all.

    Reads back the same by `read_image_plan` with the plan's resolution; origin and names are not kept.
    """
    buffer = io.BytesIO()
    Image.fromarray(GREY[plan.occupancy[::-1]]).save(buffer, "PNG", optimize=True)
    write_whole(Path(path), buffer.getvalue())


def write_pgm(plan: FloorPlan, path: str | Path) -> None:
    """Write the occupancy as a P5 graymap (free 254, occupied 0, unknown 205), whole or not at all."""
    write_whole(Path(path), encode_pgm(GREY[plan.occupancy[::-1]]))


def write_whole(path: Path, content: bytes) -> None:
    """Write bytes to a file that appears whole or not at all; its folder is made if need be."""
    with whole_file(path) as partial:
        partial.write_bytes(content)
