"""Bags of a robot in a made hall, written by `rosbags` in all formats."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
STORE1 = get_typestore(Stores.ROS1_NOETIC)
STORE1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
#: Pose of the laser on the base [m, rad], and its height [m].
MOUNT, MOUNT_Z = np.array([0.2, -0.05, 0.3]), 0.25
#: Formats of bags.
FORMATS = ("ros1", "sqlite", "mcap")


def message(kind: str, *values: Any, is_ros1: bool = False, **named: Any) -> Any:
    """A message of a type of ROS."""
    return (STORE1 if is_ros1 else STORE).types[kind](*values, **named)


def header(time_s: float, frame: str, is_ros1: bool) -> Any:
    """A header."""
    sec = int(time_s)
    stamp = message(
        "builtin_interfaces/msg/Time", sec=sec, nanosec=round(1e9 * (time_s - sec)), is_ros1=is_ros1
    )
    more = {"seq": 0} if is_ros1 else {}
    return message("std_msgs/msg/Header", stamp=stamp, frame_id=frame, is_ros1=is_ros1, **more)


def placed(
    pose: Sequence[float], z: float = 0.0, *, inverted: bool = False, is_ros1: bool = False
) -> tuple[Any, Any]:
    """Translation and rotation of a pose; inverted ones are rolled by half a turn."""
    half = pose[2] / 2
    turn = (np.cos(half), np.sin(half), 0.0, 0.0) if inverted else (0.0, 0.0, np.sin(half), np.cos(half))
    vector = message("geometry_msgs/msg/Vector3", x=float(pose[0]), y=float(pose[1]), z=z, is_ros1=is_ros1)
    quaternion = message("geometry_msgs/msg/Quaternion", *map(float, turn), is_ros1=is_ros1)
    return vector, quaternion


def transform(time_s: float, parent: str, child: str, place: tuple[Any, Any], is_ros1: bool = False) -> Any:
    """A TFMessage with one transform."""
    both = message("geometry_msgs/msg/Transform", translation=place[0], rotation=place[1], is_ros1=is_ros1)
    one = message(
        "geometry_msgs/msg/TransformStamped",
        header=header(time_s, parent, is_ros1),
        child_frame_id=child,
        transform=both,
        is_ros1=is_ros1,
    )
    return message("tf2_msgs/msg/TFMessage", transforms=[one], is_ros1=is_ros1)


def laser_scan(
    time_s: float,
    bearing: np.ndarray,
    ranges: np.ndarray,
    *,
    frame: str = "laser",
    step_s: float = 0.0,
    is_ros1: bool = False,
    range_max: float = 30.0,
    range_min: float = 0.1,
) -> Any:
    """A LaserScan."""
    return message(
        "sensor_msgs/msg/LaserScan",
        header=header(time_s, frame, is_ros1),
        angle_min=float(bearing[0]),
        angle_max=float(bearing[-1]),
        angle_increment=float(bearing[1] - bearing[0]),
        time_increment=step_s,
        scan_time=0.0,
        range_min=range_min,
        range_max=range_max,
        ranges=ranges.astype(np.float32),
        intensities=np.zeros(0, np.float32),
        is_ros1=is_ros1,
    )


def odometry(time_s: float, pose: np.ndarray, *, child: str = "base_link", is_ros1: bool = False) -> Any:
    """An Odometry message."""
    vector, quaternion = placed(pose, is_ros1=is_ros1)
    point = message("geometry_msgs/msg/Point", x=vector.x, y=vector.y, z=0.0, is_ros1=is_ros1)
    zero = message("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0, is_ros1=is_ros1)
    return message(
        "nav_msgs/msg/Odometry",
        header=header(time_s, "odom", is_ros1),
        child_frame_id=child,
        pose=message(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=message("geometry_msgs/msg/Pose", position=point, orientation=quaternion, is_ros1=is_ros1),
            covariance=np.zeros(36),
            is_ros1=is_ros1,
        ),
        twist=message(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=message("geometry_msgs/msg/Twist", linear=zero, angular=zero, is_ros1=is_ros1),
            covariance=np.zeros(36),
            is_ros1=is_ros1,
        ),
        is_ros1=is_ros1,
    )


def write_bag(
    path: Path,
    kind: str,
    messages: Sequence[tuple[str, float, Any]],
    names: Mapping[str, str] = MappingProxyType({}),
    **options: Any,
) -> Path:
    """Write messages with their topics and times of arrival [s]; returns what a user would name.

    `names` are other names of types, by the last word of those of ROS.
    """
    store = STORE1 if kind == "ros1" else STORE
    for word, name in names.items():
        original = next(each for each in store.fielddefs if each.rpartition("/")[2] == word)
        if name not in store.fielddefs:
            store.register({name: store.fielddefs[original]})
    writer: Any
    if kind == "ros1":
        path = path.with_suffix(".bag")
        writer = Writer1(path)
        if "compression" in options:
            writer.set_compression(options["compression"])
        encode: Callable[[Any, str], Any] = store.serialize_ros1
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        encode = store.serialize_cdr
    with writer:
        connections: dict[str, Any] = {}
        for topic, time_s, one in messages:
            name = names.get(one.__msgtype__.rpartition("/")[2], one.__msgtype__)
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            writer.write(connections[topic], round(1e9 * time_s), encode(one, name))
    return path
