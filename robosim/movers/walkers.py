"""People who walk from place to place, stand together, and avoid each other and the robot.

Each person heads for a place along the fastest route (fast marching, slower near walls), waits there for some time, and
chooses another; sometimes the place where somebody else is. Others push them aside by the social force

    f = (v0 e - v) / tau + sum over others of w V0 / sigma exp(-b / sigma) db/dr,
    2 b = sqrt((|r| + |r - s|)^2 - |s|^2),  s = v_other Delta_t,

with weight w = 1 within the field of view and c outside of it; robots are other ones. Bodies neither enter walls nor
each other nor the robot: they step around, to the right first. A person without progress for some seconds, as in a
doorway from which another one comes, chooses another place.

Left out: forces of walls, which close narrow doorways (routes keep clear of walls instead), and groups that walk
together.
Reference: D. Helbing and P. Molnar, Social force model for pedestrian dynamics, Physical Review E 51 (1995), with
all of its parameters.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float, Float32
from scipy import ndimage

from robosim.building.reach import reach
from robosim.movers.mover import Body, Surroundings
from robosim.support.checks import Range, checked
from robosim.support.compiled import compiled
from slam.planning.marching import march

#: Step of the integration [s], and space that people leave to the robot, which moves on within it [m].
_STEP_S, _SPACE_M = 0.1, 0.15
#: Places in a building between which people walk, and candidates of which the farthest apart are taken.
_PLACES, _CANDIDATES = 16, 400
#: Most cells of the grid of routes, and least side of a cell [m].
_CELLS, _CELL_M = 250_000, 0.08
#: Space around a body above which routes do not slow down [m], and the slowest pace in routes.
_CLEAR_M, _SLOW = 0.3, 0.3
#: People begin at least so far from the robot and from each other [m].
_FROM_ROBOT_M, _APART_M = 1.5, 0.6
#: A place is reached at this distance [m]: several people stand around one place.
_ARRIVED_M = 0.7
#: Without progress by the first [m] within the second [s], another place is chosen.
_PROGRESS_M, _PATIENCE_S = 0.3, 4.0
#: Parameters of the reference: relaxation time [s], strength [m2/s2] and range [m] of repulsion, time that others'
#: steps are anticipated [s], cosine of half the field of view, weight behind it, and fastest over desired speed.
_TAU_S, _V0, _SIGMA_M, _AHEAD_S, _VIEW, _BEHIND, _FASTEST = (
    0.5,
    2.1,
    0.3,
    2.0,
    math.cos(math.radians(100)),
    0.5,
    1.3,
)
#: People who stand move aside at this speed [m/s].
_ASIDE_MPS = 0.6
#: Directions of a step in the order in which they are tried [rad], and the least pace of those to the side.
_ASIDE, _SHUFFLE = tuple(math.radians(angle) for angle in (0, -30, 30, -60, 60, -90, 90)), 0.3
#: Directions among which that of the least travel is chosen, and how far ahead it is looked up [m].
_DIRECTIONS, _LOOK_M = 24, 0.35


@dataclass(frozen=True, kw_only=True)
@checked
class WalkersConfig:
    """How people walk."""

    speed_mps: Annotated[float, Range(0.1, 3, "m/s")] = 1.34
    """Mean desired speed [m/s]; it is normally distributed."""
    speed_std_mps: Annotated[float, Range(0, 1, "m/s")] = 0.26
    """Standard deviation of desired speeds [m/s]."""
    wait_s: Annotated[float, Range(0, 3600, "s")] = 8.0
    """Mean time at a place [s]; it is exponentially distributed."""
    together: Annotated[float, Range(0, 1)] = 0.3
    """Probability of going where somebody else stands or goes."""


class Walkers:
    """People on the free floor of a building."""

    def __init__(self, count: int, config: WalkersConfig | None = None, body: Body | None = None) -> None:
        self._config, self._body = config or WalkersConfig(), body or Body()
        self.bodies: Sequence[Body] = (self._body,) * count

    def reset(self, surroundings: Surroundings, rng: np.random.Generator) -> None:
        """Draw places and people; ValueError if there is no room for all of them."""
        self._rng = rng
        self._routes = _Routes(surroundings, self._body, rng)
        n = len(self.bodies)
        robots = np.vstack([surroundings.robot[:2], surroundings.others[:, :2]])
        self._xy = self._routes.starts(n, robots, rng)
        self._velocity = np.zeros((n, 2))
        self._yaw = rng.uniform(-math.pi, math.pi, n)
        speed = rng.normal(self._config.speed_mps, self._config.speed_std_mps, n)
        self._speed = np.maximum(speed, 0.3 * self._config.speed_mps)
        self._goal = rng.integers(len(self._routes.places), size=n)
        # Several people stand at first.
        self._wait_s = rng.exponential(self._config.wait_s, n) * (rng.random(n) < 0.5)
        self._best_m, self._stuck_s = np.full(n, np.inf), np.zeros(n)
        self._others = surroundings.others
        self._robots = np.zeros((1 + len(self._others), 5))
        self._robots[0, :2], self._robots[1:, :2] = surroundings.robot[:2], self._others[:, :2]
        self._robots[:, 4] = np.array([surroundings.robot_radius_m, *self._others[:, 2]]) + _SPACE_M
        self._steps, self._before = 0, np.column_stack([self._xy, self._yaw])
        self._change = np.zeros((n, 3))

    def poses(self, time_s: float, robot: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
        """Poses at a time, linear within a step; see `robosim.movers.mover.Mover`."""
        while self._steps * _STEP_S < time_s:
            self._robots[0, 2:4] = (robot[:2] - self._robots[0, :2]) / _STEP_S
            self._robots[0, :2], self._robots[1:, :2] = robot[:2], self._others[:, :2]
            self._before += self._change
            self._step()
            self._change = np.column_stack([self._xy, self._yaw]) - self._before
            self._steps += 1
        return self._before + (1 + time_s / _STEP_S - self._steps) * self._change

    def _step(self) -> None:
        routes, waits = self._routes, self._wait_s > 0
        if waits.any():
            self._wait_s[waits] -= _STEP_S
            for k in np.flatnonzero(waits & (self._wait_s <= 0)):
                self._choose(int(k))
        left_m = _walk(
            self._xy,
            self._velocity,
            np.where(waits, 0.0, self._speed),
            self._yaw,
            routes.travel_to(self._goal),
            self._goal,
            routes.grid,
            self._robots,
            self._body.radius_m,
        )
        progress = left_m < self._best_m - _PROGRESS_M
        self._best_m[progress] = left_m[progress]
        self._stuck_s += _STEP_S
        self._stuck_s[progress | waits] = 0.0
        for k in np.flatnonzero(~waits & (left_m < _ARRIVED_M)):
            self._wait_s[k] = max(self._rng.exponential(self._config.wait_s), _STEP_S)
        for k in np.flatnonzero(self._stuck_s > _PATIENCE_S):
            self._choose(int(k))

    def _choose(self, k: int) -> None:
        """Another place for a person."""
        others = np.delete(self._goal, k)
        goals = others[others != self._goal[k]]
        if len(goals) and self._rng.random() < self._config.together:
            self._goal[k] = self._rng.choice(goals)
        else:
            step = self._rng.integers(1, max(len(self._routes.places), 2))
            self._goal[k] = (self._goal[k] + step) % len(self._routes.places)
        self._best_m[k], self._stuck_s[k] = np.inf, 0.0


class _Routes:
    """Where people can be, the places between which they walk, and travel to these."""

    def __init__(self, surroundings: Surroundings, body: Body, rng: np.random.Generator) -> None:
        places = reach(surroundings.building, body.radius_m, body.height_m)
        cells = (places.parts == 1) & places.indoors
        cell_m = places.plan.resolution_m
        every = max(1, round(_CELL_M / cell_m), math.ceil(math.sqrt(cells.size / _CELLS)))
        self._cells = cells[::every, ::every].copy()
        self._cell_m = cell_m * every
        if not self._cells.any():
            raise ValueError(
                f"{places.plan.name}: a person of radius {body.radius_m:g} m fits nowhere. Leave people out."
            )
        # From `map` to cells of the grid, whose centres are those of every so many cells of the plan.
        corner = places.plan.to_map(np.array([[0.5, 0.5], [0.5 + every, 0.5], [0.5, 0.5 + every]]))
        axes = np.linalg.inv((corner[1:] - corner[0]).T)
        self.grid = (self._cells, axes, corner[0])
        self._corner, self._axes = corner[0], corner[1:] - corner[0]
        clear_m = ndimage.distance_transform_edt(np.pad(self._cells, 1))[1:-1, 1:-1] * self._cell_m
        self._pace = self._cells * np.clip(clear_m / _CLEAR_M, _SLOW, 1.0)
        candidates = np.argwhere(self._cells & (clear_m >= min(_CLEAR_M, clear_m.max())))
        candidates = candidates[rng.permutation(len(candidates))[:_CANDIDATES]]
        self.places = candidates[_farthest(candidates, _PLACES)]
        self._travel = np.full((len(self.places), *self._cells.shape), np.inf, np.float32)
        self._is_known = np.zeros(len(self.places), bool)

    def starts(
        self, count: int, robots: Float[np.ndarray, "robots 2"], rng: np.random.Generator
    ) -> Float[np.ndarray, "n 2"]:
        """Places for people to begin at."""
        cells = np.argwhere(self._cells)
        places: list[np.ndarray] = []
        for xy in self._to_map(cells[rng.permutation(len(cells))[: 50 * count + 1000]]):
            if len(places) == count:
                break
            if all(math.hypot(*(xy - robot)) > _FROM_ROBOT_M for robot in robots) and all(
                math.hypot(*(xy - place)) > _APART_M for place in places
            ):
                places.append(xy)
        if len(places) < count:
            raise ValueError(f"people is {count}, expected at most {len(places)}: there is no room for more.")
        return np.array(places).reshape(-1, 2)

    def _to_map(self, cells: np.ndarray) -> Float[np.ndarray, "n 2"]:
        """Centres of cells (row, column) in `map` [m]."""
        return self._corner + cells[:, ::-1] @ self._axes

    def travel_to(self, goals: np.ndarray) -> Float32[np.ndarray, "places ny nx"]:
        """Travel to all places, of which those of `goals` are computed."""
        for k in set(goals[~self._is_known[goals]].tolist()):
            row, column = self.places[k]
            self._travel[k] = march(self._pace, (int(row), int(column)), self._cell_m)
            self._is_known[k] = True
        return self._travel


def _farthest(cells: np.ndarray, count: int) -> list[int]:
    """Indices of cells each of which is the farthest from those before it."""
    chosen, gap = [0], np.full(len(cells), np.inf)
    while len(chosen) < min(count, len(cells)):
        gap = np.minimum(gap, np.hypot(*(cells - cells[chosen[-1]]).T))
        chosen.append(int(gap.argmax()))
    return chosen


@compiled
def _walk(
    xy: Float[np.ndarray, "n 2"],
    velocity: Float[np.ndarray, "n 2"],
    speed: Float[np.ndarray, " n"],
    yaw: Float[np.ndarray, " n"],
    travel: Float32[np.ndarray, "places ny nx"],
    goal: np.ndarray,
    grid: tuple[np.ndarray, np.ndarray, np.ndarray],
    robots: Float[np.ndarray, "robots 5"],
    radius: float,
) -> Float[np.ndarray, " n"]:
    """Move all people by a step, one after the other; returns the travel that is left to each.

    `robots` are x, y [m], velocity x, y [m/s], radius [m].
    """
    n = len(xy)
    left = np.empty(n)
    for k in range(n):
        x, y = xy[k]
        left[k] = _travel_at(travel[goal[k]], grid, x, y)
        ex, ey = _downhill(travel[goal[k]], grid, x, y, left[k])
        ax = (speed[k] * ex - velocity[k, 0]) / _TAU_S
        ay = (speed[k] * ey - velocity[k, 1]) / _TAU_S
        for j in range(n + len(robots)):
            if j == k:
                continue
            if j < n:
                rx, ry, sx, sy = x - xy[j, 0], y - xy[j, 1], velocity[j, 0], velocity[j, 1]
            else:
                robot = robots[j - n]
                rx, ry, sx, sy = x - robot[0], y - robot[1], robot[2], robot[3]
            fx, fy = _repulsion(rx, ry, sx * _AHEAD_S, sy * _AHEAD_S)
            seen = ex * -fx + ey * -fy >= math.hypot(fx, fy) * _VIEW
            weight = 1.0 if seen else _BEHIND
            ax += weight * fx
            ay += weight * fy
        vx, vy = velocity[k, 0] + ax * _STEP_S, velocity[k, 1] + ay * _STEP_S
        fastest = _FASTEST * max(speed[k], _ASIDE_MPS)
        pace = math.hypot(vx, vy)
        if pace > fastest:
            vx, vy = vx * fastest / pace, vy * fastest / pace
        is_free = False
        for angle in _ASIDE:
            along, across = math.cos(angle), math.sin(angle)
            share = max(along, _SHUFFLE) * _STEP_S
            dx, dy = (vx * along - vy * across) * share, (vx * across + vy * along) * share
            if _is_free(xy, k, x + dx, y + dy, grid, robots, radius):
                is_free = True
                break
        if not is_free:
            dx = dy = 0.0
        xy[k, 0], xy[k, 1] = x + dx, y + dy
        velocity[k, 0], velocity[k, 1] = dx / _STEP_S, dy / _STEP_S
        if math.hypot(dx, dy) > 0.2 * _STEP_S:
            turn = math.atan2(dy, dx) - yaw[k]
            turn = (turn + math.pi) % (2 * math.pi) - math.pi
            yaw[k] += turn * min(1.0, 2 * _STEP_S / _TAU_S)
    return left


@compiled
def _repulsion(rx: float, ry: float, sx: float, sy: float) -> tuple[float, float]:
    """Acceleration [m/s2] away from somebody at distance (rx, ry) who will have moved by (sx, sy)."""
    qx, qy = rx - sx, ry - sy
    near, far, step = math.hypot(rx, ry), math.hypot(qx, qy), math.hypot(sx, sy)
    if near > 4.0 or near < 1e-9 or far < 1e-9:
        return 0.0, 0.0
    b = 0.5 * math.sqrt(max((near + far) ** 2 - step**2, 1e-12))
    size = _V0 / _SIGMA_M * math.exp(-b / _SIGMA_M) * (near + far) / (4 * b)
    return size * (rx / near + qx / far), size * (ry / near + qy / far)


@compiled
def _cell_of(grid: tuple[np.ndarray, np.ndarray, np.ndarray], x: float, y: float) -> tuple[int, int]:
    """Row and column of the cell whose centre is nearest, -1 outside of the grid."""
    cells, axes, corner = grid
    dx, dy = x - corner[0], y - corner[1]
    column = math.floor(axes[0, 0] * dx + axes[0, 1] * dy + 0.5)
    row = math.floor(axes[1, 0] * dx + axes[1, 1] * dy + 0.5)
    if 0 <= row < cells.shape[0] and 0 <= column < cells.shape[1]:
        return row, column
    return -1, -1


@compiled
def _travel_at(
    travel: np.ndarray, grid: tuple[np.ndarray, np.ndarray, np.ndarray], x: float, y: float
) -> float:
    row, column = _cell_of(grid, x, y)
    return travel[row, column] if row >= 0 else np.inf


@compiled
def _downhill(
    travel: np.ndarray, grid: tuple[np.ndarray, np.ndarray, np.ndarray], x: float, y: float, here: float
) -> tuple[float, float]:
    """Unit vector towards the least travel around a point; zero where none is less."""
    best, ex, ey = here, 0.0, 0.0
    for k in range(_DIRECTIONS):
        angle = 2 * math.pi * k / _DIRECTIONS
        ux, uy = math.cos(angle), math.sin(angle)
        there = _travel_at(travel, grid, x + _LOOK_M * ux, y + _LOOK_M * uy)
        if there < best:
            best, ex, ey = there, ux, uy
    return ex, ey


@compiled
def _is_free(
    xy: np.ndarray,
    k: int,
    x: float,
    y: float,
    grid: tuple[np.ndarray, np.ndarray, np.ndarray],
    robots: np.ndarray,
    radius: float,
) -> bool:
    """Whether a person can move to a point: no wall is there, and no one to whom the move leads nearer."""
    row, column = _cell_of(grid, x, y)
    if row < 0 or not grid[0][row, column]:
        return False
    for j in range(len(xy) + len(robots)):
        if j == k:
            continue
        if j < len(xy):
            ox, oy, other = xy[j, 0], xy[j, 1], radius
        else:
            ox, oy, other = robots[j - len(xy), 0], robots[j - len(xy), 1], robots[j - len(xy), 4]
        gap = math.hypot(x - ox, y - oy)
        if gap < radius + other and gap < math.hypot(xy[k, 0] - ox, xy[k, 1] - oy):
            return False
    return True
