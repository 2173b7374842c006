"""Chains that a transmitter may reach, prepared once for all receivers: patches, and edges with patches around them.

Each row of these tables shows in some ten operations whether a receiver may get a path from it, and no row depends on
receivers. A chain of patches is an image and the window that it looks through. An edge comes with the image that it is
seen by and the patches behind it, over which receivers are mirrored rather than the edge.

Whether an edge may bend rays to a patch is decided in the half-plane of the edge, turned about it until source and
patch lie in it: the source, unfolded to the other side of the edge, looks through the edge as through a window, and a
sphere around the patch must meet what it sees (the zone between the Keller cones of the edge's ends).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_types import Planes, Point
from wireless.geometry.cones import MAX_CORNERS, PIECES
from wireless.geometry.images import cone_of, new_views, open_view
from wireless.geometry.shooting import Bent
from wireless.geometry.space import Ground, Space, may_see_line
from wireless.tracing.path_layout import edge_sight, is_open

#: How much wider windows and edges are than they can be, for what rounding does [m].
WIDER_M = 1e-6


class OpenChains(NamedTuple):
    """Chains of patches, seen from one transmitter."""

    chain: Int[np.ndarray, "c m"]
    """Patches, the first from the transmitter first; -1 beyond the last."""
    order: Int[np.ndarray, " c"]
    """Number of patches."""
    column: Float[np.ndarray, "14 c"]
    """Image, normal and level of the last patch, how far off it the image is, and a box around the window [m]."""


class SeenEdges(NamedTuple):
    """Edges that a transmitter may see, directly or over patches."""

    edge: Int[np.ndarray, " q"]
    """Edges."""
    order: Int[np.ndarray, " q"]
    """Number of patches that each is seen over."""
    over: Int[np.ndarray, "q m"]
    """Numbers of these patches, the first from the transmitter first; -1 beyond the last."""
    place: Float[np.ndarray, "q 3"]
    """Where the image is, as seen from the edge (`wireless.tracing.path_layout.edge_sight`)."""
    seen_range: Float[np.ndarray, "q 2"]
    """From where to where along the edge the image sees it, past the windows if not past what hides [m]."""


class EdgeChains(NamedTuple):
    """Edges with patches before and behind them."""

    edge: Int[np.ndarray, " q"]
    """Edges."""
    near: Int[np.ndarray, "q m"]
    """Patches before each, the first from the transmitter first; -1 beyond the last."""
    far: Int[np.ndarray, "q l"]
    """Patches behind it, the first from the receiver first; -1 beyond the last."""
    angle: Float[np.ndarray, " q"]
    """Angle of the image of the transmitter from the 0-face."""
    column: Float[np.ndarray, "9 q"]
    """The seen part of the edge, mirrored over the patches behind it: begin, direction and length; and the image: place
    along it, distance from it."""
    cover: Int[np.ndarray, " q"]
    """A triangle, in the tree's order, that last hid each from a receiver; -1 for none. Tracing writes it: no path
    depends on it."""


@compiled
def open_chains(space: Space, tx: Point, chain: Int[np.ndarray, "c m"]) -> OpenChains:
    """Chains of patches whose windows do not close."""
    max_order, count, windows = chain.shape[1], 0, space.windows
    # View k looks over the first k patches of a chain: of the next one only the views that differ are new.
    views, same = new_views(max_order + 1, max_order), 0
    spare, plane = np.empty((MAX_CORNERS, 3)), np.empty((MAX_CORNERS + 1, 4))
    used, orders, column = (
        np.empty(len(chain), np.int64),
        np.empty(len(chain), np.int64),
        np.zeros((14, len(chain))),
    )
    views.image[0, 0] = tx
    for c in range(len(chain)):
        order, shared = 0, 0
        while order < max_order and chain[c, order] >= 0:
            order += 1
        while c > 0 and shared < order and chain[c, shared] == chain[c - 1, shared]:
            shared += 1
        if shared > same:  # the patch that closed the chain before closes this one too
            continue
        same = shared
        while same < order:
            n_planes = cone_of(windows, views, same, plane)
            if not open_view(windows, views, same, chain[c, same], views, same + 1, plane, n_planes, spare):
                break
            same += 1
        if same < order:
            continue
        used[count], orders[count] = c, order
        if order > 0:
            patch, off = chain[c, order - 1], 0.0
            for i in range(3):
                normal = windows.plane[patch, i]
                off += normal * views.image[order, order, i]
                least, largest = np.inf, -np.inf
                for k in range(views.corners[order]):
                    least = min(least, views.window[order, k, i])
                    largest = max(largest, views.window[order, k, i])
                column[i, count], column[3 + i, count] = views.image[order, order, i], normal
                column[8 + i, count], column[11 + i, count] = least - WIDER_M, largest + WIDER_M
            column[6, count], column[7, count] = windows.plane[patch, 3], off - windows.plane[patch, 3]
        count += 1
    return OpenChains(chain[used[:count]], orders[:count].copy(), column[:, :count].copy())


@compiled
def place_edges(
    space: Space, tx: Point, edge: Int[np.ndarray, " q"], over: Int[np.ndarray, "q m"], occluding: bool
) -> SeenEdges:
    """The sights of some edges over some patches (-1 beyond the last) that are open to the image.

    Rows with the same chain that follow each other share its views. If `occluding`, walls hide edges from the image.
    """
    max_order, count, windows = over.shape[1], 0, space.windows
    order, place, seen_range = (
        np.empty(len(edge), np.int64),
        np.empty((len(edge), 3)),
        np.empty((len(edge), 2)),
    )
    views, same, n_planes, used = new_views(max_order + 1, max_order), 0, 0, np.empty(len(edge), np.int64)
    spare, plane = np.empty((MAX_CORNERS, 3)), np.empty((MAX_CORNERS + 1, 4))
    line, strip, piece, behind = (
        np.empty((2, 3)),
        np.empty((4, 3)),
        np.empty((PIECES, MAX_CORNERS, 3)),
        np.zeros(4),
    )
    views.image[0, 0] = tx
    for j in range(len(edge)):
        k, new = 0, j == 0
        while k < max_order and over[j, k] >= 0:
            new = new or over[j, k] != over[j - 1, k]
            k += 1
        if new or (k < max_order and over[j - 1, k] >= 0):
            same = 0
            while same <= k:
                n_planes = cone_of(windows, views, same, plane)
                if same == k or not open_view(
                    windows, views, same, over[j, same], views, same + 1, plane, n_planes, spare
                ):
                    break
                same += 1
        if same < k:
            continue
        e = edge[j]
        z, distance, angle = edge_sight(space.ground.edge, space.ground.edge_wedge, e, views.image[k, k])
        near_m = space.ground.near_m
        if distance < near_m or not is_open(space.ground.edge_gap_rad[e], distance, angle, near_m):
            continue
        low, high = _part_in(space.ground.edge[e], plane[:n_planes])
        if occluding and low <= high:
            for i in range(3):
                line[0, i] = space.ground.edge[e, 0, i] + low * space.ground.edge_wedge[e, 0, i]
                line[1, i] = space.ground.edge[e, 0, i] + high * space.ground.edge_wedge[e, 0, i]
            behind[:] = 0.0
            if n_planes > 0:
                behind[:] = plane[n_planes - 1]
            if not may_see_line(space, views.image[k, k], behind, line, strip, piece):
                continue
        if low <= high:
            used[count], order[count] = j, k
            place[count, 0], place[count, 1], place[count, 2] = z, distance, angle
            seen_range[count, 0], seen_range[count, 1] = low, high
            count += 1
    return SeenEdges(
        edge[used[:count]],
        order[:count].copy(),
        over[used[:count]],
        place[:count].copy(),
        seen_range[:count].copy(),
    )


@compiled
def _part_in(ends: Float[np.ndarray, "2 3"], plane: Planes) -> tuple[float, float]:
    """The part of an edge within planes, almost: from where to where along it; nothing if the first is farther."""
    length, low, high = 0.0, 0.0, 1.0
    for i in range(3):
        length += (ends[1, i] - ends[0, i]) ** 2
    for k in range(len(plane)):
        a, b = WIDER_M - plane[k, 3], WIDER_M - plane[k, 3]
        for i in range(3):
            a += plane[k, i] * ends[0, i]
            b += plane[k, i] * ends[1, i]
        if a < 0 and b < 0:
            return 1.0, 0.0
        if a < 0:
            low = max(low, a / (a - b))
        elif b < 0:
            high = min(high, a / (a - b))
    length = np.sqrt(length)
    return low * length, high * length


@compiled
def can_bend(
    ground: Ground,
    sights: SeenEdges,
    pairs: Int[np.ndarray, "b 2"],
    sphere: Float[np.ndarray, "p 4"],
    side: Int[np.ndarray, " p"],
) -> Bool[np.ndarray, " b"]:
    """Whether the edges of sights may bend rays to patches; rather yes than no.

    Args:
        ground: Planes of patches, and edges.
        sights: Edges, where their images are, and what these see of the edges.
        pairs: A sight and a patch each; pairs of a sight in a row.
        sphere: Centre and radius of a sphere around each patch [m].
        side: Which side of each can be reached, see `wireless.geometry.reachable_sides.Backs.seen_from`.
    """
    ends, wedge, gap, plane = ground.edge, ground.edge_wedge, ground.edge_gap_rad, ground.plane
    edge, place, seen_range = sights.edge, sights.place, sights.seen_range
    can, last, e = np.zeros(len(pairs), np.bool_), -1, 0
    z0, r0, low, high, begin, end, c, s = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for b in range(len(pairs)):
        j, p = pairs[b, 0], pairs[b, 1]
        if j != last:
            last, e, z0, r0, low, high = (
                j,
                edge[j],
                place[j, 0],
                place[j, 1],
                seen_range[j, 0],
                seen_range[j, 1],
            )
            begin, end = np.hypot(z0 - low, r0), np.hypot(z0 - high, r0)
            c, s = np.cos(gap[e]), np.sin(gap[e])
        if side[p] != 0:
            start, other = -plane[p, 3], -plane[p, 3]
            for i in range(3):
                start += plane[p, i] * (ends[e, 0, i] + low * wedge[e, 0, i])
                other += plane[p, i] * (ends[e, 0, i] + high * wedge[e, 0, i])
            if max(side[p] * start, side[p] * other) < -WIDER_M:  # all of the edge is behind the patch
                continue
        x, y, z, radius = 0.0, 0.0, 0.0, sphere[p, 3] + WIDER_M
        for i in range(3):
            d = sphere[p, i] - ends[e, 0, i]
            z += d * wedge[e, 0, i]
            x += d * wedge[e, 1, i]
            y += d * wedge[e, 2, i]
        if y < -radius and c * y - s * x > radius:  # inside of the wedge
            continue
        distance = np.sqrt(x * x + y * y)
        if r0 * (z - low) + (z0 - low) * distance < -radius * begin:
            continue
        can[b] = r0 * (z - high) + (z0 - high) * distance <= radius * end
    return can


def make_edge_chains(space: Space, sights: SeenEdges, behind: list[Bent]) -> EdgeChains:
    """Edges of all sights, without patches behind them, and with some."""
    sight = np.concatenate([np.arange(len(sights.edge)), *(bent.sight for bent in behind)])
    far = np.full((len(sight), max([1, *(bent.chain.shape[1] for bent in behind)])), -1, np.int64)
    row = len(sights.edge)
    for bent in behind:
        far[row : row + len(bent.sight), : bent.chain.shape[1]] = bent.chain[:, ::-1]
        row += len(bent.sight)
    edge, place, seen_range = sights.edge[sight], sights.place[sight], sights.seen_range[sight]
    along = space.ground.edge_wedge[edge, 0]
    begin = space.ground.edge[edge, 0] + seen_range[:, :1] * along
    for patch in far.T[::-1]:  # the patch next to the edge comes first
        with_patch = np.flatnonzero(patch >= 0)
        normal, level = space.panes.plane[patch[with_patch], :3], space.panes.plane[patch[with_patch], 3]
        off = np.einsum("qi,qi->q", begin[with_patch], normal) - level
        begin[with_patch] -= 2 * off[:, None] * normal
        along[with_patch] -= 2 * np.einsum("qi,qi->q", along[with_patch], normal)[:, None] * normal
    return EdgeChains(
        edge=edge,
        near=sights.over[sight],
        far=far,
        angle=place[:, 2].copy(),
        column=np.ascontiguousarray(
            np.column_stack(
                [
                    begin,
                    along,
                    seen_range[:, 1] - seen_range[:, 0],
                    place[:, 0] - seen_range[:, 0],
                    place[:, 1],
                ]
            ).T
        ),
        cover=np.full(len(edge), -1),
    )
