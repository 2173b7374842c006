"""Which floor a thing takes from a body that stands below some height, and which part of a level it fills.

Seen from above, the part of a surface between two heights is a union of convex polygons; a closed body that goes
through the whole band is told by its section at the upper height. Both together are exact for closed bodies. Sheets
count with `SHEET_M` of thickness, since a line takes no floor.

Left out: bodies whose own surface crosses itself, if they are not oriented: they are filled by the even-odd rule.
"""

import numpy as np
import shapely
from jaxtyping import Float

from robosim.plans.formats.mesh_raster import cut
from robosim.plans.furnishings.bodies import Bodies

#: Things lower than this are driven over: rugs, doorsills [m].
ROLLS_OVER_M = 0.01
#: Thickness of surfaces that close no volume [m].
SHEET_M = 1e-3
#: What reaches into the band by less does not count [m], and areas that are none [m2].
_TOUCH_M, _NOTHING_M2 = 1e-6, 1e-10


def footprint(bodies: Bodies, height_m: float) -> shapely.Geometry:
    """The floor over which something is lower than a height, in `map` [m].

    What begins at the very height is not lower than it.
    """
    parts = []
    for triangles, closed, oriented in _each(bodies):
        z = triangles[:, :, 2]
        reaches = (z.max(axis=1) > ROLLS_OVER_M) & (z.min(axis=1) < height_m - _TOUCH_M)
        polygons = cut(triangles[reaches], ROLLS_OVER_M, height_m)[:, :, :2]
        parts.append(_seen_from_above(polygons, closed))
        if closed:
            parts.append(_filled(*_section(triangles, height_m - _TOUCH_M), oriented))
    return shapely.union_all(parts)


def filled(bodies: Bodies, height_m: float) -> shapely.Geometry:
    """What is solid at one height, seen from above, in `map` [m]; sheets as lines with a thickness."""
    parts = []
    for triangles, closed, oriented in _each(bodies):
        start, end = _section(triangles, height_m)
        if closed:
            parts.append(_filled(start, end, oriented))
        else:
            parts.append(
                shapely.buffer(shapely.multilinestrings(np.stack([start, end], axis=1)), SHEET_M / 2)
            )
    return shapely.union_all(parts)


def _each(bodies: Bodies) -> list[tuple[Float[np.ndarray, "n 3 3"], bool, bool]]:
    triangles = bodies.vertices[bodies.faces]
    order = np.argsort(bodies.body, kind="stable")
    ends = np.cumsum(np.bincount(bodies.body))[:-1]
    return [
        (triangles[some], bool(closed), bool(oriented))
        for some, closed, oriented in zip(np.split(order, ends), bodies.closed, bodies.oriented, strict=True)
    ]


def _section(
    triangles: Float[np.ndarray, "n 3 3"], height: float
) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m 2"]]:
    """Starts and ends of the lines in which triangles cross a height; neighbours meet in the very same points.

    They go from the side that rises through the height to the one that falls, as seen along the triangle's corners.
    """
    above = triangles[:, :, 2] >= height
    some = above.any(axis=1) & ~above.all(axis=1)
    start, above = triangles[some], above[some]
    end, end_above = np.roll(start, -1, axis=1), np.roll(above, -1, axis=1)
    # From below to above, whichever way the side runs, so that both triangles on it round alike.
    low, high = np.where(above[..., None], end, start), np.where(above[..., None], start, end)
    rise = np.where(above == end_above, 1.0, high[:, :, 2] - low[:, :, 2])
    points = low[:, :, :2] + ((height - low[:, :, 2]) / rise)[..., None] * (high - low)[:, :, :2]
    each = np.arange(len(points))
    return points[each, np.argmax(~above & end_above, axis=1)], points[
        each, np.argmax(above & ~end_above, axis=1)
    ]


def _seen_from_above(polygons: Float[np.ndarray, "n 6 2"], closed: bool) -> shapely.Geometry:
    """Union of convex polygons, some of which may be lines."""
    if not len(polygons):
        return shapely.Polygon()
    hulls = shapely.convex_hull(shapely.multipoints(polygons))
    flat = shapely.area(hulls) > _NOTHING_M2
    seen = shapely.union_all(hulls[flat])
    if closed:  # its upright faces end at others, which are seen
        return seen
    return seen.union(shapely.buffer(shapely.union_all(hulls[~flat]), SHEET_M / 2))


def _filled(
    start: Float[np.ndarray, "n 2"], end: Float[np.ndarray, "n 2"], oriented: bool
) -> shapely.Geometry:
    """The inside of closed lines, given by their pieces: where they wind around, or by even and odd."""
    if not len(start):
        return shapely.Polygon()
    lines = shapely.union_all(shapely.linestrings(np.stack([start, end], axis=1)))
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
    if not len(faces):
        return shapely.Polygon()
    inner = shapely.point_on_surface(faces)
    x, y = shapely.get_x(inner)[:, None], shapely.get_y(inner)[:, None]
    up = (start[:, 1] <= y) & (end[:, 1] > y)
    down = (start[:, 1] > y) & (end[:, 1] <= y)
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = start[:, 0] + (y - start[:, 1]) / (end[:, 1] - start[:, 1]) * (end[:, 0] - start[:, 0])
    turns = ((up.astype(int) - down) * (cross > x)).sum(axis=1)
    inside = turns != 0 if oriented else turns % 2 != 0
    return shapely.union_all(faces[inside])
