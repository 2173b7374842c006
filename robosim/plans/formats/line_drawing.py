"""Walls from the lines and areas of a vector drawing, DXF or SVG.

Walls are the shapes of some layers, windows included; doors and furniture on other layers are left out, so that doors
are openings. Three styles of walls are understood, also mixed:

- areas: hatches, solids, filled shapes, and lines that are drawn wider than a cell;
- double lines: what lines enclose is a wall where no circle of `MOST_THICK_M` fits in, and a room otherwise;
- single lines: all other lines, `ReadingOptions.line_thickness_m` thick or else a cell.

A cell is occupied if its centre is in a wall. Lines whose ends are up to a cell apart enclose walls too. The outside is
unknown, as a closed front door is. Left out: heights, text, dimensions, openings that are drawn over a wall
that passes through.
"""

import logging
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import reduce
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float
from scipy import ndimage

from robosim.plans.floorplan import (
    FREE,
    LARGEST_M,
    OCCUPIED,
    UNKNOWN,
    FloorPlan,
    MapError,
    ReadingOptions,
    grid_size,
)
from robosim.plans.formats.raster import winding_numbers
from robosim.plans.outside import find_outside
from robosim.support.checks import shown

logger = logging.getLogger(__name__)

RESOLUTION_M = 0.05
#: Thickest wall that is drawn by double lines: narrower than a closet [m].
MOST_THICK_M = 0.6
#: Curves become lines that are off by at most this; coordinates are rounded to it before lines are joined [m].
FLAT_M, SNAP_M = 2e-3, 1e-4
#: Ground around the building; a smaller drawing has the wrong unit [m].
MARGIN_M, SMALLEST_M = 0.5, 1.5
#: Walls are moved by this part of a cell, so that one as thick as a cell between two rows of centres is in one of them.
ASIDE = 1e-6
#: More points are not a plan of walls.
MOST_POINTS = 1_000_000
#: Names of layers of walls, and of windows and columns, which stop robots too, in six languages.
WALL_NAME = re.compile(
    r"wall|window|glaz|column|fenster|fenêtre|finestr|ventana|janela"
    r"|(?<![^\W\d_])(cols?|wand|wände|waende|murs?|muri|muros?|pareti?|paredes?|pared)(?![^\W\d_])",
    re.IGNORECASE,
)
_LISTED = 20


class Shape(NamedTuple):
    """Shape of a drawing."""

    names: tuple[str, ...]
    """The layer that it is on; then other names by which it can be chosen."""
    lines: tuple[Float[np.ndarray, "_ 2"], ...]
    """Corners of each of its lines, or of the outlines of its area [m]."""
    is_area: bool = False
    """Whether it is what its outlines enclose."""
    width_m: float = 0.0
    """Width that its lines are drawn with."""
    is_nonzero: bool = False
    """Whether outlines enclose what they wind around in all (nonzero rule), rather than an odd number of times."""
    unread: str = ""
    """Kind of an object that is not read; it has no lines."""


