"""Paint, floors, skirtings, windows and door frames of rooms, from a seed.

All of it is colour of patches that exist anyway: no surface is added, so that depth, lidar, collision and radio do not
change.

- Rooms are what is left of the free floor once necks narrower than a double door are closed, grown back over it; floor
  that is narrower everywhere, the same with a door's width. Each has a paint of its own, and a floor of boards, tiles
  or carpet.
- Windows are in walls behind which nothing is free: glass from the skirting to the ceiling, some 1.2 m wide, every
  2.4 m, in most of such walls that are long enough.
- Door frames are the short ends of walls, both of whose corners stick out into free space, if another wall is as far
  across as a door is wide.

Rooms and walls are numbered along the plan: the same building looks the same wherever it lies.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.building.extrusion import CEILING, FLOOR, WALL
from robosim.camera.rendering.tessellation import Patches
from robosim.plans.floorplan import FloorPlan

#: Floors: boards, tiles, carpet; their colours, and the share by which the pieces of each differ in tone.
_BOARDS, _TILES, _CARPET = range(3)
_FLOORS = np.array([(166, 130, 94), (178, 174, 166), (134, 134, 138)], float)
_SWING = np.array([0.13, 0.05, 0.02])
_PAINTS = np.array(
    [
        (226, 218, 202), (198, 208, 206), (214, 214, 192), (224, 204, 186), (206, 204, 214), (190, 204, 188),
        (232, 228, 220), (216, 192, 178),
    ],
    float,
)  # fmt: skip
_SKIRTINGS = np.array([(112, 92, 76), (236, 234, 228), (90, 84, 80)], float)
_FRAME = np.array([150, 112, 76], float)
_CEILING = np.array([238, 238, 234], float)
GLASS = np.array([226, 238, 250], float)
#: Necks narrower than this separate rooms [m], wide ones first; smaller rooms than this have tiles [m2].
_NECKS_M, _SMALL_M2 = (1.3, 0.8), 7.0
#: Ends of walls up to this width are door frames [m], and doors so wide [m].
_JAMB_M, _DOOR_M = 0.35, (0.55, 1.4)
#: Distance of windows along a wall, their width, and the shortest wall that has any [m].
_EVERY_M, _WIDE_M, _LEAST_M = 2.4, 1.25, 1.6
#: Behind a wall with windows nothing is free for this distance [m]; share of such walls that have windows.
_OUTSIDE_M = 3.0
_GLAZED = 0.8
# Multipliers of a hash; large odd numbers without a pattern.
_ODD = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F], np.uint64)


class Decor:
    """Colours of the surfaces of a building."""

    def __init__(self, plan: FloorPlan, patches: Patches, seed: int) -> None:
        """Find rooms, windows and frames of the building of a plan, given the patches of its surfaces."""
        self._patches = patches
        rooms = _rooms(plan)
        # A little into the patch and away from it: a vertex in a corner belongs to the room that the patch is in.
        inside = patches.vertices + 0.05 * patches.inward + 0.1 * patches.normals
        column, row = np.floor(plan.to_cells(inside[:, :2])).astype(int).T
        self._room = rooms[np.clip(row, 0, plan.shape[0] - 1), np.clip(column, 0, plan.shape[1] - 1)]
        area_m2 = np.bincount(rooms.ravel()) * plan.resolution_m**2
        number = np.arange(len(area_m2))
        self._floor = np.where(area_m2 < _SMALL_M2, _TILES, _pick(number, seed, 1, 3))
        self._paint = _PAINTS[_pick(number, seed, 2, len(_PAINTS))]
        self._skirting = _SKIRTINGS[_pick(number, seed, 3, len(_SKIRTINGS))]
        walls = _Walls(patches)
        high = patches.row[walls.patch[:, 0]] > 0
        #: Patches that are windows, by their vertices from the lower left one.
        self.windows = walls.patch[_glass(plan, walls, seed) & high]
        self._jambs = walls.patch[walls.juts & (walls.length_m <= _JAMB_M) & _across_a_door(plan, walls)]

    def albedo(self) -> Float[np.ndarray, "n 3"]:
        """Colour of each vertex before light falls on it; that of furniture is left grey."""
        p, room = self._patches, self._room
        colours = np.full((len(p.vertices), 3), 128.0)
        wall, floor = p.kind == WALL, p.kind == FLOOR
        kind = self._floor[room]
        colours[floor] = _FLOORS[kind[floor]] * (1 + (_SWING[kind] * self._pieces(kind))[floor, None])
        colours[p.kind == CEILING] = _CEILING
        colours[wall] = self._paint[room[wall]] * (1 + 0.012 * tone(p.cell[wall]))[:, None]
        skirting = wall & (p.row == 0)
        colours[skirting] = self._skirting[room[skirting]]
        colours[self._jambs.ravel()] = _FRAME
        colours[self.windows.ravel()] = GLASS
        return colours

    def _pieces(self, kind: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Tones of a floor's pieces, -1 to 1: boards along rows of the grid, alternating tiles, uniform carpet."""
        cell = self._patches.cell
        boards = tone(np.column_stack([cell[:, 1], cell[:, 0] // 4 + 7 * cell[:, 1]]))
        tiles = 1.0 - 2.0 * (cell.sum(axis=1) % 2) + 0.3 * tone(cell)
        return np.choose(kind, [boards, tiles, tone(cell)])


def tone(cell: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    """A number from -1 to 1 for each square of a grid, without a visible pattern."""
    mixed = (cell.astype(np.uint64) * _ODD).sum(axis=1)
    mixed ^= mixed >> np.uint64(29)
    mixed *= np.uint64(0xBF58476D1CE4E5B9)
    return (mixed >> np.uint64(40)) / 2.0**23 - 1.0


def _pick(number: Int[np.ndarray, " n"], seed: int, what: int, count: int) -> Int[np.ndarray, " n"]:
    """A choice among `count` for each number, by the seed and what is chosen."""
    drawn = tone(np.column_stack([number, np.full(len(number), 16 * seed + what)]))
    return np.minimum(((drawn + 1) / 2 * count).astype(int), count - 1)


def _rooms(plan: FloorPlan) -> Int[np.ndarray, "ny nx"]:
    """Number of the room of each cell; cells that are no floor have that of the nearest room."""
    free = np.pad(plan.free, 1).astype(np.uint8)  # nothing is free beyond the plan
    away = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    label = np.zeros(free.shape, np.int32)
    for neck_m in _NECKS_M:
        # Parts that hold no room yet are rooms themselves: closets and corridors.
        count, part = cv2.connectedComponents((away > 0.5 * neck_m / plan.resolution_m).astype(np.uint8))
        holds = np.zeros(count, bool)
        holds[part[label > 0]] = True
        new = (label == 0) & ~holds[part] & (part > 0)
        label[new] = part[new] + label.max()
    del away, part, new  # grids of large buildings take much of the memory
    label = label.astype(np.float32)  # as OpenCV dilates
    while True:
        around = cv2.dilate(label, np.ones((3, 3)))
        grows = (label == 0) & (free > 0) & (around > 0)
        if not grows.any():
            break
        label[grows] = around[grows]
    del around, grows
    label = label.astype(np.int32)
    # Floor that is narrow everywhere.
    _, corner = cv2.connectedComponents(((label == 0) & (free > 0)).astype(np.uint8))
    label += np.where(corner > 0, corner + label.max(), 0)  # it is 0 there
    del corner
    if not label.any():
        return np.zeros(plan.shape, int)
    is_room = label > 0
    unknown = (~is_room).astype(np.uint8)
    nearest = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)[1]
    label -= 1
    room_of = np.zeros(nearest.max() + 1, np.int32)
    room_of[nearest[is_room]] = label[is_room]
    del label
    return room_of[nearest][1:-1, 1:-1]


class _Walls:
    """Walls, derived from their patches."""

    def __init__(self, patches: Patches) -> None:
        upright = np.flatnonzero(patches.kind == WALL)
        #: Corners of each patch of a wall, from the lower left one, as seen from free space.
        self.patch = upright.reshape(-1, 4)
        walls, self.number = np.unique(patches.source[self.patch[:, 0]], return_inverse=True)
        self.normal = patches.normals[self.patch[:, 0], :2]
        along = np.column_stack([-self.normal[:, 1], self.normal[:, 0]])
        self.middle = patches.vertices[self.patch, :2].mean(axis=1)
        feet = patches.vertices[self.patch[:, :2], :2]
        left, right = ((feet[:, k] * along).sum(axis=1) for k in (0, 1))
        low, high = np.full(len(walls), np.inf), np.full(len(walls), -np.inf)
        np.minimum.at(low, self.number, left)
        np.maximum.at(high, self.number, right)
        self.length_m = (high - low)[self.number]
        #: Distance of a patch's middle from that of its wall [m].
        self.from_middle_m = 0.5 * (left + right) - 0.5 * (low + high)[self.number]
        ends = np.empty((len(walls), 2, 2))  # left and right end of each wall (x, y) [m]
        first, last = left == low[self.number], right == high[self.number]
        ends[self.number[first], 0], ends[self.number[last], 1] = feet[first, 0], feet[last, 1]
        self.juts = _juts(ends)[self.number] if len(walls) else np.zeros(0, bool)


def _juts(ends: Float[np.ndarray, "n 2 2"]) -> Bool[np.ndarray, " n"]:
    """Walls both of whose corners stick out into free space: from left to right they turn left there."""
    along = ends[:, 1] - ends[:, 0]
    (start, end) = (np.round(ends[:, k], 6) @ (1, 1j) for k in (0, 1))
    order = np.argsort(start)
    place = np.minimum(np.searchsorted(start[order], end), len(order) - 1)
    following = order[place]
    meet = start[following] == end
    other = along[following]
    left = meet & (along[:, 0] * other[:, 1] - along[:, 1] * other[:, 0] > 0)
    before = np.zeros(len(ends), bool)
    before[following[left]] = True
    return left & before


def _free_at(plan: FloorPlan, points: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    """Whether points of `map` [m] lie in free cells; beyond the plan nothing is free."""
    column, row = np.floor(plan.to_cells(points)).astype(int).T
    ny, nx = plan.shape
    inside = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
    found = np.zeros(len(points), bool)
    found[inside] = plan.free[row[inside], column[inside]]
    return found


def _across_a_door(plan: FloorPlan, walls: _Walls) -> Bool[np.ndarray, " m"]:
    """Patches of walls that face another wall as far off as a door is wide."""
    open_m = np.full(len(walls.patch), np.inf)
    for far_m in np.arange(2 * plan.resolution_m, _DOOR_M[1] + 2 * plan.resolution_m, plan.resolution_m):
        ends = ~_free_at(plan, walls.middle + far_m * walls.normal)
        open_m[ends] = np.minimum(open_m[ends], far_m)
    return (open_m >= _DOOR_M[0]) & (open_m <= _DOOR_M[1])


def _glass(plan: FloorPlan, walls: _Walls, seed: int) -> Bool[np.ndarray, " m"]:
    """Which patches of walls are windows."""
    outside = np.ones(len(walls.patch), bool)
    for far_m in np.arange(0.15, _OUTSIDE_M, 2 * plan.resolution_m):
        outside &= ~_free_at(plan, walls.middle - far_m * walls.normal)
    # Windows stand evenly about the middle of a wall.
    turns = walls.from_middle_m / _EVERY_M
    opened = np.abs(turns - np.round(turns)) * _EVERY_M <= 0.5 * _WIDE_M
    glazed: Bool[np.ndarray, " m"] = _pick(walls.number, seed, 4, 100) < 100 * _GLAZED
    return outside & opened & glazed & (walls.length_m >= _LEAST_M)
