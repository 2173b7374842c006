"""The strongest paths of links among any triangles: images over facets, bent at edges, each leg looked at.

The transmitter is mirrored at chains of facets; a chain goes on only to facets that reach behind the last
one and that its bounding cone meets. For each receiver a chain is walked back from the receiver, and is a
path if each point lies in its facet and its legs meet no more walls than may be passed. At an edge the ways
from both ends are unfolded into one straight line (the ray leaves at the angle it arrives, Keller's law),
which gives the point on the edge.

Everything is tried, and nothing is sampled: the cost grows with the number of facets to the power of the
number of reflections. Floor plans have a faster way (`wireless.links`), to the same paths.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from wireless.compiled import compiled
from wireless.fields import DIFFRACTION, REFLECTION, TRANSMISSION
from wireless.geometry import Surfaces
from wireless.occlusion import NEAR_M, Tree, hidden, holds, make_tree, passed, planes
from wireless.table import (
    Room,
    Setting,
    Table,
    enter,
    make_room,
    make_table,
    most_interactions,
    weigh,
    write_row,
)


class Space(NamedTuple):
    """Surfaces made ready for tracing."""

    surfaces: Surfaces
    """Facets and edges, around an origin of their own."""
    inward: Float[np.ndarray, "t 3 3"]
    """Unit vectors into each triangle from its sides."""
    tree: Tree
    """What hides."""
    mirrors: Bool[np.ndarray, "f"]
    """Facets that reflect."""
    centre: Float[np.ndarray, "f 3"]
    """Middle of each facet."""
    radius: Float[np.ndarray, "f"]
    """Distance of its farthest corner from there."""
    reach: Float[np.ndarray, "f f 2"]
    """Least and greatest distance of another facet's corners from a facet's plane, along its normal."""


def make_space(surfaces: Surfaces, mirrors: Bool[np.ndarray, "f"]) -> Space:
    """Prepare what does not depend on antennas.

    Args:
        surfaces: Facets and edges.
        mirrors: Facets that reflect.
    """
    start = surfaces.facet_start[:-1]
    corners = surfaces.triangle
    low = np.minimum.reduceat(corners.min(axis=1), start)
    high = np.maximum.reduceat(corners.max(axis=1), start)
    centre = (low + high) / 2
    off = np.linalg.norm(corners - centre[surfaces.triangle_facet][:, None], axis=2).max(axis=1)
    level = np.einsum("fi,fi->f", surfaces.facet_normal, surfaces.facet_point)
    height = np.einsum("fi,tki->ftk", surfaces.facet_normal, corners) - level[:, None, None]
    reach = np.stack(
        [
            np.minimum.reduceat(height.min(axis=2), start, axis=1),
            np.maximum.reduceat(height.max(axis=2), start, axis=1),
        ],
        axis=2,
    )
    return Space(
        surfaces=surfaces,
        inward=planes(corners)[1],
        tree=make_tree(corners),
        mirrors=mirrors,
        centre=centre,
        radius=np.maximum.reduceat(off, start),
        reach=reach,
    )


@compiled
def _level(space: Space, facet: int, p: Float[np.ndarray, "3"]) -> float:
    """Distance of a point from a facet's plane, along its normal."""
    total = 0.0
    for i in range(3):
        total += space.surfaces.facet_normal[facet, i] * (p[i] - space.surfaces.facet_point[facet, i])
    return total


@compiled
def _may_follow(space: Space, image: Float[np.ndarray, "3"], last: int, facet: int) -> bool:
    """Whether rays of an image through facet `last` can meet another facet behind it."""
    side = _level(space, last, image)
    behind = space.reach[last, facet, 0] < -NEAR_M if side > 0 else space.reach[last, facet, 1] > NEAR_M
    if not behind:
        return False
    dot, a, b = 0.0, 0.0, 0.0
    for i in range(3):
        u, v = space.centre[last, i] - image[i], space.centre[facet, i] - image[i]
        dot, a, b = dot + u * v, a + u * u, b + v * v
    a, b = np.sqrt(a), np.sqrt(b)
    if a <= space.radius[last] or b <= space.radius[facet]:
        return True
    open_rad = np.arcsin(space.radius[last] / a) + np.arcsin(space.radius[facet] / b) + 1e-9
    return open_rad >= np.pi or dot >= a * b * np.cos(open_rad)


