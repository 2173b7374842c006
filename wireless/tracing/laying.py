"""Paths in space laid out: where they meet their patches and their edge, without a look at what hides them.

The ways from both ends of a path to its edge are unfolded into one straight line, which meets the edge where the ray
leaves at the angle it arrives (Keller's law). Without an edge the line ends at the receiver. Each reflection point
must lie in its patch, and the neighbours of the edge outside of its wedge.

Loops here take the few arrays that they need: to hand all of a space on takes ten times as long as to lay out a path.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from wireless.em.fields import DIFFRACTION, REFLECTION
from wireless.geometry.images import FEW_TRIANGLES, Space, in_large_patch
from wireless.support.compiled import compiled


class Ground(NamedTuple):
    """What paths are laid out over."""

    plane: Float[np.ndarray, "p 4"]
    """Unit normal and level of each patch."""
    patch_facet: Int[np.ndarray, " p"]
    """Its facet."""
    start: Int[np.ndarray, " p1"]
    """Where each patch's triangles begin, and an end."""
    triangle: Float[np.ndarray, "t 3 3"]
    """Triangles by patch."""
    inward: Float[np.ndarray, "t 3 3"]
    """Unit vectors into each of these from its sides."""
    edge: Float[np.ndarray, "e 2 3"]
    """Ends of edges [m]."""
    edge_wedge: Float[np.ndarray, "e 3 3"]
    """Axes of each, see `wireless.geometry.facets.Surfaces`."""
    edge_gap_rad: Float[np.ndarray, " e"]
    """Open angle of each."""
    near_m: float
    """What is closer than this touches."""


@compiled
def ground_of(space: Space) -> Ground:
    """What paths in a space are laid out over."""
    surfaces = space.surfaces
    return Ground(
        space.panes.plane,
        space.patch_facet,
        space.start,
        space.triangle,
        space.inward,
        surfaces.edge,
        surfaces.edge_wedge,
        surfaces.edge_gap_rad,
        surfaces.near_m,
    )


@compiled
def turns_back(
    ground: Ground,
    image: Float[np.ndarray, "m1 3"],
    chain: Int[np.ndarray, " m"],
    order: int,
    target: Float[np.ndarray, "3"],
    points: Float[np.ndarray, "m 3"],
) -> int:
    """Reflection points from a target back to the source, as `_walk_back`: 0 for none, 1 for some.

    2 if some lie in patches of many triangles, which are not asked.
    """
    plane, start, triangle, inward = ground.plane, ground.start, ground.triangle, ground.inward
    x, y, z, found, near_m = target[0], target[1], target[2], 1, ground.near_m
    for j in range(order):
        k = order - 1 - j
        patch = chain[k]
        u, v, w = image[k + 1, 0], image[k + 1, 1], image[k + 1, 2]
        a = plane[patch, 0] * u + plane[patch, 1] * v + plane[patch, 2] * w - plane[patch, 3]
        b = plane[patch, 0] * x + plane[patch, 1] * y + plane[patch, 2] * z - plane[patch, 3]
        if (a * b > 0 and min(abs(a), abs(b)) > near_m) or abs(a - b) < near_m:
            return 0
        # Who is on the patch, an edge of it too, is not mirrored by it.
        if (j == 0 and abs(b) < near_m) or (k == 0 and abs(a) < near_m):
            return 0
        f = a / (a - b)
        x, y, z = u + f * (x - u), v + f * (y - v), w + f * (z - w)
        first, last = start[patch], start[patch + 1]
        if last - first > FEW_TRIANGLES:
            found = 2
        else:
            inside = False
            for t in range(first, last):
                least = np.inf
                for i in range(3):
                    depth = (
                        inward[t, i, 0] * (x - triangle[t, i, 0])
                        + inward[t, i, 1] * (y - triangle[t, i, 1])
                        + inward[t, i, 2] * (z - triangle[t, i, 2])
                    )
                    least = min(least, depth)
                inside = inside or least >= -near_m
            if not inside:
                return 0
        points[j, 0], points[j, 1], points[j, 2] = x, y, z
    return found


@compiled
def edge_sight(
    ends: Float[np.ndarray, "e 2 3"],
    wedge: Float[np.ndarray, "e 3 3"],
    edge: int,
    p: Float[np.ndarray, "3"],
) -> tuple[float, float, float]:
    """Place along an edge, distance from its line and angle from its 0-face of a point.

    Ends and wedges are those of all edges.
    """
    x, y, z = 0.0, 0.0, 0.0
    for i in range(3):
        d = p[i] - ends[edge, 0, i]
        z += d * wedge[edge, 0, i]
        x += d * wedge[edge, 1, i]
        y += d * wedge[edge, 2, i]
    return z, np.hypot(x, y), np.arctan2(y, x) % (2 * np.pi)


