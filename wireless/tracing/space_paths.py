"""Paths in space: line of sight of each leg, power, and entry into a link's list.

It is laid out before (`wireless.tracing.path_layout`). No leg may pass more walls than are left to pass.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from wireless.em.fields import DIFFRACTION, REFLECTION, TRANSMISSION
from wireless.em.fresnel import fresnel
from wireless.geometry.array_types import Point
from wireless.geometry.occlusion import (
    FREE,
    HIDDEN,
    TOUCHED,
    Tree,
    crosses,
    is_hidden,
    sight,
    sight_along,
    walls_between,
)
from wireless.geometry.space import Ground, Space, aside_m
from wireless.geometry.tolerance import NEAR_M
from wireless.tracing.path_layout import Chain, Layout, images_over, is_on_large, lay_out, reflects_to
from wireless.tracing.table import (
    Best,
    Scratch,
    Setting,
    Table,
    list_path,
    make_scratch,
    make_table,
    most_interactions,
    weigh,
    write_row,
)

#: At how many places around a target a path is looked for that is free.
_TURNS = 16


class Links(NamedTuple):
    """Links of one transmitter, and their strongest paths so far, see `wireless.tracing.table.Best`."""

    tx: Float[np.ndarray, "3"]
    """Transmitter, around the space's origin [m]."""
    rx: Float[np.ndarray, "r 3"]
    """Receivers."""
    ends: Float[np.ndarray, "r 2 3"]
    """Transmitter and receiver, for each receiver."""
    rank: Float[np.ndarray, "r k 5"]
    parts: Int[np.ndarray, "r k w"]
    """Edge (-1 for none), numbers of patches before and behind it, and these, the first from either end first."""
    n_paths: Int[np.ndarray, " r"]
    """Number of paths of each."""


class Link(NamedTuple):
    """A link of `Links`."""

    ends: Float[np.ndarray, "2 3"]
    """Transmitter and receiver."""
    best: Best


class Workspace(NamedTuple):
    """Arrays to work in."""

    scratch: Scratch
    layout: Layout
    """Shares the path of `scratch`."""
    parts: Int[np.ndarray, " w"]
    """Edge and patches of the path, see `Links`."""
    share: Float[np.ndarray, " k"]
    """Walls that a leg passes: shares of the leg."""
    triangle: Int[np.ndarray, " k"]
    """Their triangles."""


@compiled
def make_workspace(setting: Setting) -> Workspace:
    """Arrays to work in."""
    n_max, scratch, through = most_interactions(setting), make_scratch(setting), setting.max_through
    layout = Layout(scratch.point, scratch.kind, scratch.primitive, np.empty((n_max, 3)))
    parts = np.zeros(3 + n_max, np.int64)
    return Workspace(scratch, layout, parts, np.empty(through), np.empty(through, np.int64))


@compiled
def make_links(setting: Setting, tx: Point, rx: Float[np.ndarray, "r 3"]) -> Links:
    """Links with no path in their lists."""
    rank = np.empty((len(rx), setting.keep, 5))
    parts = np.empty((len(rx), setting.keep, 3 + most_interactions(setting)), np.int64)
    ends = np.empty((len(rx), 2, 3))
    ends[:, 0], ends[:, 1] = tx, rx
    return Links(tx, rx, ends, rank, parts, np.zeros(len(rx), np.int64))


@compiled
def link_of(links: Links, r: int) -> Link:
    """The link to one receiver."""
    return Link(links.ends[r], Best(links.rank[r], links.parts[r]))


@compiled
def weigh_path(ground: Ground, setting: Setting, m: int, scratch: Scratch) -> tuple[float, float]:
    """Length and power of the path in `scratch`, gain set; length -1 if it is none."""
    n = 1.0
    for j in range(m):
        primitive = scratch.primitive[j]
        if scratch.kind[j] != DIFFRACTION:
            for i in range(3):
                scratch.normal[j, i] = ground.facet_normal[primitive, i]
            for i in range(setting.walls.shape[1]):
                scratch.walls[j, i] = setting.walls[primitive, i]
        else:
            for i in range(3):
                for k in range(3):
                    scratch.wedge[i, k] = ground.edge_wedge[primitive, i, k]
            n = ground.edge_gap_rad[primitive] / np.pi
            for i in range(2):
                for k in range(setting.walls.shape[1]):
                    scratch.wedge_walls[i, k] = setting.walls[ground.edge_facets[primitive, i], k]
    return weigh(setting, m, n, scratch)


