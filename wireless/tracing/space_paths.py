"""One path in space: laid out over its facets and its edge, looked at leg by leg, and weighed.

The ways from both ends of a path to its edge are unfolded into one straight line, which meets the edge where
the ray leaves at the angle it arrives (Keller's law). Without an edge the line ends at the receiver. Each
reflection point must lie in its facet, the neighbours of the edge must lie outside of its wedge, and no leg
may pass more walls than are left to pass.
"""

import numpy as np
from jaxtyping import Float, Int

from wireless.em.fields import DIFFRACTION, REFLECTION, TRANSMISSION
from wireless.geometry.images import Space, on_patch
from wireless.geometry.occlusion import FREE, HIDDEN, NEAR_M, TOUCHED, crosses, hidden, passed, sight
from wireless.support.compiled import compiled
from wireless.tracing.table import Scratch, Setting, enter, weigh

#: How far beside a target [m], and at how many places around, a path is looked for that is free.
ASIDE_M, _TURNS = 1e-6, 16


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
    for j in range(order):
        k = order - 1 - j
        patch = chain[k]
        facet = space.patch_facet[patch]
        a, b = 0.0, 0.0
        for i in range(3):
            normal, at = space.surfaces.facet_normal[facet, i], space.surfaces.facet_point[facet, i]
            a, b = a + normal * (image[k + 1, i] - at), b + normal * (target[i] - at)
        if (a * b > 0 and min(abs(a), abs(b)) > NEAR_M) or abs(a - b) < NEAR_M:
            return False
        f = a / (a - b)
        for i in range(3):
            points[j, i] = image[k + 1, i] + f * (target[i] - image[k + 1, i])
        if not on_patch(space, patch, points[j]):
            return False
        target = points[j]
    return True


