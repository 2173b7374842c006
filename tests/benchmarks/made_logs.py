"""Logs at full rate that are made: a robot that drives through a building and scans ten times a second."""

import math
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from robosim.building.building import make_building
from robosim.lidar import EmbreeLidar, LidarConfig, LidarModel
from robosim.logs.robot_log import RobotLog
from robosim.plans.floorplan import FREE, FloorPlan
from slam.poses import between, compose, wrap

#: A lidar as on many bases of research: half a degree to a degree between beams, half a turn.
LASER = LidarModel(beams=180, fov_deg=179.0, max_range_m=20.0, sigma_m=0.01, sigma_share=0.0, missing=0.0)
#: Speeds [m/s, rad/s], and time between scans [s].
_SPEED_M_S, _TURN_RAD_S, _STEP_S = 0.5, 0.8, 0.1
#: Standard deviation of odometry, as a part of what was driven and turned; constant errors of scale and of direction.
_SLIP, _SCALE, _VEER_RAD_PER_M = 0.02, 1.01, 0.003
#: Side of the cells of routes [m], and distance that they keep from walls [m].
_CELL_M, _CLEAR_M = 0.25, 0.45


def make_log(plan: FloorPlan, scans: int, seed: int, model: LidarModel = LASER) -> RobotLog:
    """Drive to one random place after another; the reference is the true trajectory."""
    rng = np.random.default_rng(seed)
    poses = _drive(plan, scans, rng)
    lidar = EmbreeLidar([make_building(plan).mesh], LidarConfig(), model=model)
    steps = np.array([np.zeros(3), *(between(a, b) for a, b in pairwise(poses))])
    driven_m = np.hypot(steps[:, 0], steps[:, 1])
    measured = steps * [_SCALE, 1.0, 1.0] + rng.normal(size=steps.shape) * _SLIP * (
        np.column_stack([driven_m, 0.2 * driven_m, np.abs(steps[:, 2]) + 0.1 * driven_m])
    )
    measured[:, 2] += _VEER_RAD_PER_M * driven_m
    start = between(poses[0], np.zeros(3))
    return RobotLog(
        name=f"{plan.name}-{scans}",
        bearing_rad=model.bearing_rad,
        range_m=np.array([lidar.scan(pose, rng).range_m for pose in poses]),
        displacement=measured,
        known=np.ones(scans, bool),
        times=_STEP_S * np.arange(scans),
        reference=np.array([compose(start, pose) for pose in poses]),
    )


def _drive(plan: FloorPlan, scans: int, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """True poses at the scans."""
    free, side = _free(plan), round(_CELL_M / plan.resolution_m)
    row, column = np.nonzero(free)
    place = plan.to_map(np.column_stack([column, row]) * side + 0.5 * side)
    number = np.full(free.shape, -1)
    number[row, column] = np.arange(len(row))
    links = []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        inside = (row + dy < free.shape[0]) & (column + dx < free.shape[1]) & (column + dx >= 0)
        there = number[row[inside] + dy, column[inside] + dx]
        links.append(
            np.column_stack([np.flatnonzero(inside), there, np.full(len(there), math.hypot(dx, dy))])[
                there >= 0
            ]
        )
    first, second, length = np.concatenate(links).T
    graph = coo_matrix((length, (first.astype(int), second.astype(int))), shape=(len(row),) * 2).tocsr()
    at = int(rng.integers(len(row)))
    poses = [np.array([*place[at], rng.uniform(-math.pi, math.pi)])]
    while len(poses) < scans:
        far, back = dijkstra(graph, directed=False, indices=at, return_predecessors=True)
        goal = int(rng.choice(np.flatnonzero(np.isfinite(far))))
        route = [goal]
        while route[-1] != at:
            route.append(int(back[route[-1]]))
        for node in route[-2::-1]:
            poses += _towards(poses[-1], place[node])
        at = goal
    return np.array(poses[:scans])


def _towards(pose: Float[np.ndarray, "3"], goal: Float[np.ndarray, "2"]) -> list[Float[np.ndarray, "3"]]:
    """Poses of a turn on the spot and a straight drive."""
    away = goal - pose[:2]
    turn = float(wrap(math.atan2(away[1], away[0]) - pose[2]))
    turns = math.ceil(abs(turn) / (_TURN_RAD_S * _STEP_S)) if abs(turn) > 0.1 else 0
    made = [compose(pose, np.array([0.0, 0.0, turn * (k + 1) / turns])) for k in range(turns)]
    drives = math.ceil(math.hypot(*away) / (_SPEED_M_S * _STEP_S))
    yaw = math.atan2(away[1], away[0])
    return made + [np.array([*(pose[:2] + away * (k + 1) / drives), yaw]) for k in range(drives)]


def _free(plan: FloorPlan) -> Bool[np.ndarray, "ny nx"]:
    """Coarse cells in which the robot may stand, of the largest connected part."""
    side = round(_CELL_M / plan.resolution_m)
    gap = cv2.distanceTransform((plan.occupancy == FREE).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    clear = gap[side // 2 :: side, side // 2 :: side] * plan.resolution_m > _CLEAR_M
    _, part = cv2.connectedComponents(clear.astype(np.uint8), connectivity=4)
    return np.asarray(part == 1 + np.argmax(np.bincount(part.ravel())[1:]))
