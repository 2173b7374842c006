"""Rooms and passages of a floor plan: a watershed of the clearance.

The clearance of a point is its distance to the nearest wall. Rooms are its hills, doors the saddles between
them: a flood that sinks from the hill tops makes one basin a top, and where two basins meet, the saddle gives
the width of the passage, twice its clearance. Two basins are one room where that passage is nearly as wide as
the smaller of them, wider than any door, or where one of them is too small for a room. Furniture that
stands free is looked through when basins are drawn, so that a table does not divide a dining room, but not
when widths are measured.

Left out: a door and an equally narrow gap between a bed and a wardrobe look the same.

References: Fabrizi and Saffiotti, "Extracting topology-based maps from gridmaps", ICRA 2000 (watershed of the
clearance); Bormann et al., "Room segmentation: survey, implementation, and analysis", ICRA 2016 (comparison
of methods; segmentation by distance transform).
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float, Int32

from robosim.generator.generate import distance_m, hull_places, largest_piece
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan

#: Basins whose passage is at least this share of the smaller one's width are one room.
SAME_ROOM_RATIO = 0.8
#: Passages wider than this join what they connect to one room [m].
WIDEST_DOOR_M = 1.8
#: Smaller basins are alcoves, not rooms [m2].
SMALLEST_ROOM_M2 = 1.0
#: Longer islands in the free area are walls or closed rooms, not furniture [m].
LONGEST_FURNITURE_M = 2.8

_LEVEL_M = 0.025


@dataclass(frozen=True, kw_only=True, eq=False)
class Rooms:
    """The rooms of a plan and the passages between them."""

    labels: Int32[np.ndarray, "ny nx"]
    """Room of each cell, from 1; 0 where the hull's centre cannot be."""
    passages: Int32[np.ndarray, "n 2"]
    """The two rooms that each passage joins; rooms with two doors between them occur twice."""
    width_m: Float[np.ndarray, " n"]
    """Clear width of each passage, between walls [m]."""

    @property
    def count(self) -> int:
        """Number of rooms."""
        return int(self.labels.max())

    @property
    def bottleneck_m(self) -> float:
        """Narrowest passage that cannot be avoided between some two rooms [m]; inf for one room.

        It is the narrowest edge of the maximum spanning tree over the passages.
        """
        root = np.arange(self.count + 1)
        narrowest = np.inf
        for i in np.argsort(-self.width_m, kind="stable"):
            a, b = root[self.passages[i]]
            if a != b:
                root[root == b] = a
                narrowest = float(self.width_m[i])
        return narrowest


def clearance(plan: FloorPlan) -> Float[np.ndarray, "ny nx"]:
    """Distance [m] to walls from the best placed point in each cell; 0 in cells that are not free.

    Taken on the lattice of cell centres, corners and edge middles, on which the distance to walls that run
    along cell edges is exact, so that twice the clearance is the width of a passage of odd or even cells.
    """
    best = cv2.dilate(distance_m(plan), np.ones((3, 3), np.uint8))[1::2, 1::2]
    return np.where(plan.free, best, 0.0)


def find_rooms(plan: FloorPlan, hull_radius_m: float) -> Rooms:
    """Rooms that a round hull can reach, and the passages between them.

    Args:
        plan: The floor plan.
        hull_radius_m: Radius of the hull [m]; passages narrower than twice that do not count.

    Raises:
        ValueError: If the hull fits nowhere.
    """
    inside = largest_piece(hull_places(plan, hull_radius_m))
    bare = replace(plan, occupancy=np.where(_without_furniture(plan), FREE, OCCUPIED).astype(np.uint8))
    labels = _flood(clearance(bare), plan.resolution_m)
    _, labels = np.unique(np.where(inside, labels, 0), return_inverse=True)
    labels = labels.reshape(plan.shape).astype(np.int32)
    if inside.all():
        labels += 1
    pairs, width_m = _passages(labels, clearance(plan))
    return Rooms(labels=labels, passages=pairs, width_m=width_m)


def _without_furniture(plan: FloorPlan) -> np.ndarray:
    """Free cells, with islands short enough for furniture taken away."""
    solid = np.pad(~plan.free, 1, constant_values=True)
    n, pieces, stats, _ = cv2.connectedComponentsWithStats(solid.astype(np.uint8), connectivity=8)
    for piece in range(1, n):
        left, top, width, height = stats[piece, : cv2.CC_STAT_AREA]
        window = np.s_[top : top + height, left : left + width]
        if piece == pieces[0, 0] or max(width, height) * plan.resolution_m > LONGEST_FURNITURE_M:
            continue
        cells = np.argwhere(pieces[window] == piece).astype(np.float32)
        _, sides, _ = cv2.minAreaRect(cells)  # from centre to centre
        if (max(sides) + 1) * plan.resolution_m <= LONGEST_FURNITURE_M:
            solid[window][pieces[window] == piece] = False
    return ~solid[1:-1, 1:-1]