@compiled
def is_open(gap: float, distance: float, angle: float, near_m: float) -> bool:
    """Whether what lies at some angle and distance is outside of a wedge, its faces included."""
    near = near_m / max(distance, near_m)
    return angle <= gap + near or angle >= 2 * np.pi - near


@compiled
def lay(
    ground: Ground,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    near: tuple[Float[np.ndarray, "m1 3"], Int[np.ndarray, " m"], int],
    edge: int,
    far: tuple[Float[np.ndarray, "m1 3"], Int[np.ndarray, " m"], int],
    points: Float[np.ndarray, "m 3"],
    point: Float[np.ndarray, "m2 3"],
    kind: Int[np.ndarray, " m"],
    primitive: Int[np.ndarray, " m"],
) -> tuple[int, bool]:
    """Put a path into point, kind and primitive of a `Scratch`; legs may be hidden.

    Near and far are images, patches and number of reflections, from the transmitter and from the receiver.

    Returns:
        Its number of interactions, -1 if there is none; and whether `on_large` has to be asked too.
    """
    n, m, target, found = near[2], near[2], rx, 1
    ends, wedge = ground.edge, ground.edge_wedge
    for i in range(3):
        point[0, i] = tx[i]
    if edge >= 0:
        target = point[n + 1]
        z, a, _ = edge_sight(ends, wedge, edge, near[0][n])
        end, b, _ = edge_sight(ends, wedge, edge, far[0][far[2]])
        if a < ground.near_m or b < ground.near_m:
            return -1, False
        z, end = (z * b + end * a) / (a + b), 0.0
        for i in range(3):
            along = wedge[edge, 0, i]
            target[i] = ends[edge, 0, i] + z * along
            end += along * (ends[edge, 1, i] - ends[edge, 0, i])
        if z < -ground.near_m or z > end + ground.near_m:
            return -1, False
        found = turns_back(ground, far[0], far[1], far[2], target, points)
        if found == 0:
            return -1, False
        m = n + 1 + far[2]
        for j in range(n + 1, m):
            kind[j] = REFLECTION
            for i in range(3):
                point[j + 1, i] = points[j - n - 1, i]
            primitive[j] = ground.patch_facet[far[1][m - 1 - j]]
        kind[n], primitive[n] = DIFFRACTION, edge
    for i in range(3):
        point[m + 1, i] = rx[i]
    back = turns_back(ground, near[0], near[1], n, target, points)
    if back == 0:
        return -1, False
    for j in range(n):
        kind[j] = REFLECTION
        for i in range(3):
            point[j + 1, i] = points[n - 1 - j, i]
        primitive[j] = ground.patch_facet[near[1][j]]
    if edge >= 0:
        gap = ground.edge_gap_rad[edge]
        for j in (n, n + 2):
            _, distance, angle = edge_sight(ends, wedge, edge, point[j])
            if not is_open(gap, distance, angle, ground.near_m):
                return -1, False
    return m, found == 2 or back == 2


@compiled
def on_large(
    space: Space,
    near: Int[np.ndarray, " m"],
    before: int,
    edge: int,
    far: Int[np.ndarray, " m"],
    after: int,
    point: Float[np.ndarray, "m2 3"],
) -> bool:
    """Whether a path that is laid out meets those of its patches that have many triangles."""
    for j in range(before + after):
        patch = near[j] if j < before else far[before + after - 1 - j]
        at = j + 1 if j < before or edge < 0 else j + 2
        many = space.start[patch + 1] - space.start[patch] > FEW_TRIANGLES
        if many and not in_large_patch(space.tree, space.tree_patch, patch, point[at]):
            return False
    return True


@compiled
def images_over(
    plane: Float[np.ndarray, "p 4"], source: Float[np.ndarray, "3"], chain: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "m1 3"]:
    """A point, and its images over a chain of patches, of whose planes normals and levels are given."""
    image = np.empty((len(chain) + 1, 3))
    mirror_over(plane, source, chain, image)
    return image


@compiled
def mirror_over(
    plane: Float[np.ndarray, "p 4"],
    source: Float[np.ndarray, "3"],
    chain: Int[np.ndarray, " m"],
    image: Float[np.ndarray, "m1 3"],
) -> int:
    """The same in an array that is there, up to where the chain has -1; its number of patches."""
    x, y, z = source[0], source[1], source[2]
    image[0, 0], image[0, 1], image[0, 2] = x, y, z
    for k in range(len(chain)):
        patch = chain[k]
        if patch < 0:
            return k
        u, v, w = plane[patch, 0], plane[patch, 1], plane[patch, 2]
        off = 2 * (u * x + v * y + w * z - plane[patch, 3])
        x, y, z = x - off * u, y - off * v, z - off * w
        image[k + 1, 0], image[k + 1, 1], image[k + 1, 2] = x, y, z
    return len(chain)
