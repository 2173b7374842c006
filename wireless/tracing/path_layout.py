"""Paths in space laid out: where they meet their patches and their edge, whatever may hide them.

The parts of a path before and behind its edge are unfolded into one straight line, which meets the edge where the ray
leaves at the angle it arrives (Keller's law). Without an edge the line ends at the receiver. Each reflection point
must lie in its patch, and the neighbours of the edge outside of its wedge.

Loops here take few arrays: handing on all of a space takes longer than laying out a path.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from wireless.em.fields import DIFFRACTION, REFLECTION
from wireless.geometry.array_types import Planes, Point
from wireless.geometry.occlusion import depth_in
from wireless.geometry.space import FEW_TRIANGLES, Ground, Space, in_large_patch


class Chain(NamedTuple):
    """A source mirrored over patches."""

    image: Float[np.ndarray, "m1 3"]
    """Source, mirrored at none of the patches, at one, and so on [m]."""
    patch: Int[np.ndarray, " m"]
    """Patches, the first from the source first."""
    order: int
    """How many of them count."""


class Layout(NamedTuple):
    """Room for one path."""

    point: Float[np.ndarray, "m2 3"]
    """Transmitter, interactions, receiver [m]."""
    kind: Int[np.ndarray, " m"]
    """Kind of each interaction."""
    primitive: Int[np.ndarray, " m"]
    """Facet or edge."""
    back: Float[np.ndarray, "m 3"]
    """Reflection points of one side, the nearest to the edge or receiver first."""


@compiled
def find_reflections(ground: Ground, chain: Chain, target: Point, points: Float[np.ndarray, "m 3"]) -> int:
    """Reflection points from a target back to the source, the nearest to the target first: 0 if there are none, else 1.

    2 if some lie in patches of many triangles, in which they are not looked up.
    """
    plane, start, triangle, inward = ground.plane, ground.start, ground.triangle, ground.inward
    image, order = chain.image, chain.order
    x, y, z, status, near_m = target[0], target[1], target[2], 1, ground.near_m
    for j in range(order):
        k = order - 1 - j
        patch = chain.patch[k]
        u, v, w = image[k + 1, 0], image[k + 1, 1], image[k + 1, 2]
        a = plane[patch, 0] * u + plane[patch, 1] * v + plane[patch, 2] * w - plane[patch, 3]
        b = plane[patch, 0] * x + plane[patch, 1] * y + plane[patch, 2] * z - plane[patch, 3]
        if (a * b > 0 and min(abs(a), abs(b)) > near_m) or abs(a - b) < near_m:
            return 0
        # A point on the patch, or on an edge of it, is not mirrored by it.
        if (j == 0 and abs(b) < near_m) or (k == 0 and abs(a) < near_m):
            return 0
        f = a / (a - b)
        x, y, z = u + f * (x - u), v + f * (y - v), w + f * (z - w)
        first, last = start[patch], start[patch + 1]
        if last - first > FEW_TRIANGLES:
            status = 2
        else:
            inside = False
            for t in range(first, last):
                inside = inside or depth_in(triangle, inward, t, x, y, z) >= -near_m
            if not inside:
                return 0
        points[j, 0], points[j, 1], points[j, 2] = x, y, z
    return status


@compiled
def reflects_to(space: Space, chain: Chain, target: Point, points: Float[np.ndarray, "m 3"]) -> bool:
    """Whether there are reflection points from a target back to the source, put into `points`."""
    status = find_reflections(space.ground, chain, target, points)
    if status == 2:
        for j in range(chain.order):
            if not _is_in_large(space, chain.patch[chain.order - 1 - j], points[j]):
                return False
    return status > 0


@compiled
def _is_in_large(space: Space, patch: int, point: Point) -> bool:
    """Whether a point of a patch's plane lies in the patch if that has many triangles."""
    many = space.ground.start[patch + 1] - space.ground.start[patch] > FEW_TRIANGLES
    return not many or in_large_patch(space.tree, space.tree_patch, patch, point)


