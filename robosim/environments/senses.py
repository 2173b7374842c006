"""Observations of a search, sense by sense, as spaces and arrays of an environment.

| sense | key | shape, type | meaning | min | max |
|---|---|---|---|---|---|
| rgb | rgb | (h, w, 3) uint8 | camera picture | 0 | 255 |
| depth | depth | (h, w, 1) uint8 | depth along the camera's axis in steps of 10 m / 255; 0 nothing measured | 0 | 255 |
| depth, in metres | depth | (h, w, 1) float32 | the same [m] | 0 | 10 |
| lidar | lidar | (beams,) float32 | ranges [m], from behind counter-clockwise; its reach for nothing | 0 | reach |
| odometry | odometry | (3,) float32 | measured motion of the step: dx, dy [m], dyaw [rad] | -b, -b, -pi | b, b, pi |
| radio | path_direction | (5,) float32 | direction of arrival, counter-clockwise from ahead [rad] | -pi | pi |
| | path_delay | (5,) float32 | delay after the strongest path [ns] | -100 | 100 |
| | path_snr | (5,) float32 | SNR as `wireless.estimates` defines it [dB] | -50 | 150 |
| | path_found | (5,) int8 | 1 for a path, 0 for a place without one, which holds 0 | 0 | 1 |
| | link_state | (4,) float32 | probabilities of outage, line of sight, first order, higher order | 0 | 1 |
| map | map | (n, n, 1) uint8 | floor around the robot, ahead on top: 0 unseen, 128 floor, 255 wall | 0 | 255 |
| pose | pose | (3,) float32 | x ahead, y left [m], yaw [rad] since the start | -1000, -1000, -pi | 1000, 1000, pi |

Map and pose are those of a mapper without errors: floor is seen by the rule of `robosim.task.coverage`, at the true
pose. The other senses have the noise of the simulator. The strongest path comes first. b is 2 m, or the distance of a
second at the robot's highest speed where that is more.
"""

from typing import Any

import cv2
import numpy as np
from gymnasium import spaces
from jaxtyping import Float, Float32, UInt8

from robosim.environments.config import SearchConfig
from robosim.lidar import Lidar
from robosim.plans.floorplan import FloorPlan
from robosim.simulator import Observation, SimulatorConfig
from slam.poses import between
from slam.sensing.laser import LaserScan
from wireless.estimates import PathEstimates

#: Largest depth of observations [m]: the range of a sensor, and the bound of the space.
MAX_DEPTH_M = 10.0
#: Number of observed radio paths.
PATHS = 5
#: Least bound of the distances of an odometry reading [m]; far beyond what a discrete action can do.
_ODOMETRY_M = 2.0
_POSE_BOUND = np.array([1000.0, 1000.0, np.pi], np.float32)
_DELAY_NS, _SNR_DB = 100.0, (-50.0, 150.0)
_FLOOR, _WALL = 128, 255


def observation_space(
    config: SearchConfig, simulator: SimulatorConfig, lidar: Lidar | None
) -> spaces.Space[Any]:
    """The space of the observations of a configuration; the lidar has number and reach of beams."""
    size = simulator.image.height, simulator.image.width
    boxes: dict[str, spaces.Space[Any]] = {}
    for sense in config.observe:
        if sense == "rgb":
            boxes["rgb"] = spaces.Box(0, 255, (*size, 3), np.uint8)
        elif sense == "depth" and config.depth == "picture":
            boxes["depth"] = spaces.Box(0, 255, (*size, 1), np.uint8)
        elif sense == "depth":
            boxes["depth"] = spaces.Box(0.0, MAX_DEPTH_M, (*size, 1), np.float32)
        elif sense == "lidar" and lidar is not None:
            scan = lidar.true_scan(np.zeros(3))
            boxes["lidar"] = spaces.Box(0.0, scan.max_range_m, scan.range_m.shape, np.float32)
        elif sense == "odometry":
            bound = odometry_bound(simulator)
            boxes["odometry"] = spaces.Box(-bound, bound, dtype=np.float32)
        elif sense == "radio":
            boxes["path_direction"] = spaces.Box(-np.pi, np.pi, (PATHS,), np.float32)
            boxes["path_delay"] = spaces.Box(-_DELAY_NS, _DELAY_NS, (PATHS,), np.float32)
            boxes["path_snr"] = spaces.Box(*_SNR_DB, (PATHS,), np.float32)
            boxes["path_found"] = spaces.MultiBinary(PATHS)
            boxes["link_state"] = spaces.Box(0.0, 1.0, (4,), np.float32)
        elif sense == "map":
            boxes["map"] = spaces.Box(0, 255, (config.map_cells, config.map_cells, 1), np.uint8)
        elif sense == "pose":
            boxes["pose"] = spaces.Box(-_POSE_BOUND, _POSE_BOUND, dtype=np.float32)
    return spaces.Dict(boxes)