@compiled
def left_by_mirrors(
    facet_normal: Float[np.ndarray, "f 3"], setting: Setting, m: int, scratch: Scratch
) -> float:
    """Most of the power of the path in `scratch` that its reflections leave, of the better polarisation at each."""
    power, point = 1.0, scratch.point
    for j in range(m):
        if scratch.kind[j] != REFLECTION:
            continue
        primitive, size, off = scratch.primitive[j], 0.0, 0.0
        for i in range(3):
            step = point[j + 1, i] - point[j, i]
            size += step * step
            off += step * facet_normal[primitive, i]
        if size < NEAR_M**2:  # in a corner, from another reflection in the same point
            continue
        cos_i = min(abs(off) / np.sqrt(size), 1.0)
        te, tm, _, _ = fresnel(cos_i, setting.walls[primitive], setting.wavenumber)
        power *= max(abs(te), abs(tm)) ** 2
    return 1.0001 * power


@compiled
def pass_walls(space: Space, setting: Setting, m: int, work: Workspace) -> int:
    """Put the walls between the points of a path into it; its new number of interactions, -1 if it is hidden."""
    scratch, share, triangle = work.scratch, work.share, work.triangle
    left = setting.max_through
    leg, end = 0, m
    while leg <= end:
        p, q = scratch.point[leg].copy(), scratch.point[leg + 1].copy()
        if left == 0:
            if is_hidden(space.tree, p, q):
                return -1
            leg += 1
            continue
        n = walls_between(space.tree, p, q, space.tree_passes, left, share, triangle)
        if n < 0:
            return -1
        for j in range(end + 1, leg, -1):
            scratch.point[j + n] = scratch.point[j]
        for j in range(end - 1, leg - 1, -1):
            scratch.kind[j + n], scratch.primitive[j + n] = scratch.kind[j], scratch.primitive[j]
        for j in range(n):
            for i in range(3):
                scratch.point[leg + 1 + j, i] = p[i] + share[j] * (q[i] - p[i])
            scratch.kind[leg + j] = TRANSMISSION
            scratch.primitive[leg + j] = space.surfaces.triangle_facet[space.tree.number[triangle[j]]]
        left, end, leg = left - n, end + n, leg + n + 1
    return end


@compiled
def path_sight(tree: Tree, m: int, point: Float[np.ndarray, "m2 3"], kind: Int[np.ndarray, " m"]) -> int:
    """`HIDDEN`, `FREE`, or `TOUCHED` if it depends on what side of a tie a path of m interactions is taken to be."""
    sight = sight_along(tree, point, m + 1)
    for j in range(m):
        if sight == FREE and kind[j] == REFLECTION:
            sight = _turn(tree, point[j], point[j + 1], point[j + 2])
    return sight


@compiled
def _turn(tree: Tree, p: Point, at: Point, q: Point) -> int:
    """`TOUCHED` if a reflection is in a corner: at a point of another wall, or of the next reflection."""
    step = 0.0
    for i in range(3):
        step += abs(q[i] - at[i])
    return TOUCHED if step < 10 * tree.near_m or crosses(tree, p, at, q) else FREE


@compiled
def _is_limit(
    space: Space, source: Point, patch: Int[np.ndarray, " m"], target: Point, points: Float[np.ndarray, "m 3"]
) -> bool:
    """Whether a path over patches, which meets sides of others, is free to some place next to its target."""
    chain = images_over(space.panes.plane, source, patch)
    image, order = chain.image, chain.order
    along, across, other, place = np.empty(3), np.zeros(3), np.empty(3), np.empty(3)
    size, least = 0.0, 0
    for i in range(3):
        along[i] = target[i] - image[order, i]
        size += along[i] ** 2
    along /= np.sqrt(size)
    if not reflects_to(space, chain, target, points):
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
        # Before the target too: it may lie on a wall.
        place[:] = target + aside_m(space.tree.near_m) * (c * across + s * other - 10 * along)
        if not reflects_to(space, chain, place, points):
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
def enter_laid(
    space: Space,
    setting: Setting,
    link: Link,
    chains: tuple[Chain, int, Chain],
    m: int,
    large: bool,
    work: Workspace,
    count: int,
) -> int:
    """Enter the path that is laid out in `work` into a link's list, unless it is hidden; the list's new length.

    Args:
        space: Surfaces.
        setting: Physics and limits.
        link: Ends, and paths so far.
        chains: Patches from the transmitter, the edge (-1 for none), and patches from the receiver.
        m: Number of interactions.
        large: Whether `is_on_large` has to be checked.
        work: The path.
        count: Length of the list.
    """
    near, edge, far = chains
    seen, layout = FREE, work.layout
    if setting.max_through == 0:  # most paths are hidden, which is found sooner than how strong they would be
        seen = path_sight(space.tree, m, layout.point, layout.kind)
    if seen == HIDDEN or (large and not is_on_large(space, near, edge, far, layout.point)):
        return count
    name_path(work.parts, near, edge, far)
    return try_path(space, setting, link, m, work, count, (-1.0, 0.0), seen)


