"""Maps of ROS's map_server: a YAML file that names an image and says how to read it.

The image's lower left corner lies at `origin` (x, y, yaw in radians) and a pixel measures `resolution`. The
probability p of a cell being occupied is (255 - value) / 255, or value / 255 if `negate`, of the mean colour.

- `trinary` (default): occupied above `occupied_thresh`, free below `free_thresh`, else unknown. An alpha
  channel counts as a fourth colour.
- `scale`: the same, but what is not fully opaque is unknown. ROS grades what lies between the thresholds from
  1 to 99; a floor plan has three states, so it is unknown, as AMCL takes it.
- `raw`: the value itself is the percentage, above 100 unknown; `negate` does not matter. Percentages become
  states by map_saver's rule: free up to `free_thresh`, occupied from `occupied_thresh` on, both rounded.

This rule often contradicts the meaning of a map: Nav2's map_saver writes unknown as 205 together with `free_thresh:
0.25`, which makes it free; programs that save an alpha channel make every opaque 205 free; and a picture of these
greys in mode raw has free walls. So maps are read by common greys, with a warning if that differs from the rule.
`map_reading="letter"` applies the rule. `name`, `wall_line`, `eroded_m`, `materials` and `furnishings` are keys of
our own, which map_server ignores. Pixels of a colour that stands for a radio material are walls, however light they
are.

Programs that save maps write unknown as 205 (map_saver), or another grey from 200 to 210; some write 127 or 128.
Retouching, resampling and lossy compression spread such greys a little, and add a few others. Unknown is therefore a
common grey, darker than another common one that is free, with a gap between the two that has hardly any cells.

References: nav2_map_server `map_io.cpp` (up to Jazzy), ROS 1 map_server `image_loader.cpp` and wiki page.
"""

import logging
from pathlib import Path
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
import yaml
from jaxtyping import Bool, Int, UInt8

from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, FloorPlan, MapError, MapReading, ReadingOptions
from robosim.plans.formats.furnishing_file import read_furnishings, write_furnishings
from robosim.plans.formats.plan_image import (
    GREY,
    PlanImage,
    colours_of,
    looked_up,
    read_image,
    three_states,
    write_pgm,
    write_png,
)
from robosim.plans.formats.ros_header import RosHeader, read_header
from robosim.plans.formats.thresholds import Thresholds
from robosim.plans.storey_plans import is_storeys
from robosim.support.files import write_whole
from robosim.support.reading import shown

#: Ranges of greys that may mean unknown, those of map_saver first.
_GREYS = (198, 212), (100, 225)
#: A grey is common from this part of the cells on, and stands out from greys of a quarter of its cells.
_COMMON, _GAP = 0.001, 0.25
#: Part of the cells that is nearly all.
_NEARLY = 0.95
#: With a larger part of the cells between dark ones and unknown, a map has shades rather than three states.
_DARK, _SHADES = 48, 0.25
#: Greys are counted together with those this far from them; those this far below may belong to the same area.
_SPREAD, _AROUND = 2, 16


class UnknownGrey(NamedTuple):
    """A grey that means unknown."""

    grey: int
    """The grey, of 255."""
    cells: Bool[np.ndarray, "h w"]
    """Cells of this grey, of those nearer to it than to free ones, and darker ones."""
    free_thresh: float
    """A `free_thresh` that makes it unknown by map_server's rule."""


def unknown_grey(image: PlanImage, negate: bool) -> UnknownGrey | None:
    """The grey that means unknown, darker than free cells, or lighter if `negate`; None if no grey stands out."""
    level = _levels(image.white)
    counts = _counts(image, level)
    if negate:
        counts, level = counts[::-1], 255 - level
    total = counts.sum()
    near = np.convolve(counts, np.ones(2 * _SPREAD + 1, np.int64), "same")
    for low, high in _GREYS:
        grey = low + int(counts[low : high + 1].argmax())
        rare = grey + np.flatnonzero(near[grey:] <= _GAP * near[grey])
        if not len(rare) or near[grey] <= _COMMON * total:
            continue
        if counts[_DARK : grey - _AROUND].sum() > _SHADES * total:
            continue  # many greys, none of which means a state
        free = rare[0] + int(near[rare[0] :].argmax())
        between = near[grey : free + 1]
        if counts[rare[0] :].sum() <= _COMMON * total or between.min() > _GAP * min(near[grey], near[free]):
            continue
        gap = grey + int(np.median(np.flatnonzero(between == between.min())))
        cells = looked_up(level <= gap, image.light)
        area = (cells & looked_up(level > grey - _AROUND, image.light)).astype(np.uint8)
        if (low, high) != _GREYS[0] and not cv2.erode(area, np.ones((3, 3), np.uint8)).any():
            continue  # lines, as the smooth edges of walls are
        threshold = np.floor(1000 * (255 - grey) / 255) / 1000
        return UnknownGrey(255 - grey if negate else grey, cells, threshold)
    return None