def depth_picture(depth: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 1"]:
    """Depth [m] in 8 bits; measured depths are 1 or more."""
    level = np.rint(np.minimum(depth, MAX_DEPTH_M) * np.float32(255 / MAX_DEPTH_M))
    return np.where(depth > 0, np.maximum(level, 1), 0).astype(np.uint8)[..., None]


def depth_metres(depth: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w 1"]:
    """Depth within the bounds of its space [m]."""
    return np.clip(depth, 0, MAX_DEPTH_M).astype(np.float32)[..., None]


def ranges(scan: LaserScan) -> Float[np.ndarray, " beams"]:
    """Ranges of a scan [m]; its reach for beams without a return."""
    return np.minimum(scan.range_m, scan.max_range_m).astype(np.float32)


def odometry_bound(simulator: SimulatorConfig) -> Float32[np.ndarray, "3"]:
    """Bounds of an odometry reading [m, m, rad]; a velocity action takes half a second."""
    distance_m = max(_ODOMETRY_M, simulator.robot.max_speed_mps)
    return np.array([distance_m, distance_m, np.pi], np.float32)


def odometry(view: Observation, bound: Float32[np.ndarray, "3"]) -> Float32[np.ndarray, "3"]:
    """Measured motion within the bounds of its space."""
    return np.clip(view.odometry.astype(np.float32), -bound, bound)


def paths(estimates: PathEstimates, probability: Float[np.ndarray, "4"]) -> dict[str, np.ndarray]:
    """Estimated paths of one link, and the probabilities of its state, as observations."""
    n = min(int(estimates.count[0]), PATHS)
    observation = {key: np.zeros(PATHS, np.float32) for key in ("path_direction", "path_delay", "path_snr")}
    pi = np.float32(np.pi)
    observation["path_direction"][:n] = np.clip(estimates.aoa_rad[0, :n].astype(np.float32), -pi, pi)
    observation["path_delay"][:n] = np.clip(
        1e9 * np.nan_to_num(estimates.delay_s[0, :n]), -_DELAY_NS, _DELAY_NS
    )
    observation["path_snr"][:n] = np.clip(estimates.snr_db[0, :n], *_SNR_DB)
    observation["path_found"] = (np.arange(PATHS) < n).astype(np.int8)
    observation["link_state"] = np.clip(probability, 0, 1).astype(np.float32)
    return observation


def pose_since(start: Float[np.ndarray, "3"], pose: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """A pose in the frame of the start, within the bounds of its space."""
    return np.clip(between(start, pose).astype(np.float32), -_POSE_BOUND, _POSE_BOUND)


def map_ahead(
    plan: FloorPlan, seen: np.ndarray, pose: Float[np.ndarray, "3"], cells: int, cell_m: float
) -> UInt8[np.ndarray, "n n 1"]:
    """Floor seen so far, cells of the plan, and walls next to it, around the robot and in its frame."""
    floor = seen.astype(np.uint8)
    near = cv2.dilate(floor, np.ones((3, 3), np.uint8))
    known = np.where(seen, _FLOOR, np.where((near > 0) & ~plan.free, _WALL, 0)).astype(np.uint8)
    # Centres of pixel (0, 0) of the map and of its two neighbours, in cells of the plan.
    half = (cells - 1) / 2 * cell_m
    ahead_left = np.array([[half, half], [half, half - cell_m], [half - cell_m, half]])
    c, s = np.cos(pose[2]), np.sin(pose[2])
    at = plan.to_cells(pose[:2] + ahead_left @ np.array([[c, s], [-s, c]])) - 0.5
    affine = np.column_stack([at[1] - at[0], at[2] - at[0], at[0]])
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(known, affine, (cells, cells), flags=flags, borderValue=0)[..., None]
