"""Floor that a placed body takes from robots below some height, and its section at one height.

Seen from above, the part of a surface between two heights is a union of convex polygons; a closed body that goes
through the whole band also has its section at the upper height. Both together are exact for closed bodies. Sheets
count with `SHEET_M` of thickness, since a line takes no floor.

Left out: bodies whose own surface crosses itself, if they are not oriented: they are filled by the even-odd rule.
"""

import numpy as np
import shapely
from jaxtyping import Float

from robosim.plans.formats.raster import cut, section
from robosim.plans.furnishings.furnishing import Bodies

#: Robots drive over lower things: rugs, doorsills [m].
ROLLS_OVER_M = 0.01
#: Thickness of surfaces that close no volume [m].
SHEET_M = 1e-3
#: Shorter reaches into the band do not count [m], nor do smaller areas [m2].
_TOUCH_M, _NOTHING_M2 = 1e-6, 1e-10


def footprint(bodies: Bodies, height_m: float) -> shapely.Geometry:
    """The floor over which something is lower than a height, in `map` [m]; a body that begins there is not lower."""
    parts = []
    for triangles, closed, oriented in _each(bodies):
        z = triangles[:, :, 2]
        reaches = (z.max(axis=1) > ROLLS_OVER_M) & (z.min(axis=1) < height_m - _TOUCH_M)
        polygons = cut(triangles[reaches], ROLLS_OVER_M, height_m)[:, :, :2]
        parts.append(_seen_from_above(polygons, closed))
        if closed:
            parts.append(_filled(triangles, height_m - _TOUCH_M, oriented))
    return shapely.union_all(parts)


def filled(bodies: Bodies, height_m: float) -> shapely.Geometry:
    """Section at one height, seen from above, in `map` [m]; sheets are lines with a thickness."""
    parts = []
    for triangles, closed, oriented in _each(bodies):
        if closed:
            parts.append(_filled(triangles, height_m, oriented))
        else:
            lines = np.stack(section(triangles, height_m)[::-1], axis=1)
            parts.append(shapely.buffer(shapely.multilinestrings(lines), SHEET_M / 2))
    return shapely.union_all(parts)


def _each(bodies: Bodies) -> list[tuple[Float[np.ndarray, "n 3 3"], bool, bool]]:
    triangles = bodies.vertices[bodies.faces]
    order = np.argsort(bodies.body, kind="stable")
    ends = np.cumsum(np.bincount(bodies.body))[:-1]
    return [
        (triangles[members], bool(closed), bool(oriented))
        for members, closed, oriented in zip(
            np.split(order, ends), bodies.closed, bodies.oriented, strict=True
        )
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


def _filled(triangles: Float[np.ndarray, "n 3 3"], height_m: float, oriented: bool) -> shapely.Geometry:
    """The section of a closed surface: where its outline winds around if it is oriented, else by even and odd."""
    end, start = section(triangles, height_m)
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
