"""One path in space: laid out over its facets and its edge, looked at leg by leg, and weighed.

The ways from both ends of a path to its edge are unfolded into one straight line, which meets the edge where
the ray leaves at the angle it arrives (Keller's law). Without an edge the line ends at the receiver. Each
reflection point must lie in its facet, the neighbours of the edge must lie outside of its wedge, and no leg
may pass more walls than are left to pass.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from wireless.em.fields import DIFFRACTION, REFLECTION, TRANSMISSION, fresnel
from wireless.geometry.images import FEW_TRIANGLES, Space, in_large_patch
from wireless.geometry.occlusion import (
    FREE,
    HIDDEN,
    NEAR_M,
    TOUCHED,
    Tree,
    crosses,
    hidden,
    passed,
    sight,
    sight_along,
)
from wireless.support.compiled import compiled
from wireless.tracing.table import Scratch, Setting, enter, weigh

#: How far beside a target [m], and at how many places around, a path is looked for that is free.
ASIDE_M, _TURNS = 1e-6, 16


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
    )


# Inner loops below take the few arrays that they need: to hand all of a space on costs more than such a loop.
@compiled
def _turns_back(
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
    x, y, z, found = target[0], target[1], target[2], 1
    for j in range(order):
        k = order - 1 - j
        patch = chain[k]
        u, v, w = image[k + 1, 0], image[k + 1, 1], image[k + 1, 2]
        a = plane[patch, 0] * u + plane[patch, 1] * v + plane[patch, 2] * w - plane[patch, 3]
        b = plane[patch, 0] * x + plane[patch, 1] * y + plane[patch, 2] * z - plane[patch, 3]
        if (a * b > 0 and min(abs(a), abs(b)) > NEAR_M) or abs(a - b) < NEAR_M:
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
                inside = inside or least >= -NEAR_M
            if not inside:
                return 0
        points[j, 0], points[j, 1], points[j, 2] = x, y, z
    return found


@compiled
def _walk_back(
    space: Space,
    image: Float[np.ndarray, "m1 3"],
    chain: Int[np.ndarray, " m"],
    order: int,
    target: Float[np.ndarray, "3"],
    points: Float[np.ndarray, "m 3"],
) -> bool:
    """Reflection points from a target back to the source, the nearest to the target first; False if none."""
    found = _turns_back(ground_of(space), image, chain, order, target, points)
    if found == 2:
        for j in range(order):
            patch = chain[order - 1 - j]
            many = space.start[patch + 1] - space.start[patch] > FEW_TRIANGLES
            if many and not in_large_patch(space.tree, space.tree_patch, patch, points[j]):
                return False
    return found > 0


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
def is_open(gap: float, distance: float, angle: float) -> bool:
    """Whether what lies at some angle and distance is outside of a wedge, its faces included."""
    near = NEAR_M / max(distance, NEAR_M)
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
        if a < NEAR_M or b < NEAR_M:
            return -1, False
        z, end = (z * b + end * a) / (a + b), 0.0
        for i in range(3):
            along = wedge[edge, 0, i]
            target[i] = ends[edge, 0, i] + z * along
            end += along * (ends[edge, 1, i] - ends[edge, 0, i])
        if z < -NEAR_M or z > end + NEAR_M:
            return -1, False
        found = _turns_back(ground, far[0], far[1], far[2], target, points)
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
    back = _turns_back(ground, near[0], near[1], n, target, points)
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
            if not is_open(gap, distance, angle):
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
def weigh_path(
    facet_normal: Float[np.ndarray, "f 3"],
    edge_facets: Int[np.ndarray, "e 2"],
    ground: Ground,
    setting: Setting,
    m: int,
    scratch: Scratch,
) -> tuple[float, float]:
    """Length and power of the path in `scratch`, gain set; length -1 if it is none."""
    n = 1.0
    for j in range(m):
        primitive = scratch.primitive[j]
        if scratch.kind[j] != DIFFRACTION:
            for i in range(3):
                scratch.normal[j, i] = facet_normal[primitive, i]
            for i in range(setting.walls.shape[1]):
                scratch.walls[j, i] = setting.walls[primitive, i]
        else:
            scratch.wedge[:] = ground.edge_wedge[primitive]
            n = ground.edge_gap_rad[primitive] / np.pi
            for i in range(2):
                for k in range(setting.walls.shape[1]):
                    scratch.wedge_walls[i, k] = setting.walls[edge_facets[primitive, i], k]
    return weigh(setting, m, n, scratch)


@compiled
def left_by_mirrors(
    facet_normal: Float[np.ndarray, "f 3"], setting: Setting, m: int, scratch: Scratch
) -> float:
    """Most of the power of the path in `scratch` that its reflections leave, of the better polarisation at each."""
    most, point = 1.0, scratch.point
    for j in range(m):
        if scratch.kind[j] != REFLECTION:
            continue
        primitive, size, off = scratch.primitive[j], 0.0, 0.0
        for i in range(3):
            way = point[j + 1, i] - point[j, i]
            size += way * way
            off += way * facet_normal[primitive, i]
        if size < NEAR_M**2:  # in a corner, from another reflection in the same point
            continue
        cos_i = min(abs(off) / np.sqrt(size), 1.0)
        te, tm, _, _ = fresnel(cos_i, setting.walls[primitive], setting.wavenumber)
        most *= max(abs(te), abs(tm)) ** 2
    return 1.0001 * most


@compiled
def pass_walls(
    space: Space,
    setting: Setting,
    m: int,
    scratch: Scratch,
    where: Float[np.ndarray, " k"],
    which: Int[np.ndarray, " k"],
) -> int:
    """Put the walls between the points of a path into it; its new number of interactions, -1 if it is hidden."""
    left = setting.max_through
    leg, end = 0, m
    while leg <= end:
        p, q = scratch.point[leg].copy(), scratch.point[leg + 1].copy()
        if left == 0:
            if hidden(space.tree, p, q):
                return -1
            leg += 1
            continue
        n = passed(space.tree, p, q, where[:left], which[:left])
        if n < 0:
            return -1
        for j in range(end + 1, leg, -1):
            scratch.point[j + n] = scratch.point[j]
        for j in range(end - 1, leg - 1, -1):
            scratch.kind[j + n], scratch.primitive[j + n] = scratch.kind[j], scratch.primitive[j]
        for j in range(n):
            for i in range(3):
                scratch.point[leg + 1 + j, i] = p[i] + where[j] * (q[i] - p[i])
            scratch.kind[leg + j] = TRANSMISSION
            scratch.primitive[leg + j] = space.surfaces.triangle_facet[space.tree.number[which[j]]]
        left, end, leg = left - n, end + n, leg + n + 1
    return end


@compiled
def look(tree: Tree, m: int, point: Float[np.ndarray, "m2 3"], kind: Int[np.ndarray, " m"]) -> int:
    """`HIDDEN`, `FREE`, or `TOUCHED` if it depends on what side of a tie a path of m interactions is taken to be."""
    found = sight_along(tree, point, m + 1)
    for j in range(m):
        if found == FREE and kind[j] == REFLECTION:
            found = _turn(tree, point[j], point[j + 1], point[j + 2])
    return found


@compiled
def _turn(
    tree: Tree, p: Float[np.ndarray, "3"], at: Float[np.ndarray, "3"], q: Float[np.ndarray, "3"]
) -> int:
    """`TOUCHED` if a reflection is in a corner: at a point of another wall, or of the next reflection."""
    step = 0.0
    for i in range(3):
        step += abs(q[i] - at[i])
    return TOUCHED if step < 10 * NEAR_M or crosses(tree, p, at, q) else FREE


@compiled
def _is_limit(
    space: Space,
    source: Float[np.ndarray, "3"],
    chain: Int[np.ndarray, " m"],
    target: Float[np.ndarray, "3"],
    points: Float[np.ndarray, "m 3"],
) -> bool:
    """Whether a way over facets, which meets sides of others, is free to some place beside its target."""
    image, order = images_over(space.panes.plane, source, chain), len(chain)
    along, across, other, place = np.empty(3), np.zeros(3), np.empty(3), np.empty(3)
    size, least = 0.0, 0
    for i in range(3):
        along[i] = target[i] - image[order, i]
        size += along[i] ** 2
    along /= np.sqrt(size)
    if not _walk_back(space, image, chain, order, target, points):
        return False
    for i in range(3):
        if abs(along[i]) < abs(along[least]):
            least = i
    across[(least + 1) % 3], across[(least + 2) % 3] = -along[(least + 2) % 3], along[(least + 1) % 3]
    across /= np.sqrt(1 - along[least] ** 2)
    for i in range(3):
        other[i] = along[(i + 1) % 3] * across[(i + 2) % 3] - along[(i + 2) % 3] * across[(i + 1) % 3]
    for turn in range(_TURNS):
        c, s = np.cos((turn + 0.5) * 2 * np.pi / _TURNS), np.sin((turn + 0.5) * 2 * np.pi / _TURNS)
        # Before the target too, lest it be behind the wall that it lies on.
        place[:] = target + ASIDE_M * (c * across + s * other - 10 * along)
        if not _walk_back(space, image, chain, order, place, points):
            continue
        free, here = True, source
        for j in range(order):
            there, after = points[order - 1 - j], points[order - 2 - j] if j + 1 < order else place
            free = (
                free
                and sight(space.tree, here, there) == FREE
                and _turn(space.tree, here, there, after) == FREE
            )
            here = there
        if free and sight(space.tree, here, place) == FREE:
            return True
    return False


@compiled
def try_path(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    points: Float[np.ndarray, "m 3"],
    m: int,
    who: Int[np.ndarray, " w"],
    scratch: Scratch,
    where: Float[np.ndarray, " k"],
    which: Int[np.ndarray, " k"],
    rank: Float[np.ndarray, "k 5"],
    best: Int[np.ndarray, "k w"],
    count: int,
) -> int:
    """Enter the path in `scratch` into a link's list, unless it is hidden; new length of the list."""
    # Most ways are hidden, which is found out sooner than how strong they would be.
    bare, seen = m, FREE
    if setting.max_through == 0:
        seen = look(space.tree, m, scratch.point, scratch.kind)
        if seen == HIDDEN:
            return count
    surfaces, ground = space.surfaces, ground_of(space)
    length, power = weigh_path(surfaces.facet_normal, surfaces.edge_facets, ground, setting, m, scratch)
    if length < 0 or (count == len(rank) and power <= rank[count - 1, 0]):
        return count
    if setting.max_through > 0:
        m = pass_walls(space, setting, m, scratch, where, which)
    if m < 0 or m > setting.max_interactions:
        return count
    if m > bare:
        length, power = weigh_path(surfaces.facet_normal, surfaces.edge_facets, ground, setting, m, scratch)
        if count == len(rank) and power <= rank[count - 1, 0]:
            return count
    if seen == TOUCHED and not is_limit(space, tx, rx, who, scratch.point, points):
        return count
    return list_path(scratch.point, m, who, length, power, rank, best, count)


