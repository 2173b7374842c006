"""Search over sequences of actions, for hulls that are no disks.

A polygon passes a narrow door only from the right place and at the right heading, so that a turn and a straight run do
not suffice. Nodes are the poses that whole actions lead to; of those in one cell of place and heading the first is
used. A node costs its actions, and more where they pass close to obstacles; the rest is estimated by the planner's
field, which knows walls but no headings. The search ends at a node from which the rest is shorter by a horizon.

Left out: everything beyond the horizon, and turns that the field does not foresee.
Reference: hybrid A* of Dolgov, Thrun, Montemerlo and Diebel, Path planning for autonomous vehicles in unknown
semi-structured environments, IJRR 29(5), 2010.
"""

import heapq
import math

import numpy as np
from jaxtyping import Float

from robosim.support.compiled import compiled
from slam.actions import MOVES, Action
from slam.control.manoeuvre import PARTS
from slam.hull import Hull
from slam.planning.clearance import Clearance, Surfaces, gap_of_outline
from slam.planning.travel_time import TravelTime
from slam.poses import compose

#: Sides of a cell of place [m] and of heading [turns], and half the side of the region searched [m].
_CELL_M, _PER_TURN, _REGION_M = 0.02, 2, 3.5
#: Nodes that are looked at before the best so far has to do.
_MOST = 30_000
#: Decisions by which the rest of the path must become shorter, and the rest at which the path ends.
_HORIZON, _END = 8.0, 1.0
#: How much the rest counts: more finds a sequence sooner, less a shorter one.
_GREED = 1.5
#: Space around the hull above which nothing is added [m], what is added without any [decisions], and the least [m].
_WIDE_M, _TIGHT, LEAST_M = 0.05, 2.0, -0.005
#: Additional cost of a step back [decisions].
_BACK = 4.0


def find_actions(
    pose: Float[np.ndarray, "3"],
    motion: Float[np.ndarray, "4 3"],
    hull: Hull,
    clearance: Clearance,
    field: TravelTime,
    *,
    forward_m: float,
) -> list[Action]:
    """Actions that bring a polygon forward along its path; none if it cannot get any further.

    Args:
        pose: Where the robot stands: x [m], y [m], yaw [rad].
        motion: What each action does, in the order of `Action`: x, y [m], yaw [rad].
        hull: Hull with an outline.
        clearance: Distances to obstacles around.
        field: Cost to the goal.
        forward_m: Length of a step forward, in which costs are counted [m].
    """
    (x, y), cell_m = field.frame.origin_xy, field.frame.resolution_m
    grid = float(x), float(y), float(cell_m)
    numbers = _search(pose, motion, hull.corners, clearance.surfaces, field.cost_m / forward_m, grid)
    return [MOVES[k] for k in numbers]


def is_clear(
    pose: Float[np.ndarray, "3"],
    actions: list[Action],
    motion: Float[np.ndarray, "4 3"],
    hull: Hull,
    clearance: Clearance,
) -> bool:
    """Whether actions from a pose leave the hull clear of obstacles, or no nearer than it is."""
    poses = [pose]
    for action in actions:
        poses += [compose(pose, step / PARTS * motion[action]) for step in range(1, PARTS + 1)]
        pose = poses[-1]
    places = np.array(poses)
    space = clearance.space(hull, places[:, :2], places[:, 2])
    return bool((space[1:] >= np.minimum(LEAST_M, space[:-1])).all())


@compiled
def _search(
    pose: np.ndarray,
    motion: np.ndarray,
    corners: np.ndarray,
    surfaces: Surfaces,
    left: np.ndarray,
    grid: tuple[float, float, float],
) -> np.ndarray:
    """Numbers of the actions; `left` is what is left from each cell of a grid [decisions]."""
    half = int(_REGION_M / _CELL_M)
    turns = _PER_TURN * round(2 * math.pi / abs(motion[1, 2]))
    seen = np.zeros((2 * half, 2 * half, turns), np.bool_)
    poses, cost = np.empty((_MOST, 3)), np.empty(_MOST)
    parent, action = np.full(_MOST, -1), np.full(_MOST, -1)
    start = _left_at(pose[0], pose[1], left, grid)
    here = gap_of_outline(pose[0], pose[1], pose[2], corners, surfaces, _WIDE_M)
    poses[0], cost[0] = pose, 0.0
    count, best, best_left = 1, 0, start
    queue = [(_GREED * start, 0)]
    while queue and count < _MOST - 4:
        _, node = heapq.heappop(queue)
        x, y, yaw = poses[node]
        now = _left_at(x, y, left, grid)
        if now < best_left:
            best, best_left = node, now
        if now < _END or now < start - _HORIZON:
            break
        for k in range(4):
            price = 1.0 + (_BACK if k == 3 else 0.0)
            c, s = math.cos(yaw), math.sin(yaw)
            last = here if node == 0 else LEAST_M
            for step in range(1, PARTS + 1):
                share = step / PARTS
                dx, dy = share * motion[k, 0], share * motion[k, 1]
                nx, ny, nyaw = x + c * dx - s * dy, y + s * dx + c * dy, yaw + share * motion[k, 2]
                gap = gap_of_outline(nx, ny, nyaw, corners, surfaces, _WIDE_M)
                # A hull that is in an obstacle of the map may move out of it.
                if gap < min(LEAST_M, last):
                    price = math.inf
                    break
                last = gap
                price += _TIGHT / PARTS * (1 - max(gap, 0.0) / _WIDE_M)
            if price == math.inf:
                continue
            ix, iy = int((nx - pose[0]) / _CELL_M + half), int((ny - pose[1]) / _CELL_M + half)
            turn = round((nyaw - pose[2]) / (2 * math.pi) * turns) % turns
            if not (0 <= ix < 2 * half and 0 <= iy < 2 * half) or seen[iy, ix, turn]:
                continue
            after = _left_at(nx, ny, left, grid)
            if after == math.inf:
                continue
            seen[iy, ix, turn] = True
            poses[count] = nx, ny, nyaw
            cost[count], parent[count], action[count] = cost[node] + price, node, k
            heapq.heappush(queue, (cost[count] + _GREED * after, count))
            count += 1
    steps = np.empty(count, np.int64)
    n = 0
    while parent[best] >= 0:
        steps[n] = action[best]
        best, n = parent[best], n + 1
    return steps[:n][::-1]


@compiled
def _left_at(x: float, y: float, left: np.ndarray, grid: tuple[float, float, float]) -> float:
    """Return the remaining cost from a place, which is that of its cell; inf beyond the grid."""
    x0, y0, cell = grid
    ix, iy = math.floor((x - x0) / cell), math.floor((y - y0) / cell)
    if not (0 <= iy < left.shape[0] and 0 <= ix < left.shape[1]):
        return math.inf
    return left[iy, ix]