@compiled
def name_path(parts: Int[np.ndarray, " w"], near: Chain, edge: int, far: Chain) -> None:
    """Put what a path is made of into `parts`: edge, numbers of patches before and behind it, and these."""
    before, after = near.order, far.order
    parts[0], parts[1], parts[2] = edge, before, after
    for i in range(before):
        parts[3 + i] = near.patch[i]
    for i in range(after):
        parts[3 + before + i] = far.patch[i]


@compiled
def try_path(
    space: Space,
    setting: Setting,
    link: Link,
    m: int,
    work: Workspace,
    count: int,
    weighed: tuple[float, float],
    seen: int,
) -> int:
    """Enter the path in `work` into a link's list, unless too many walls are in between; the list's new length.

    Args:
        space: Surfaces.
        setting: Physics and limits.
        link: Ends, and paths so far.
        m: Number of the path's interactions.
        work: The path, and what it is made of.
        count: Length of the list.
        weighed: Its length and power; length -1 if these are yet to be found.
        seen: `FREE`, or `TOUCHED` (see `path_sight`); `FREE` where walls may be passed.
    """
    ground, scratch, rank, bare, (length, power) = space.ground, work.scratch, link.best.rank, m, weighed
    if length < 0:
        length, power = weigh_path(ground, setting, m, scratch)
        if length < 0 or (count == len(rank) and power <= rank[count - 1, 0]):
            return count
    if setting.max_through > 0:
        m = pass_walls(space, setting, m, work)
    if m < 0 or m > setting.max_met:
        return count
    if m > bare:
        length, power = weigh_path(ground, setting, m, scratch)
        if length < 0 or (count == len(rank) and power <= rank[count - 1, 0]):
            return count
    if seen == TOUCHED and not _is_seen(space, link.ends, work):
        return count
    number = 1000 * m + (500 if work.parts[0] >= 0 else 0)
    return list_path(link.best, count, work.parts, length, power, m, number, scratch.point)


@compiled
def _is_seen(space: Space, ends: Float[np.ndarray, "2 3"], work: Workspace) -> bool:
    """Whether a path that touches walls counts as seen: as in floor plans, from either end to the edge, or to rx."""
    parts, points = work.parts, work.layout.back
    edge, before, after = parts[0], parts[1], parts[2]
    near, far = parts[3 : 3 + before], parts[3 + before : 3 + before + after]
    target = work.scratch.point[before + 1].copy()
    return _is_limit(space, ends[0], near, target, points) and (
        edge < 0 or _is_limit(space, ends[1], far, target, points)
    )


@compiled
def table_of(space: Space, setting: Setting, links: Links, work: Workspace) -> Table:
    """The table of each link's list, whose paths are laid out and weighed once more."""
    scratch, ground, row = work.scratch, space.ground, 0
    table = make_table(setting, len(links.rx), links.n_paths.sum())
    table.n_paths[:] = links.n_paths
    for r in range(len(links.rx)):
        ends = links.ends[r]
        for j in range(links.n_paths[r]):
            parts = links.parts[r, j]
            edge, before, after = parts[0], parts[1], parts[2]
            near = images_over(ground.plane, ends[0], parts[3 : 3 + before])
            far = images_over(ground.plane, ends[1], parts[3 + before : 3 + before + after])
            m, _ = lay_out(ground, ends, near, edge, far, work.layout)
            if setting.max_through > 0:
                m = pass_walls(space, setting, m, work)
            length, power = weigh_path(ground, setting, m, scratch)
            write_row(setting, table, row, length, power, m, scratch)
            row += 1
    return table