@compiled
def edge_sight(
    ends: Float[np.ndarray, "e 2 3"], wedge: Float[np.ndarray, "e 3 3"], edge: int, p: Point
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
def lay_out(
    ground: Ground, ends: Float[np.ndarray, "2 3"], near: Chain, edge: int, far: Chain, path: Layout
) -> tuple[int, bool]:
    """Put a path into `path`; legs may be hidden.

    Args:
        ground: Facets and edges that paths are laid out over.
        ends: Transmitter and receiver.
        near: Patches from the transmitter.
        edge: Edge behind these; -1 for none.
        far: Patches from the receiver to the edge.
        path: Takes the path.

    Returns:
        Its number of interactions, -1 if there is none; and whether `is_on_large` has to be checked too.
    """
    n, m, target, status, near_m = near.order, near.order, ends[1], 1, ground.near_m
    point, kind, primitive = path.point, path.kind, path.primitive
    for i in range(3):
        point[0, i] = ends[0, i]
    if edge >= 0:
        target = point[n + 1]
        if not _meet_edge(ground, edge, near.image[n], far.image[far.order], target):
            return -1, False
        status = find_reflections(ground, far, target, path.back)
        if status == 0:
            return -1, False
        m = n + 1 + far.order
        for j in range(n + 1, m):
            kind[j], primitive[j] = REFLECTION, ground.patch_facet[far.patch[m - 1 - j]]
            for i in range(3):
                point[j + 1, i] = path.back[j - n - 1, i]
        kind[n], primitive[n] = DIFFRACTION, edge
    for i in range(3):
        point[m + 1, i] = ends[1, i]
    back = find_reflections(ground, near, target, path.back)
    if back == 0:
        return -1, False
    for j in range(n):
        kind[j], primitive[j] = REFLECTION, ground.patch_facet[near.patch[j]]
        for i in range(3):
            point[j + 1, i] = path.back[n - 1 - j, i]
    if edge >= 0:
        gap = ground.edge_gap_rad[edge]
        for j in (n, n + 2):
            _, distance, angle = edge_sight(ground.edge, ground.edge_wedge, edge, point[j])
            if not is_open(gap, distance, angle, near_m):
                return -1, False
    return m, status == 2 or back == 2


@compiled
def _meet_edge(ground: Ground, edge: int, near: Point, far: Point, target: Point) -> bool:
    """Put the point of an edge that images from both sides meet it in into `target`; False if it ends before."""
    ends, wedge, near_m, end = ground.edge, ground.edge_wedge, ground.near_m, 0.0
    z, a, _ = edge_sight(ends, wedge, edge, near)
    w, b, _ = edge_sight(ends, wedge, edge, far)
    if a < near_m or b < near_m:
        return False
    z = (z * b + w * a) / (a + b)
    for i in range(3):
        along = wedge[edge, 0, i]
        target[i] = ends[edge, 0, i] + z * along
        end += along * (ends[edge, 1, i] - ends[edge, 0, i])
    return -near_m <= z <= end + near_m


@compiled
def is_on_large(space: Space, near: Chain, edge: int, far: Chain, point: Float[np.ndarray, "m2 3"]) -> bool:
    """Whether a path that is laid out meets those of its patches that have many triangles."""
    before, after = near.order, far.order
    for j in range(before + after):
        patch = near.patch[j] if j < before else far.patch[before + after - 1 - j]
        if not _is_in_large(space, patch, point[j + 1 if j < before or edge < 0 else j + 2]):
            return False
    return True


@compiled
def images_over(plane: Planes, source: Point, patch: Int[np.ndarray, " m"]) -> Chain:
    """A point mirrored over patches, of which planes normals and levels are given; up to where these are -1."""
    image = np.empty((len(patch) + 1, 3))
    return Chain(image, patch, mirror_over(plane, source, patch, image))


@compiled
def mirror_over(
    plane: Planes, source: Point, chain: Int[np.ndarray, " m"], image: Float[np.ndarray, "m1 3"]
) -> int:
    """Put a point, and its images over a chain of patches up to where that is -1, into `image`; how many patches."""
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