def _flood(clearance_m: np.ndarray, resolution_m: float) -> np.ndarray:
    """Basins of the clearance, int32 labels from 1, merged where they are one room."""
    labels = np.zeros(clearance_m.shape, np.int32)
    peak_m = [np.inf]  # clearance of the highest point of each basin, by label
    apart: set[tuple[int, int]] = set()  # basins that have met and are different rooms
    for level_m in np.arange(clearance_m.max(), 0, -_LEVEL_M):
        above = clearance_m >= level_m
        peak_m += [level_m] * _add_basins(labels, above)
        _spread(labels, above)
        while met := _neighbours(labels) - apart:
            a, b = min(met)
            lower, higher = (a, b) if peak_m[a] < peak_m[b] else (b, a)
            if 2 * level_m > WIDEST_DOOR_M or level_m >= SAME_ROOM_RATIO * peak_m[lower]:
                apart = _merge(labels, apart, lower, higher)
            else:
                apart.add((a, b))
    return _without_alcoves(labels, clearance_m, round(SMALLEST_ROOM_M2 / resolution_m**2))


def _add_basins(labels: np.ndarray, above: np.ndarray) -> int:
    """Label the pieces of `above` that hold no basin yet; returns how many there were."""
    n, pieces = cv2.connectedComponents(above.astype(np.uint8), connectivity=4)
    fresh = np.ones(n, bool)
    fresh[pieces[labels > 0]] = False
    fresh[0] = False
    number = np.where(fresh, labels.max() + np.cumsum(fresh), 0).astype(np.int32)
    labels += number[pieces]
    return int(fresh.sum())


def _spread(labels: np.ndarray, above: np.ndarray) -> None:
    """Let the basins grow at equal speed over all of `above`."""
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    wave = labels.astype(np.float32)  # cv2 dilates no int32; labels are small and exact in float32
    dry = above & (labels == 0)
    while dry.any():
        grown = cv2.dilate(wave, cross)
        wave[dry] = grown[dry]
        dry &= wave == 0
    labels[:] = wave


def _neighbours(labels: np.ndarray) -> set[tuple[int, int]]:
    """Pairs (smaller, larger) of labels that share a cell edge."""
    return {(int(a), int(b)) for a, b in np.unique(_borders(labels)[0], axis=0)}


def _borders(labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each cell edge between two labels: (n, 2) sorted labels, and (n, 2) flat indices of the two cells."""
    index = np.arange(labels.size).reshape(labels.shape)
    cells = []
    for here, there in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        a, b = labels[here], labels[there]
        border = (a != b) & (a > 0) & (b > 0)
        cells.append(np.column_stack([index[here][border], index[there][border]]))
    edges = np.concatenate(cells)
    return np.sort(labels.ravel()[edges], axis=1), edges


def _merge(labels: np.ndarray, apart: set[tuple[int, int]], old: int, new: int) -> set[tuple[int, int]]:
    """Give the cells of `old` to `new`, and its neighbours in `apart`, which is returned."""
    labels[labels == old] = new
    pairs = {tuple(sorted(new if room == old else room for room in pair)) for pair in apart}
    return {(a, b) for a, b in pairs if a != b}


def _without_alcoves(labels: np.ndarray, clearance_m: np.ndarray, smallest: int) -> np.ndarray:
    """Join rooms of fewer than `smallest` cells, smallest first, to the neighbour with the widest passage."""
    lonely: set[int] = set()
    while True:
        sizes = np.bincount(labels.ravel())
        small = [
            int(r) for r in np.argsort(sizes, kind="stable") if 0 < sizes[r] < smallest and r not in lonely
        ]
        small = [room for room in small if room > 0]
        if not small:
            return labels
        pairs, width_m = _passages(labels, clearance_m)
        own = (pairs == small[0]).any(axis=1)
        if not own.any():
            lonely.add(small[0])
            continue
        a, b = pairs[own][np.argmax(width_m[own])]
        labels[labels == small[0]] = b if a == small[0] else a


def _passages(labels: np.ndarray, clearance_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Openings between rooms: (n, 2) rooms, and (n,) widths [m], one for each unbroken stretch of border."""
    pairs, cells = _borders(labels)
    width_m = 2 * clearance_m.ravel()[cells].min(axis=1)
    found: list[tuple[int, int]] = []
    widths: list[float] = []
    for a, b in sorted({(int(a), int(b)) for a, b in pairs}):
        here = (pairs[:, 0] == a) & (pairs[:, 1] == b)
        border = np.zeros(labels.shape, np.uint8)
        border.ravel()[cells[here]] = 1
        n, pieces = cv2.connectedComponents(border, connectivity=8)
        piece = pieces.ravel()[cells[here, 0]]
        found += [(a, b)] * (n - 1)
        widths += [float(width_m[here][piece == k].max()) for k in range(1, n)]
    return np.array(found, np.int32).reshape(-1, 2), np.array(widths)