@compiled
def mirror_chains(
    space: Space, source: Float[np.ndarray, "3"], max_order: int
) -> tuple[Float[np.ndarray, "c 3"], Int[np.ndarray, "c 3"]]:
    """Images of a point over chains of facets.

    Returns:
        image: Mirrored source of each chain; the first is the source itself.
        chain: Last facet, chain before it, and number of reflections.
    """
    image, chain = np.empty((256, 3)), np.empty((256, 3), np.int64)
    image[0], n, now = source, 1, 0
    chain[0, 0], chain[0, 1], chain[0, 2] = -1, -1, 0
    while now < n:
        last, order = chain[now, 0], chain[now, 2]
        if order == max_order:
            break
        for facet in range(len(space.mirrors)):
            if not space.mirrors[facet] or facet == last:
                continue
            off = _level(space, facet, image[now])
            if abs(off) < NEAR_M or (last >= 0 and not _may_follow(space, image[now], last, facet)):
                continue
            if n == len(image):
                image, chain = np.concatenate((image, image)), np.concatenate((chain, chain))
            for i in range(3):
                image[n, i] = image[now, i] - 2 * off * space.surfaces.facet_normal[facet, i]
            chain[n, 0], chain[n, 1], chain[n, 2] = facet, now, order + 1
            n += 1
        now += 1
    return image[:n], chain[:n]


@compiled
def _walk_back(
    space: Space,
    image: Float[np.ndarray, "c 3"],
    chain: Int[np.ndarray, "c 3"],
    node: int,
    target: Float[np.ndarray, "3"],
    points: Float[np.ndarray, "m 3"],
    facets: Int[np.ndarray, "m"],
) -> bool:
    """Reflection points from a target back to the source, the nearest to the target first; False if none."""
    surfaces = space.surfaces
    j = 0
    while chain[node, 2] > 0:
        facet = chain[node, 0]
        a, b = _level(space, facet, image[node]), _level(space, facet, target)
        if a * b > 0 or abs(a - b) < NEAR_M:
            return False
        f = a / (a - b)
        for i in range(3):
            points[j, i] = image[node, i] + f * (target[i] - image[node, i])
        first, last = surfaces.facet_start[facet], surfaces.facet_start[facet + 1]
        if not holds(surfaces.triangle[first:last], space.inward[first:last], points[j]):
            return False
        facets[j], target = facet, points[j]
        node = chain[node, 1]
        j += 1
    return True


@compiled
def _edge_point(
    space: Space, edge: int, p: Float[np.ndarray, "3"], q: Float[np.ndarray, "3"], out: Float[np.ndarray, "3"]
) -> bool:
    """Where the shortest way from p over an edge's line to q meets it; False if that is beyond its ends."""
    start, along = space.surfaces.edge[edge, 0], space.surfaces.edge_wedge[edge, 0]
    length, zp, zq, p2, q2 = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        length += along[i] * (space.surfaces.edge[edge, 1, i] - start[i])
        zp, zq = zp + along[i] * (p[i] - start[i]), zq + along[i] * (q[i] - start[i])
        p2, q2 = p2 + (p[i] - start[i]) ** 2, q2 + (q[i] - start[i]) ** 2
    a, b = np.sqrt(max(p2 - zp * zp, 0.0)), np.sqrt(max(q2 - zq * zq, 0.0))
    if a < NEAR_M or b < NEAR_M:
        return False
    z = (zp * b + zq * a) / (a + b)
    for i in range(3):
        out[i] = start[i] + z * along[i]
    return -NEAR_M <= z <= length + NEAR_M