@compiled
def edge_sight(space: Space, edge: int, p: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    """Place along an edge, distance from its line and angle from its 0-face of a point."""
    x, y, z = 0.0, 0.0, 0.0
    for i in range(3):
        d = p[i] - space.surfaces.edge[edge, 0, i]
        z += d * space.surfaces.edge_wedge[edge, 0, i]
        x += d * space.surfaces.edge_wedge[edge, 1, i]
        y += d * space.surfaces.edge_wedge[edge, 2, i]
    return z, np.hypot(x, y), np.arctan2(y, x) % (2 * np.pi)


@compiled
def is_open(gap: float, distance: float, angle: float) -> bool:
    """Whether what lies at some angle and distance is outside of a wedge, its faces included."""
    near = NEAR_M / max(distance, NEAR_M)
    return angle <= gap + near or angle >= 2 * np.pi - near


@compiled
def lay(
    space: Space,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    near: tuple[Float[np.ndarray, "m1 3"], Int[np.ndarray, " m"], int],
    edge: int,
    far: tuple[Float[np.ndarray, "m1 3"], Int[np.ndarray, " m"], int],
    points: Float[np.ndarray, "m 3"],
    scratch: Scratch,
) -> int:
    """Put a path into `scratch`; its number of interactions, -1 if there is none. Legs may be hidden.

    Near and far are images, patches and number of reflections, from the transmitter and from the receiver.
    """
    n, m, target = near[2], near[2], rx
    scratch.point[0] = tx
    if edge >= 0:
        target = scratch.point[n + 1]
        z, a, _ = edge_sight(space, edge, near[0][n])
        end, b, _ = edge_sight(space, edge, far[0][far[2]])
        if a < NEAR_M or b < NEAR_M:
            return -1
        z, end = (z * b + end * a) / (a + b), 0.0
        for i in range(3):
            along = space.surfaces.edge_wedge[edge, 0, i]
            target[i] = space.surfaces.edge[edge, 0, i] + z * along
            end += along * (space.surfaces.edge[edge, 1, i] - space.surfaces.edge[edge, 0, i])
        if z < -NEAR_M or z > end + NEAR_M or not _walk_back(space, far[0], far[1], far[2], target, points):
            return -1
        m = n + 1 + far[2]
        for j in range(n + 1, m):
            scratch.point[j + 1], scratch.kind[j] = points[j - n - 1], REFLECTION
            scratch.primitive[j] = space.patch_facet[far[1][m - 1 - j]]
        scratch.kind[n], scratch.primitive[n] = DIFFRACTION, edge
    scratch.point[m + 1] = rx
    if not _walk_back(space, near[0], near[1], n, target, points):
        return -1
    for j in range(n):
        scratch.point[j + 1], scratch.kind[j] = points[n - 1 - j], REFLECTION
        scratch.primitive[j] = space.patch_facet[near[1][j]]
    if edge >= 0:
        gap = space.surfaces.edge_gap_rad[edge]
        for j in (n, n + 2):
            _, distance, angle = edge_sight(space, edge, scratch.point[j])
            if not is_open(gap, distance, angle):
                return -1
    return m


@compiled
def weigh_path(space: Space, setting: Setting, m: int, scratch: Scratch) -> tuple[float, float]:
    """Length and power of the path in `scratch`, gain set; length -1 if it is none."""
    surfaces, n = space.surfaces, 1.0
    for j in range(m):
        primitive = scratch.primitive[j]
        if scratch.kind[j] != DIFFRACTION:
            scratch.normal[j], scratch.walls[j] = surfaces.facet_normal[primitive], setting.walls[primitive]
        else:
            scratch.wedge[:] = surfaces.edge_wedge[primitive]
            n = surfaces.edge_gap_rad[primitive] / np.pi
            for i in range(2):
                scratch.wedge_walls[i] = setting.walls[surfaces.edge_facets[primitive, i]]
    return weigh(setting, m, n, scratch)


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
def _look(space: Space, m: int, scratch: Scratch) -> int:
    """`HIDDEN`, `FREE`, or `TOUCHED` if it depends on what side of a tie the path in `scratch` is taken to be."""
    found = FREE
    for leg in range(m + 1):
        found = max(found, sight(space.tree, scratch.point[leg], scratch.point[leg + 1]))
        if found == HIDDEN:
            return found
    for j in range(m):
        if found == FREE and scratch.kind[j] == REFLECTION:
            found = _turn(space, scratch.point[j], scratch.point[j + 1], scratch.point[j + 2])
    return found


@compiled
def _turn(
    space: Space, p: Float[np.ndarray, "3"], at: Float[np.ndarray, "3"], q: Float[np.ndarray, "3"]
) -> int:
    """`TOUCHED` if a reflection is in a corner: at a point of another wall, or of the next reflection."""
    step = 0.0
    for i in range(3):
        step += abs(q[i] - at[i])
    return TOUCHED if step < 10 * NEAR_M or crosses(space.tree, p, at, q) else FREE


@compiled
def _is_limit(
    space: Space,
    source: Float[np.ndarray, "3"],
    chain: Int[np.ndarray, " m"],
    target: Float[np.ndarray, "3"],
    points: Float[np.ndarray, "m 3"],
) -> bool:
    """Whether a way over facets, which meets sides of others, is free to some place beside its target."""
    image, order = images_over(space, source, chain), len(chain)
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
                free and sight(space.tree, here, there) == FREE and _turn(space, here, there, after) == FREE
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
    bare, seen = m, _look(space, m, scratch) if setting.max_through == 0 else FREE
    if seen == HIDDEN:
        return count
    length, power = weigh_path(space, setting, m, scratch)
    if length < 0 or (count == len(rank) and power <= rank[count - 1, 0]):
        return count
    if setting.max_through > 0:
        m = pass_walls(space, setting, m, scratch, where, which)
    if m < 0 or m > setting.max_interactions:
        return count
    if m > bare:
        length, power = weigh_path(space, setting, m, scratch)
        if count == len(rank) and power <= rank[count - 1, 0]:
            return count
    p, new = scratch.point, np.empty(5)
    new[0], new[1] = power, length
    new[2] = np.arctan2(p[1, 1] - p[0, 1], p[1, 0] - p[0, 0]) + (p[1, 2] - p[0, 2]) / length
    new[3] = np.arctan2(p[m, 1] - p[m + 1, 1], p[m, 0] - p[m + 1, 0]) + (p[m, 2] - p[m + 1, 2]) / length
    new[4] = 1000 * m + (500 if who[0] >= 0 else 0)
    if seen == TOUCHED:
        # Touching is seeing, as in floor plans: from either end to the edge, or to the receiver.
        edge, before, after = who[0], who[1], who[2]
        near, far = who[3 : 3 + before], who[3 + before : 3 + before + after]
        target = p[before + 1].copy()
        if not _is_limit(space, tx, near, target, points):
            return count
        if edge >= 0 and not _is_limit(space, rx, far, target, points):
            return count
    count, place = enter(rank, best, count, new)
    if place >= 0:
        best[place] = who
    return count


@compiled
def images_over(
    space: Space, source: Float[np.ndarray, "3"], chain: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "m1 3"]:
    """A point, and its images over a chain of patches."""
    image = np.empty((len(chain) + 1, 3))
    image[0] = source
    for k in range(len(chain)):
        facet, off = space.patch_facet[chain[k]], 0.0
        for i in range(3):
            off += space.surfaces.facet_normal[facet, i] * (
                image[k, i] - space.surfaces.facet_point[facet, i]
            )
        for i in range(3):
            image[k + 1, i] = image[k, i] - 2 * off * space.surfaces.facet_normal[facet, i]
    return image