def has_saved_greys(image: PlanImage) -> bool:
    """Whether nearly all cells have greys that map_saver writes in mode trinary, each of them common."""
    counts = _counts(image, _levels(image.white))
    parts = [counts[max(grey - _SPREAD, 0) : grey + _SPREAD + 1].sum() for grey in GREY.astype(int)]
    return bool(sum(parts) > _NEARLY * counts.sum() and min(parts) > _COMMON * counts.sum())


def has_shades_of_alpha(image: PlanImage) -> bool:
    """Whether many cells are neither opaque nor transparent, so that the alpha channel carries information."""
    return image.alpha is not None and bool(np.isin(image.alpha, (0, image.opaque)).mean() < _NEARLY)


def _levels(white: int) -> Int[np.ndarray, " n"]:
    """Grey, of 255, of each sum of colour channels."""
    return np.rint(np.arange(white + 1) * 255 / white).astype(np.int64)


def _counts(image: PlanImage, level: Int[np.ndarray, " n"]) -> Int[np.ndarray, "256"]:
    """Count opaque cells of each grey."""
    light = image.light if image.alpha is None else image.light[~image.see_through]
    return np.bincount(level, np.bincount(light.ravel(), minlength=len(level)), 256).astype(np.int64)


logger = logging.getLogger(__name__)

#: Largest difference of red, green and blue from the colour of a material, since programs round them.
COLOUR_OFF = 4


def read_ros(path: Path, options: ReadingOptions) -> FloorPlan:
    """Floor plan from a map_server YAML file and the image that it names; uses `map_reading`."""
    if is_storeys(path):
        raise MapError(
            f"{shown(path)}: is a building of several storeys, expected one floor plan. Give one of the plans that it "
            "lists; `robosim trace` and `robosim dataset` take the whole building."
        )
    header = read_header(path)
    image = read_image(header.image)
    states, material = occupancy_of(image, header, path, options.map_reading), None
    if header.materials:
        material = _materials_of(image, header, path)
        states[material > 0] = OCCUPIED
        material = material[::-1].copy()
    return FloorPlan(
        occupancy=states[::-1].copy(),
        material=material,
        materials=tuple(header.materials.values()),
        resolution_m=header.resolution_m,
        origin=header.origin,
        name=header.name,
        wall_line=header.wall_line,
        eroded_m=header.eroded_m,
        furnishings=() if header.furnishings is None else read_furnishings(header.furnishings),
    )


def occupancy_of(
    image: PlanImage, header: RosHeader, path: Path, map_reading: MapReading = "common"
) -> UInt8[np.ndarray, "h w"]:
    """States of the pixels, row 0 at the top, by the mode of the header; `path` is for messages."""
    letter = _by_the_letter(image, header)
    raw = header.mode == "raw"
    if map_reading == "letter" or (raw and not has_saved_greys(image)):
        return letter
    states = three_states(image.light, image.white, header.negate and not raw, header.thresholds)
    states[image.see_through] = UNKNOWN
    settle = "To read it by map_server's rule, pass --map-reading letter (map_reading='letter')."
    if raw:
        logger.warning(
            f"{path}: mode is raw, but the greys of {header.image.name} are those of mode trinary, by which it is "
            f"read: black is occupied. Set 'mode: trinary'. {settle}"
        )
    elif (n_changed := np.count_nonzero(states != letter)) > 0:
        shades = has_shades_of_alpha(image)
        here = (
            "It is averaged here too."
            if shades
            else f"It is ignored here, and transparent is unknown. {settle}"
        )
        logger.warning(
            f"{path}: the alpha channel of {header.image.name} changes the state of {n_changed} cells by map_server's "
            f"rule, which averages it with the colours in mode trinary. {here} Remove it, or set 'mode: scale', by "
            "which transparent is unknown."
        )
        states = letter if shades else states
    unknown_level = unknown_grey(image, header.negate and not raw)
    if unknown_level is not None:
        unknown = unknown_level.cells & (states == FREE)
        if unknown.any():
            logger.warning(
                f"{path}: {np.count_nonzero(unknown)} cells around grey {unknown_level.grey} are read as unknown, "
                f"since that grey is common, though free_thresh {header.thresholds.free:g} makes them free. Set "
                f"'free_thresh: {unknown_level.free_thresh:.3f}' to settle it. {settle}"
            )
            states[unknown] = UNKNOWN
    return states


