"""Outlines of floor plans, as tests compare them with."""

import numpy as np
import shapely

from robosim.building.outline import _contours, free_cells, to_map_exactly
from robosim.plans.floorplan import FloorPlan


def free_polygons(plan: FloorPlan, tolerance_m: float | None = None) -> shapely.MultiPolygon:
    """Free space of a plan as polygons [m] in `map`."""
    return shapely.transform(free_cells(plan, tolerance_m), lambda points: to_map_exactly(plan, points))


def wall_lines(plan: FloorPlan, tolerance_m: float | None = None) -> list[np.ndarray]:
    """Walls of a plan as closed lines [m] in `map`; the last point repeats the first.

    With walls through cell centres and no tolerance these are the lines of `cv2.findContours` as they come: a passage
    one cell wide is walked back and forth. Free cells all alone have no line.
    """
    if plan.wall_line == "cell_centre" and not tolerance_m:
        return [plan.to_map(ring) for ring, _ in _contours(plan.free) if len(ring) > 2]
    rings = shapely.get_rings(shapely.get_parts(free_polygons(plan, tolerance_m)))
    return [shapely.get_coordinates(ring) for ring in rings]