@compiled
def _in_open(space: Space, edge: int, at: Float[np.ndarray, "3"], p: Float[np.ndarray, "3"]) -> bool:
    """Whether a point lies outside of the wedge, its faces included."""
    x, y = 0.0, 0.0
    for i in range(3):
        x += (p[i] - at[i]) * space.surfaces.edge_wedge[edge, 1, i]
        y += (p[i] - at[i]) * space.surfaces.edge_wedge[edge, 2, i]
    near = NEAR_M / max(np.hypot(x, y), NEAR_M)
    angle = np.arctan2(y, x) % (2 * np.pi)
    return angle <= space.surfaces.edge_gap_rad[edge] + near or angle >= 2 * np.pi - near


@compiled
def _lay(
    space: Space,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    image: Float[np.ndarray, "c 3"],
    chain: Int[np.ndarray, "c 3"],
    node: int,
    edge: int,
    far_image: Float[np.ndarray, "d 3"],
    far_chain: Int[np.ndarray, "d 3"],
    far_node: int,
    points: Float[np.ndarray, "m 3"],
    facets: Int[np.ndarray, "m"],
    room: Room,
) -> int:
    """Put a path into `room`; its number of interactions, -1 if there is none. Legs may be hidden."""
    n, m = chain[node, 2], chain[node, 2]
    target = rx
    if edge >= 0:
        if not _edge_point(space, edge, image[node], far_image[far_node], room.point[n + 1]):
            return -1
        target = room.point[n + 1]
        if not _walk_back(space, far_image, far_chain, far_node, target, points, facets):
            return -1
        m = n + 1 + far_chain[far_node, 2]
        for j in range(n + 1, m):
            room.point[j + 1], room.kind[j], room.thing[j] = points[j - n - 1], REFLECTION, facets[j - n - 1]
        room.kind[n], room.thing[n] = DIFFRACTION, edge
    room.point[0], room.point[m + 1] = tx, rx
    if not _walk_back(space, image, chain, node, target, points, facets):
        return -1
    for j in range(n):
        room.point[j + 1], room.kind[j], room.thing[j] = points[n - 1 - j], REFLECTION, facets[n - 1 - j]
    if edge >= 0:
        before, after = room.point[n], room.point[n + 2]
        if not (_in_open(space, edge, target, before) and _in_open(space, edge, target, after)):
            return -1
    return m


@compiled
def _weigh(space: Space, setting: Setting, m: int, room: Room) -> tuple[float, float]:
    """Length and power of the path in `room`, gain set; length -1 if it is none."""
    surfaces, n = space.surfaces, 1.0
    for j in range(m):
        thing = room.thing[j]
        if room.kind[j] != DIFFRACTION:
            room.normal[j], room.eps[j] = surfaces.facet_normal[thing], setting.wall_eps[thing]
        else:
            room.wedge[:] = surfaces.edge_wedge[thing]
            n = surfaces.edge_gap_rad[thing] / np.pi
            for i in range(2):
                room.wedge_eps[i] = setting.wall_eps[surfaces.edge_facets[thing, i]]
    return weigh(setting, m, n, room)


@compiled
def _pass_walls(
    space: Space,
    setting: Setting,
    m: int,
    room: Room,
    where: Float[np.ndarray, "k"],
    which: Int[np.ndarray, "k"],
) -> int:
    """Put the walls between the points of a path into it; its new number of interactions, -1 if it is hidden."""
    left = setting.max_through
    leg, end = 0, m
    while leg <= end:
        p, q = room.point[leg].copy(), room.point[leg + 1].copy()
        if left == 0:
            if hidden(space.tree, p, q):
                return -1
            leg += 1
            continue
        n = passed(space.tree, p, q, where[:left], which[:left])
        if n < 0:
            return -1
        for j in range(end + 1, leg, -1):
            room.point[j + n] = room.point[j]
        for j in range(end - 1, leg - 1, -1):
            room.kind[j + n], room.thing[j + n] = room.kind[j], room.thing[j]
        for j in range(n):
            for i in range(3):
                room.point[leg + 1 + j, i] = p[i] + where[j] * (q[i] - p[i])
            room.kind[leg + j] = TRANSMISSION
            room.thing[leg + j] = space.surfaces.triangle_facet[space.tree.number[which[j]]]
        left, end, leg = left - n, end + n, leg + n + 1
    return end