def _by_the_letter(image: PlanImage, header: RosHeader) -> UInt8[np.ndarray, "h w"]:
    """States of the pixels by map_server's rule."""
    if header.mode == "raw":
        percent = np.floor(np.arange(image.white + 1) * 255 / image.white + 0.5)
        return looked_up(header.thresholds.raw_states(percent), image.light)
    if header.mode == "trinary" and image.alpha is not None:
        share = 3 * image.opaque // image.white  # a grey channel stands for three
        light = share * image.light.astype(np.uint32) + image.alpha
        return three_states(light, 4 * image.opaque, header.negate, header.thresholds)
    states = three_states(image.light, image.white, header.negate, header.thresholds)
    if header.mode == "scale":
        states[image.see_through] = UNKNOWN
    return states


def _materials_of(image: PlanImage, header: RosHeader, path: Path) -> UInt8[np.ndarray, "h w"]:
    """Number, from 1 on, of the material that each pixel's colour stands for; 0 for none."""
    if image.colour is None:
        raise MapError(
            f"{path}: materials names colours, but {header.image.name} is grey. Save the picture in colour, as PNG."
        )
    materials = np.zeros(image.light.shape, np.uint8)
    for number, colour in enumerate(header.materials, 1):
        near = (np.abs(image.colour.astype(np.int16) - colour) <= COLOUR_OFF).all(axis=-1)
        materials[near] = number
        if not near.any():
            logger.warning(
                "%s: materials names #%02x%02x%02x, which no pixel of the picture has.", path, *colour
            )
    return materials


def write_ros(plan: FloorPlan, path: str | Path, *, image: Literal["pgm", "png"] = "pgm") -> None:
    """Write a plan as map_server YAML, and its image in the same folder under the same name.

    Reading gives a bit-identical plan. Each of the two files appears whole or not at all, the image first. Furnishings
    go into a third one, NAME-furnishings.yaml.

    Args:
        plan: What to write.
        path: The YAML file; its folder is created if it is missing.
        image: Format of the image: P5 graymap or PNG; a plan with materials of walls is always written as PNG.
    """
    path = Path(path)
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise ValueError(
            f"path is {str(path)!r}, expected a name that ends in .yaml, for example {plan.name}.yaml."
        )
    if image not in ("pgm", "png"):
        raise ValueError(f"image is {image!r}, expected 'pgm' or 'png'.")
    if plan.material is not None:
        image = "png"
    image_path = path.with_name(f"{path.stem}.{image}")
    (write_pgm if image == "pgm" else write_png)(plan, image_path)
    keys: dict[str, Any] = {
        "image": image_path.name,
        "mode": "trinary",
        "resolution": float(plan.resolution_m),
        "origin": [float(value) for value in plan.origin],
        "negate": 0,
        "occupied_thresh": Thresholds().occupied,
        "free_thresh": Thresholds().free,
    }
    if plan.name != path.stem:
        keys["name"] = plan.name
    if plan.wall_line != "cell_edge":
        keys["wall_line"] = plan.wall_line
    if plan.eroded_m != 0:
        keys["eroded_m"] = float(plan.eroded_m)
    if plan.material is not None:
        colours = colours_of(len(plan.materials))
        keys["materials"] = {
            "#" + bytes(colour).hex(): str(Path(name).resolve())
            if Path(name).suffix in (".yaml", ".yml")
            else name
            for colour, name in zip(colours, plan.materials, strict=True)
        }
    if plan.furnishings:
        keys["furnishings"] = write_furnishings(
            plan.furnishings, path.with_name(f"{path.stem}-furnishings.yaml")
        ).name
    text = yaml.safe_dump(keys, sort_keys=False, default_flow_style=None, width=1_000_000)
    write_whole(path, text.encode("utf-8"))