def plan_from_shapes(shapes: Iterable[Shape], path: Path, options: ReadingOptions) -> FloorPlan:
    """The floor plan of a drawing; uses `resolution_m`, `wall_layers`, `line_thickness_m` and `allow_large`.

    Raises:
        MapError: If layers of walls are not known, or the walls have no size of a building.
    """
    resolution_m = options.resolution_m or RESOLUTION_M
    drawn: list[Shape] = []
    points, known = 0, set()
    for shape in shapes:
        # Copies of blocks lie on each other: their lines would cut each other into many pieces.
        rounded = tuple(np.round(line / FLAT_M).tobytes() for line in shape.lines)
        if (key := (shape.names[0], shape.is_area, shape.width_m, rounded)) in known and not shape.unread:
            continue
        known.add(key)
        points += sum(map(len, shape.lines))
        if points > MOST_POINTS:
            raise MapError(f"it has more than {MOST_POINTS} points. Export the layers of walls alone.")
        if not all(np.isfinite(line).all() for line in shape.lines):
            raise MapError("it has coordinates that are NaN or infinite. Export it again.")
        drawn.append(shape)
    on_layers = _on_wall_layers(drawn, options.wall_layers, path)
    chosen = [shape for shape in on_layers if not shape.unread]
    if unread := Counter(shape.unread for shape in on_layers if shape.unread):
        listed = ", ".join(f"{count} {shown(kind)}" for kind, count in unread.most_common(_LISTED))
        remedy = "Explode them into lines in the program that made them, or export the storey as a mesh."
        if not chosen:
            raise MapError(f"its walls are {listed}, which are not read. {remedy}")
        logger.warning(f"{path}: {listed} on the layers of walls are not read. {remedy}")
    extent = shapely.total_bounds([shapely.multipoints(np.vstack(shape.lines)) for shape in chosen])
    _check_extent(np.ptp(extent.reshape(2, 2), axis=0), options.allow_large)
    walls = _walls(chosen, options.line_thickness_m or resolution_m, resolution_m)
    if walls.is_empty:
        raise MapError("its walls have neither length nor area. Check the layers (--wall-layer).")
    lower, upper = np.reshape(walls.bounds, (2, 2))
    margin = np.ceil(MARGIN_M / resolution_m) * resolution_m
    nx, ny = grid_size(lower - margin, upper + margin, resolution_m, "the drawing")
    origin = lower - margin - resolution_m
    rings = [shapely.get_coordinates(ring) for ring in shapely.get_rings(shapely.get_parts(walls))]
    start, end = (
        (np.concatenate(ends) - origin) / resolution_m + ASIDE
        for ends in ([ring[:-1] for ring in rings], [ring[1:] for ring in rings])
    )
    free = winding_numbers(start, end, (ny, nx)) % 2 == 0
    free &= ~_gaps_within_walls(free, resolution_m)
    plan = FloorPlan(
        occupancy=np.where(free, FREE, OCCUPIED).astype(np.uint8),
        resolution_m=resolution_m,
        origin=(float(origin[0]), float(origin[1]), 0.0),
        name=path.stem,
    )
    outside = find_outside(plan)
    cells = round(margin / resolution_m) + 1
    outside[:cells] = outside[-cells:] = outside[:, :cells] = outside[:, -cells:] = True
    connected, _ = ndimage.label(outside)
    states = np.where(connected == connected[0, 0], UNKNOWN, plan.occupancy)
    if not (states == FREE).any():
        raise MapError("its walls leave no floor free. Check the layers (--wall-layer).")
    return replace(plan, occupancy=states.astype(np.uint8))


def _on_wall_layers(drawn: Sequence[Shape], patterns: tuple[str, ...], path: Path) -> list[Shape]:
    """Shapes on the layers of walls: the given ones, or those named so, or the only one."""
    layers = Counter(shape.names[0] for shape in drawn if not shape.unread)
    listed = ", ".join(f"{shown(name)} ({count})" for name, count in layers.most_common(_LISTED))
    if len(layers) > _LISTED:
        listed += f" and {len(layers) - _LISTED} more"
    if not layers:
        raise MapError("it has no lines or areas. Export the walls as lines, polylines or hatches.")
    known = {name: name.lower() for shape in drawn for name in shape.names}
    of = {
        pattern: {name for name in known if fnmatchcase(known[name], pattern.lower())} for pattern in patterns
    }
    wanted = set().union(*of.values()) if patterns else set(filter(WALL_NAME.search, known))
    if len(layers) == 1 and not patterns:
        wanted |= set(layers)
    chosen = [shape for shape in drawn if not wanted.isdisjoint(shape.names)]
    missing = [shown(pattern) for pattern in patterns if not of[pattern]]
    if missing or not chosen:
        raise MapError(
            f"its layers are {listed}, and none is called {' or '.join(missing) or 'wall'}. Name the layer of walls: "
            "--wall-layer NAME, as often as there are some; * stands for any letters."
        )
    names = sorted({shape.names[0] for shape in chosen})
    if not patterns and len(names) > 1:
        logger.warning(
            f"{path}: walls are read from the layers {', '.join(map(shown, names))}. Choose by --wall-layer."
        )
    return chosen


