"""One path in space: walked back over its facets, looked at leg by leg, weighed, and entered into a link's list.

It is laid out before (`wireless.tracing.laying`). No leg may pass more walls than are left to pass.
"""

import numpy as np
from jaxtyping import Float, Int

from wireless.em.fields import DIFFRACTION, REFLECTION, TRANSMISSION, fresnel
from wireless.geometry.images import FEW_TRIANGLES, Space, in_large_patch
from wireless.geometry.occlusion import (
    FREE,
    HIDDEN,
    TOUCHED,
    Tree,
    crosses,
    hidden,
    passed,
    sight,
    sight_along,
)
from wireless.geometry.tolerance import NEAR_M
from wireless.support.compiled import compiled
from wireless.tracing.laying import Ground, ground_of, images_over, turns_back
from wireless.tracing.table import Scratch, Setting, enter, weigh

#: At how many places around a target a path is looked for that is free.
_TURNS = 16


@compiled
def aside(near_m: float) -> float:
    """How far beside a target that is [m]: well beyond what touches."""
    return max(1e-6, 30 * near_m)


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
    found = turns_back(ground_of(space), image, chain, order, target, points)
    if found == 2:
        for j in range(order):
            patch = chain[order - 1 - j]
            many = space.start[patch + 1] - space.start[patch] > FEW_TRIANGLES
            if many and not in_large_patch(space.tree, space.tree_patch, patch, points[j]):
                return False
    return found > 0


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
            for i in range(3):
                for k in range(3):
                    scratch.wedge[i, k] = ground.edge_wedge[primitive, i, k]
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
        n = passed(space.tree, p, q, space.tree_passes, left, where, which)
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
    return TOUCHED if step < 10 * tree.near_m or crosses(tree, p, at, q) else FREE


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
        place[:] = target + aside(space.tree.near_m) * (c * across + s * other - 10 * along)
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
    if m < 0 or m > setting.max_met:
        return count
    if m > bare:
        length, power = weigh_path(surfaces.facet_normal, surfaces.edge_facets, ground, setting, m, scratch)
        if length < 0 or (count == len(rank) and power <= rank[count - 1, 0]):
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
