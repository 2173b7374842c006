"""Parts of a picture of a floor plan that are no walls: text, door arcs, furniture, the edge of the paper.

Strokes differ from walls by their thickness only: where a disk of the thickness of a wall does not fit, they are
dropped (a morphological opening; Serra 1982). The user chooses that thickness, since some plans have walls of a
single line; a warning names the option if a picture has strokes much thinner than its walls.

A frame around a building, to which nothing is attached, is the edge of the paper or of the drawing. It is read as
paper.
"""

import logging
import math
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, UInt8
from scipy import ndimage

from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, FloorPlan, MapError
from robosim.plans.outside import find_outside, grown, hull_of

logger = logging.getLogger(__name__)

#: Thicknesses that are tried for that of most walls [cells].
_THICKNESSES = (2, 3, 4, 6, 8, 12, 16)
#: With a smaller share of dark cells in strokes half as thick as its walls, a picture needs no warning.
_STROKES = 0.02
#: Width of smudged edges of walls [cells].
_SMUDGED = 2
#: Least extent of a frame, and how far it may bend inwards, as parts of the picture.
_SPAN, _BEND = 0.8, 0.01


def without_strokes(
    states: UInt8[np.ndarray, "h w"], thinnest_wall_m: float | None, resolution_m: float, path: Path
) -> UInt8[np.ndarray, "h w"]:
    """States of pixels; strokes thinner than a wall [m] become free. None keeps all, and warns of any."""
    dark = states == OCCUPIED
    if thinnest_wall_m is None:
        _warn_of_strokes(dark, resolution_m, path)
        return states
    cells = math.ceil(thinnest_wall_m / resolution_m - 1e-6)
    walls = _without_blots(dark, _opened(dark, cells), cells)
    if dark.any() and not walls.any():
        raise MapError(
            f"{path}: thinnest wall is {thinnest_wall_m:g} m, and no dark stroke of the picture is that thick. Give a "
            "smaller one (--thinnest-wall), or check the resolution."
        )
    grey = states == UNKNOWN
    remains = grey & (grown(walls, _SMUDGED) | _opened(grey, cells, beyond="constant")) | dark & grown(
        walls, 1
    )
    dropped = dark & ~remains
    logger.warning(
        f"{path}: {dropped.sum() * resolution_m**2:.2f} of {dark.sum() * resolution_m**2:.2f} m2 of dark strokes are "
        f"thinner than {thinnest_wall_m:g} m and are not read as walls."
    )
    return np.where(remains, states, FREE).astype(np.uint8)


def _without_blots(
    dark: Bool[np.ndarray, "h w"], walls: Bool[np.ndarray, "h w"], cells: int
) -> Bool[np.ndarray, "h w"]:
    """Walls without small remains of dropped strokes, such as places where strokes of a letter meet."""
    shape = cv2.connectedComponents(dark.astype(np.uint8), connectivity=8)[1].astype(np.int64)
    count, label, stats, _ = cv2.connectedComponentsWithStats(walls.astype(np.uint8), connectivity=8)
    shape_of = np.zeros(count, np.int64)
    shape_of[label[walls]] = shape[walls]
    area = np.bincount(shape.ravel())
    share = np.bincount(shape[walls], minlength=len(area)) / area
    longest = stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
    return walls & ~((longest < 2 * cells) & (share[shape_of] < 0.5))[label]


def _warn_of_strokes(dark: Bool[np.ndarray, "h w"], resolution_m: float, path: Path) -> None:
    """Warn where a picture has strokes much thinner than most of its walls."""
    area, thickness = int(dark.sum()), 1
    for cells in _THICKNESSES:
        if _opened(dark, cells).sum() < area / 2:
            break
        thickness = cells
    least = thickness // 2 + 1
    thin = area - int(_opened(dark, least).sum()) if least > 1 else 0
    if thin > _STROKES * area:
        logger.warning(
            f"{path}: {thin * resolution_m**2:.2f} m2 of dark strokes, thinner than {least * resolution_m:g} m, are "
            "read as walls. If they are text, door arcs or furniture, drop them by --thinnest-wall "
            f"{least * resolution_m:g}."
        )


def _opened(
    mask: Bool[np.ndarray, "h w"], cells: int, beyond: Literal["edge", "constant"] = "edge"
) -> Bool[np.ndarray, "h w"]:
    """Opening with a disk of a diameter [cells]; beyond the picture a wall continues ("edge"), grey does not."""
    if cells < 2:
        return mask
    offset = np.arange(cells) - (cells - 1) / 2
    disk = (np.hypot(offset, offset[:, None]) < (cells - 1) / 2 + 0.3).astype(np.uint8)
    padded = np.pad(mask, cells, mode=beyond).astype(np.uint8)
    # An even disk has no middle cell: dilation about the opposite one undoes the shift.
    eroded = cv2.erode(padded, disk, anchor=(cells // 2,) * 2)
    return cv2.dilate(eroded, disk, anchor=(cells - 1 - cells // 2,) * 2)[cells:-cells, cells:-cells] > 0


def without_frame(
    states: UInt8[np.ndarray, "h w"], resolution_m: float, path: Path
) -> UInt8[np.ndarray, "h w"]:
    """States of pixels with a frame around the whole drawing made free, like the paper around it."""
    frame = _frame_of(states != FREE)
    if frame is None:
        return states
    paper = np.where(frame, FREE, states).astype(np.uint8)
    if not find_outside(FloorPlan(occupancy=paper, resolution_m=resolution_m)).any():
        return states  # one room, with its own walls around it
    logger.warning(
        f"{path}: a frame of {np.count_nonzero(frame)} pixels, to which nothing is attached, is read as the edge of "
        "the paper. If it is a wall, crop the picture to it and join it to another wall."
    )
    return paper


def _frame_of(blocked: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"] | None:
    """Cells of a straight frame around the other blocked cells; None if there is none."""
    _, label, stats, _ = cv2.connectedComponentsWithStats(blocked.astype(np.uint8), connectivity=8)
    spans = stats[1:, [cv2.CC_STAT_HEIGHT, cv2.CC_STAT_WIDTH]] >= _SPAN * np.array(blocked.shape)
    for number in 1 + np.flatnonzero(spans.all(axis=1)):
        frame = label == number
        parts, _ = ndimage.label(~frame)
        sizes = np.bincount(parts.ravel())
        sizes[np.unique([0, *parts[0], *parts[-1], *parts[:, 0], *parts[:, -1]])] = 0
        inner = parts == sizes.argmax()
        if not inner.any() or inner.sum() < frame.size / 4:
            continue
        hull = np.pad(hull_of(inner), 1).astype(np.uint8)
        depth = cv2.distanceTransform(hull, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
        if depth[frame].max() <= max(2.0, _BEND * max(frame.shape)):
            return frame
    return None
