"""The grey of a ROS map that means unknown, by how often greys occur.

Programs that save maps write unknown as 205 (map_saver), or another grey from 200 to 210; some write 127 or 128.
Retouching, resampling and lossy compression spread such greys a little, and add a few others. Unknown is therefore a
common grey, darker than another common one that is free, with a gap between the two that has hardly any cells.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Int

from robosim.plans.formats.plan_image import GREY, PlanImage, looked_up

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
    """How many opaque cells have each grey."""
    light = image.light if image.alpha is None else image.light[~image.see_through]
    return np.bincount(level, np.bincount(light.ravel(), minlength=len(level)), 256).astype(np.int64)