@compiled
def is_limit(
    space: Space,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    who: Int[np.ndarray, " w"],
    point: Float[np.ndarray, "m2 3"],
    points: Float[np.ndarray, "m 3"],
) -> bool:
    """Whether a path that touches walls counts as seen: as in floor plans, from either end to the edge, or to rx."""
    edge, before, after = who[0], who[1], who[2]
    near, far = who[3 : 3 + before], who[3 + before : 3 + before + after]
    target = point[before + 1].copy()
    return _is_limit(space, tx, near, target, points) and (
        edge < 0 or _is_limit(space, rx, far, target, points)
    )


@compiled
def list_path(
    p: Float[np.ndarray, "m2 3"],
    m: int,
    who: Int[np.ndarray, " w"],
    length: float,
    power: float,
    rank: Float[np.ndarray, "k 5"],
    best: Int[np.ndarray, "k w"],
    count: int,
) -> int:
    """Enter a path of so many interactions into a link's list; new length of the list."""
    new = np.empty(5)
    new[0], new[1] = power, length
    new[2] = np.arctan2(p[1, 1] - p[0, 1], p[1, 0] - p[0, 0]) + (p[1, 2] - p[0, 2]) / length
    new[3] = np.arctan2(p[m, 1] - p[m + 1, 1], p[m, 0] - p[m + 1, 0]) + (p[m, 2] - p[m + 1, 2]) / length
    new[4] = 1000 * m + (500 if who[0] >= 0 else 0)
    count, place = enter(rank, best, count, new)
    if place >= 0:
        for k in range(len(who)):
            best[place, k] = who[k]
    return count


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
