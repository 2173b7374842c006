"""Exploration of a building without physics, noise and pictures: thousands of decisions per second, for training.

A world and an agent, as in episodes, with the explorer and planner of episodes. Rays over the plan's cells make the map
of a perfect camera and mapper; the agent turns by 10 degrees and then goes straight along the planned path. Rendering,
odometry, scan matching, collisions and the controller are left out, since they take most of the time.
"""

import math

import numpy as np
import shapely
from jaxtyping import Float

from robosim.building.building import Building
from robosim.building.reach import Reach
from robosim.support.compiled import compiled
from robosim.task.coverage import VISION_RANGE_M
from slam.actions import FORWARD_M, TURN_RAD
from slam.exploration.explorer import FrontierExplorer
from slam.grid import GridFrame, MapEstimate
from slam.planning.planner import Plan, Planner
from slam.poses import wrap

#: Range within which the map becomes free [m], as in the classical mapper.
_FREE_RANGE_M = 5.0
_FREE, _WALL = np.float32(0.05), np.float32(0.95)
#: Decisions after which the path is planned again.
_REPLAN = 8
#: Largest difference between heading and path at which the robot goes ahead [rad].
_AIM_RAD = 0.51 * TURN_RAD


class GridWorld:
    """A building on a grid with one robot, whose map and pose have no errors."""

    def __init__(self, building: Building, places: Reach, rng: np.random.Generator, hfov_rad: float) -> None:
        """Put the robot at a random pose on the largest part of the floor where its hull fits."""
        plan = building.plan
        cell = plan.resolution_m
        centres = plan.to_map(np.indices(plan.shape)[::-1].reshape(2, -1).T + 0.5)
        shapely.prepare(building.free)
        free = shapely.contains_xy(building.free, centres).reshape(plan.shape)
        # A margin of walls around the plan's own grid, whose axes are those of the walk.
        self._wall = np.pad(~free, 1, constant_values=True)
        self._region = np.pad(places.swept(1), 1)
        self._frame = GridFrame(origin_xy=(-cell, -cell), resolution_m=cell, shape=self._wall.shape)
        self._n_region = int(self._region.sum())
        self._probability = np.full(self._wall.shape, 0.5, np.float32)
        self._explored = np.zeros(self._wall.shape, bool)
        self._not_blocked = np.zeros(self._wall.shape, bool)
        self._half_rad = hfov_rad / 2
        home = np.argwhere(np.pad(places.parts, 1) == 1)
        row, column = home[rng.integers(len(home))] + 0.5
        x, y = self._frame.to_points(np.array([column, row]))
        self.step(np.array([x, y, rng.uniform(-np.pi, np.pi)]))

    @property
    def coverage(self) -> float:
        """Fraction of the reachable floor that has been seen."""
        return np.count_nonzero(self._explored & self._region) / self._n_region

    def step(self, pose: Float[np.ndarray, "3"]) -> None:
        """Move the robot to a pose x [m], y [m], yaw [rad], and look from there."""
        self.pose = pose
        column, row = self._frame.to_cells(pose[:2])
        _mark(
            self._wall,
            self._probability,
            self._explored,
            float(column),
            float(row),
            float(pose[2]),
            self._half_rad,
            _FREE_RANGE_M / self._frame.resolution_m,
            VISION_RANGE_M / self._frame.resolution_m,
            _FREE,
            _WALL,
        )

    def estimate(self) -> MapEstimate:
        """Return map and pose."""
        return MapEstimate(
            frame=self._frame,
            obstacle_probability=self._probability,
            explored=self._explored,
            blocked=self._not_blocked,
            pose=self.pose,
        )


class GridAgent:
    """Explores a grid: explorer, planner, and turns and steps along the path."""

    def __init__(self, explorer: FrontierExplorer) -> None:
        self._explorer, self._planner = explorer, Planner()
        self._plan: Plan | None = None
        self._corners: list[Float[np.ndarray, 2]] = []
        self._age = 0

    def act(self, estimate: MapEstimate) -> Float[np.ndarray, "3"] | None:
        """Return the next pose x [m], y [m], yaw [rad]; None if no frontier is left."""
        goal = self._explorer.goal(estimate)
        return None if goal is None else self._next_pose(estimate.pose, self._path(estimate, goal))

    def _path(self, estimate: MapEstimate, goal: Float[np.ndarray, "2"]) -> Plan:
        """The plan for a goal, cached for some decisions."""
        self._age += 1
        if self._plan is None or self._age >= _REPLAN or math.hypot(*(goal - self._plan.asked_xy)) > 0.02:
            self._plan, self._age = self._planner.plan(estimate, goal, look=True), 0
            self._corners = [*self._plan.path[1:]]
        return self._plan

    def _next_pose(self, pose: Float[np.ndarray, "3"], plan: Plan) -> Float[np.ndarray, "3"]:
        """Turn by 10 degrees, or go straight on."""
        x, y, yaw = pose
        while self._corners and math.hypot(*(self._corners[0] - (x, y))) < 0.02:
            self._corners.pop(0)
        ahead = (self._corners[0] if self._corners else plan.asked_xy) - (x, y)
        distance = math.hypot(*ahead)
        # At the end of the path it turns towards the goal, and then on, to look around.
        off = wrap(math.atan2(ahead[1], ahead[0]) - yaw) if distance > 0.02 else math.pi
        if abs(off) > _AIM_RAD or not self._corners:
            return np.array([x, y, wrap(yaw + math.copysign(TURN_RAD, off))])
        step = min(1.0, FORWARD_M / distance)
        return np.array([x + step * ahead[0], y + step * ahead[1], yaw])


@compiled
def _mark(
    wall: np.ndarray,
    probability: np.ndarray,
    explored: np.ndarray,
    column: float,
    row: float,
    yaw: float,
    half_rad: float,
    reach: float,
    sight: float,
    free: np.float32,
    solid: np.float32,
) -> None:
    """Rays over the field of view, and a little floor around the robot itself; lengths in cells."""
    ny, nx = wall.shape
    rays = 2 * math.ceil(half_rad * reach / 0.8) + 1
    for r in range(rays):
        angle = yaw + half_rad * (2.0 * r / (rays - 1) - 1.0)
        dx, dy = math.cos(angle), math.sin(angle)
        for i in range(int(2.0 * reach)):
            t = 0.5 * i
            ix, iy = math.floor(column + t * dx), math.floor(row + t * dy)
            if ix < 0 or iy < 0 or ix >= nx or iy >= ny:
                break
            if t <= sight:
                explored[iy, ix] = True
            if wall[iy, ix]:
                probability[iy, ix] = solid
                break
            probability[iy, ix] = free
    # The robot stands on free floor.
    for iy in range(max(int(row) - 3, 0), min(int(row) + 4, ny)):
        for ix in range(max(int(column) - 3, 0), min(int(column) + 4, nx)):
            if not wall[iy, ix]:
                probability[iy, ix] = free
