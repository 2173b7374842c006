"""Observations of a log, scan after scan: an agent (`robosim.agent`) maps and decides along a recorded drive.

The drive is recorded, so the agent's commands are not carried out: the action before an observation is the velocity by
odometry.
"""

from collections.abc import Iterator

import numpy as np

from robosim.logs.log_mapping import LogConfig
from robosim.logs.robot_log import RobotLog
from robosim.simulator import Observation
from slam.actions import Velocity
from slam.mapping.classical import ClassicalMapper, MapperConfig
from slam.odometry import ActionError, OdometryConfig
from slam.robot import Robot
from slam.sensing.laser import LaserScan

#: Farther surfaces do not count as measured [m].
_FARTHEST_M = 25.0
#: Least time between scans [s].
_LEAST_S = 1e-3


def observations(log: RobotLog, height_m: float = 0.2) -> Iterator[Observation]:
    """Yield an observation for each scan of a log: scan, odometry and velocity, and no picture.

    Args:
        log: Scans and odometry; beams count as measured at the time of their scan.
        height_m: Height of the beams above the floor [m].
    """
    # Scanners of the simulator sit on the robot's middle line.
    log = log.seen_from(np.array([0.0, log.mount[1], 0.0]))
    no_picture, no_depth = np.zeros((2, 2, 3), np.uint8), np.zeros((2, 2), np.float32)
    bearings, step_s = log.beams(), np.maximum(np.diff(log.times, prepend=log.times[0]), _LEAST_S)
    for k, (bearing_rad, range_m) in enumerate(zip(bearings, log.range_m, strict=True)):
        dx, _, turn = log.displacement[k] / step_s[k]
        yield Observation(
            rgb=no_picture,
            depth=no_depth,
            odometry=log.displacement[k],
            laser=LaserScan(
                bearing_rad=np.array(bearing_rad) + log.mount[2],
                range_m=np.where(range_m < _FARTHEST_M, range_m, np.inf),
                max_range_m=_FARTHEST_M,
                height_m=height_m,
                ahead_m=float(log.mount[0]),
            ),
            time_s=float(step_s[k]) if k else None,
            action=Velocity(float(dx), float(turn), float(step_s[k])) if k else None,
        )


def mapper_of(log: RobotLog, config: LogConfig | None = None) -> ClassicalMapper:
    """Make a mapper for a log, with the matching, the drift and the errors of odometry of `map_log`."""
    config = config or LogConfig()
    tracker = config.tracker(loops=True, step_rad=log.step_rad())
    place, yaw = config.odometry.position_m**2, config.odometry.yaw_rad**2
    error = ActionError(covariance=((place, 0.0, 0.0), (0.0, place, 0.0), (0.0, 0.0, yaw)))
    robot = Robot(camera=None, odometry=OdometryConfig(forward=error, left=error, right=error))
    settings = MapperConfig(resolution_m=config.resolution_m, match=tracker.match, tracking=tracker)
    return ClassicalMapper(robot, settings)