@compiled
def _try(
    space: Space,
    setting: Setting,
    m: int,
    who: tuple[int, int, int],
    room: Room,
    where: Float[np.ndarray, "k"],
    which: Int[np.ndarray, "k"],
    rank: Float[np.ndarray, "k 5"],
    best: Int[np.ndarray, "k 4"],
    count: int,
) -> int:
    """Enter the path in `room` into a link's list, unless it is hidden; new length of the list."""
    if m < 0:
        return count
    length, power = _weigh(space, setting, m, room)
    if length < 0 or (count == len(rank) and power <= rank[count - 1, 0]):
        return count
    bare = m
    m = _pass_walls(space, setting, m, room, where, which)
    if m < 0:
        return count
    if m > bare:
        length, power = _weigh(space, setting, m, room)
        if count == len(rank) and power <= rank[count - 1, 0]:
            return count
    p, new = room.point, np.empty(5)
    new[0], new[1] = power, length
    new[2] = np.arctan2(p[1, 1] - p[0, 1], p[1, 0] - p[0, 0]) + (p[1, 2] - p[0, 2]) / length
    new[3] = np.arctan2(p[m, 1] - p[m + 1, 1], p[m, 0] - p[m + 1, 0]) + (p[m, 2] - p[m + 1, 2]) / length
    new[4] = 1000 * m + (500 if who[1] >= 0 else 0)
    count, place = enter(rank, best, count, new)
    if place >= 0:
        best[place, 0], best[place, 1], best[place, 2] = who
    return count


@compiled
def trace_space(
    space: Space, setting: Setting, tx: Float[np.ndarray, "3"], rx: Float[np.ndarray, "r 3"]
) -> Table:
    """Strongest paths from one transmitter to many receivers.

    Args:
        space: Surfaces.
        setting: Physics and limits; permittivities are those of facets.
        tx: Position of the transmitter, around the space's origin [m].
        rx: Positions of receivers.
    """
    keep, table, most = setting.keep, make_table(setting, len(rx)), most_interactions(setting)
    image, chain = mirror_chains(space, tx, max(setting.max_reflections, setting.edge_reflections))
    n_edges = len(space.surfaces.edge) if setting.edge_reflections >= 0 else 0
    room, rank, best = make_room(setting), np.empty((keep, 5)), np.empty((keep, 4), np.int64)
    points, facets = np.empty((most, 3)), np.empty(most, np.int64)
    where, which = np.empty(setting.max_through), np.empty(setting.max_through, np.int64)
    for r in range(len(rx)):
        here, count = rx[r], 0
        far_image, far_chain = mirror_chains(space, here, max(setting.edge_reflections, 0))
        for node in range(len(image)):
            if chain[node, 2] > setting.max_reflections:
                break
            m = _lay(space, tx, here, image, chain, node, -1, image, chain, 0, points, facets, room)
            count = _try(space, setting, m, (node, -1, 0), room, where, which, rank, best, count)
        for edge in range(n_edges):
            for node in range(len(image)):
                if chain[node, 2] > setting.edge_reflections:
                    break
                for far in range(len(far_image)):
                    if chain[node, 2] + far_chain[far, 2] > setting.edge_reflections:
                        break
                    m = _lay(
                        space,
                        tx,
                        here,
                        image,
                        chain,
                        node,
                        edge,
                        far_image,
                        far_chain,
                        far,
                        points,
                        facets,
                        room,
                    )
                    count = _try(space, setting, m, (node, edge, far), room, where, which, rank, best, count)
        table.found[r] = count
        for j in range(count):
            node, edge, far = best[j, 0], best[j, 1], best[j, 2]
            m = _lay(
                space, tx, here, image, chain, node, edge, far_image, far_chain, far, points, facets, room
            )
            m = _pass_walls(space, setting, m, room, where, which)
            length, power = _weigh(space, setting, m, room)
            write_row(table, r * keep + j, length, power, m, room)
    return table