def _check_extent(size_m: Float[np.ndarray, "2"], allow_large: bool) -> None:
    """Raise MapError for walls that have no size of a building."""
    text = f"its walls are {size_m[0]:.3g} x {size_m[1]:.3g} m"
    if not size_m.max() >= SMALLEST_M:
        raise MapError(
            f"{text}, too small for a building. Give the unit of its numbers, such as --unit 0.001."
        )
    if size_m.max() > LARGEST_M and not allow_large:
        raise MapError(
            f"{text}, too large for a building. Give the unit of its numbers, such as --unit 0.001, or confirm it by "
            "--allow-large (allow_large=True)."
        )


def _walls(shapes: Sequence[Shape], thickness_m: float, resolution_m: float) -> shapely.Geometry:
    """The ground that walls stand on."""
    solid, thin = [], []
    for shape in shapes:
        if shape.is_area:
            rings = [shapely.Polygon(ring) for ring in shape.lines if len(ring) >= 3]
            areas = [shapely.make_valid(ring) for ring in rings]
            if shape.is_nonzero and (len(rings) > 1 or not all(map(shapely.is_valid, rings))):
                solid.append(_wound_around(rings, areas))
            else:
                solid.append(reduce(shapely.symmetric_difference, areas, shapely.Polygon()))
            continue
        lines = shapely.multilinestrings([shapely.LineString(line) for line in shape.lines if len(line) >= 2])
        if shape.width_m > resolution_m:
            solid.append(_thickened(lines, shape.width_m))
        else:
            thin.append(lines)
    noded = shapely.union_all(thin, grid_size=SNAP_M)
    faces = shapely.get_parts(shapely.polygonize([noded]))
    double = faces[shapely.is_empty(shapely.buffer(faces, -MOST_THICK_M / 2))]
    enclosed = shapely.union_all(double)
    single = shapely.difference(noded, shapely.buffer(enclosed, SNAP_M))
    return shapely.union_all([*solid, enclosed, _thickened(single, thickness_m)])


def _wound_around(rings: list[shapely.Polygon], areas: list[shapely.Geometry]) -> shapely.Geometry:
    """The area of the nonzero rule, of outlines and what each of them encloses."""
    outlines = shapely.get_exterior_ring(rings)
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all(outlines)]))
    inside = shapely.point_on_surface(faces)
    around, face = shapely.STRtree(inside).query(areas, predicate="contains")
    crosses = ~shapely.is_valid(rings)
    signs = np.where(crosses, 0, np.where(shapely.is_ccw(outlines), 1, -1))
    turns = np.bincount(face, signs[around], len(faces))
    for outline in outlines[crosses]:
        turns += _turns(shapely.get_coordinates(outline), shapely.get_coordinates(inside))
    return shapely.union_all(faces[turns != 0])


def _turns(outline: Float[np.ndarray, "n 2"], points: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, " k"]:
    """How often a closed line, which may cross itself, turns counter-clockwise around points."""
    turns = np.zeros(len(points))
    for (x0, y0), (x1, y1) in pairwise(outline):
        left = (x1 - x0) * (points[:, 1] - y0) - (points[:, 0] - x0) * (y1 - y0)
        turns += (y0 <= points[:, 1]) & (points[:, 1] < y1) & (left > 0)
        turns -= (y1 <= points[:, 1]) & (points[:, 1] < y0) & (left < 0)
    return turns


def _thickened(lines: shapely.Geometry, width_m: float) -> shapely.Geometry:
    """The area of lines of some width, with flat ends and sharp corners."""
    return shapely.buffer(shapely.line_merge(lines), width_m / 2, cap_style="flat", join_style="mitre")


def _gaps_within_walls(free: Bool[np.ndarray, "ny nx"], resolution_m: float) -> Bool[np.ndarray, "ny nx"]:
    """Enclosed cells where nothing as wide as a closet fits in: between double lines that do not quite meet."""
    parts, count = ndimage.label(free)
    reach_m = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * resolution_m
    widest_m = ndimage.maximum(reach_m, parts, np.arange(count + 1))
    return (widest_m < MOST_THICK_M / 2 - ASIDE)[parts] & free
