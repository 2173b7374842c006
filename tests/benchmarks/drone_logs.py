"""Log of a small drone with four rangers, a ROS 1 bag of Zhou et al., Efficient 2D graph SLAM for sparse sensing, 2022.

Its messages are arrays of 32-bit floats: place and velocity by the drone's own estimate; and ranges to the right,
front, left, back and up, then the orientation as a quaternion (x, y, z, w). This order of the rangers fills the fewest
cells of 10 cm at the drone's own poses: 7,670; the next of all 24 orders fills 8,152.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.logs.robot_log import RobotLog
from slam.poses import between

#: Rangers are read as far as this [m]; their specified range is 4 m.
RANGE_M = 3.5
#: Every so many measurements (10 Hz) make one scan, from this height on [m].
_EVERY, _FLYING_M = 5, 0.3


def read_drone_log(path: Path) -> RobotLog:
    """Scans of four beams, and displacements by the drone's own estimate.

    Raises:
        ModuleNotFoundError: If the package `rosbags` is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError:
        raise ModuleNotFoundError(f"{path}: bags need the package `rosbags`: pip install rosbags") from None
    rows: dict[str, list[list[float]]] = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS1_NOETIC)) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp
            row = [stamp.sec + 1e-9 * stamp.nanosec, *message.raw]
            rows.setdefault(connection.topic.rsplit("/", 1)[-1], []).append(row)
    return drone_log(path.stem, np.array(rows["state_xyzv"]), np.array(rows["state_ranger_qxyzw"]))


def drone_log(name: str, places: Float[np.ndarray, "n p"], measured: Float[np.ndarray, "n 10"]) -> RobotLog:
    """The log of rows: time [s], place (x, y, z) [m] and more; time, five ranges [m] and the quaternion."""
    flying = places[:, 3] > _FLYING_M
    places, measured = places[flying][::_EVERY], measured[flying][::_EVERY]
    x, y, z, w = measured[:, 6:].T
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    poses = np.column_stack([places[:, 1:3], yaw])
    steps = [between(before, after) for before, after in pairwise(poses)]
    ranges = measured[:, 1:5]
    return RobotLog(
        name=name,
        bearing_rad=np.radians([-90.0, 0.0, 90.0, 180.0]),
        range_m=np.where(ranges < RANGE_M, ranges, np.inf),
        displacement=np.array([np.zeros(3), *steps]),
        known=np.ones(len(poses), bool),
        times=measured[:, 0] - measured[0, 0],
    )
