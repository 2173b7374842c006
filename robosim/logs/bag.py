"""Logs of robots in ROS 1 and ROS 2 bags (SQLite and MCAP), read without ROS by `rosbags`.

Scans are of the first of these types that has messages: LaserScan, MultiEchoLaserScan (first echoes), PointCloud2 and
depth images with their CameraInfo; of the last two, points in a slice at a height above the base become a scan.
Odometry is that of Odometry messages or of transforms. Transforms that never change give the place of the sensor on the
base, those that do give odometry (REP 105: odom to base_link). Times are those of the headers, or of the recording
where headers have none. Readings that come late or twice are sorted and dropped, and reported.
"""

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robosim.logs.beam_times import OdometryTrack
from robosim.logs.robot_log import BagTopics, LogReader, RobotLog, report_track, with_beam_times
from robosim.support.installation import is_installed, missing_extra
from robosim.support.reading import FileError, naming
from slam.poses import compose

logger = logging.getLogger(__name__)

#: First bytes of bags.
_MAGIC = (b"#ROSBAG", b"\x89MCAP", b"SQLite format 3")
_REMEDY = "Record or export it again, such as by rosbags-convert."
_LASERS = ("sensor_msgs/msg/LaserScan", "sensor_msgs/msg/MultiEchoLaserScan")
_POINTS, _IMAGE, _CAMERA = (
    "sensor_msgs/msg/PointCloud2",
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CameraInfo",
)
_ODOMETRY, _TF = "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
#: Encodings of depth images, and their unit [m].
_DEPTHS = {"16UC1": ("u2", 1e-3), "mono16": ("u2", 1e-3), "32FC1": ("f4", 1.0)}
#: Types of fields of point clouds.
_FIELDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
#: Half the height of a slice [m], and directions of the scan made of it.
_HALF_SLICE_M, _DIRECTIONS = 0.1, 720
#: A transform that changes by less is fixed [m or share of a turn]. A laser may be tipped by this [rad].
_FIXED, _MOST_TIPPED = 1e-6, math.radians(20)
#: A forward-looking camera's axes (x right, y down, z ahead) in those of its body (REP 103).
_OPTICAL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])

Matrix = Float[np.ndarray, "4 4"]


class _Scan(NamedTuple):
    """Ranges of one message, counter-clockwise, and when its first and last beam are measured after its time [s]."""

    time_s: float
    bearing_rad: Float[np.ndarray, " w"]
    range_m: Float[np.ndarray, " w"]
    beam_s: tuple[float, float] | None = None


class _Transforms:
    """Transforms over time, by the child's frame: the parent's, and times with places in it."""

    def __init__(self) -> None:
        self._by_child: dict[str, tuple[str, list[tuple[float, Matrix]]]] = {}

    def add(self, message: Any) -> None:
        """Add those of a message; the first parent of a frame counts."""
        for transform in message.transforms:
            parent, seen = self._by_child.setdefault(
                _frame(transform.child_frame_id), (_frame(transform.header.frame_id), [])
            )
            if parent == _frame(transform.header.frame_id):
                seen.append(
                    (
                        _stamp(transform.header),
                        _matrix(transform.transform.translation, transform.transform.rotation),
                    )
                )

    def fixed(self, sensor: str) -> dict[str, Matrix]:
        """Frames that fixed transforms lead to from a sensor, nearest first, with the sensor's place in each."""
        frame, places = sensor, {sensor: np.eye(4)}
        while frame in self._by_child and not self._moves(frame):
            parent, seen = self._by_child[frame]
            if parent in places:
                break
            places[parent] = seen[0][1] @ places[frame]
            frame = parent
        return places

    def track_of(self, base: str) -> OdometryTrack | None:
        """Poses of a frame in its parent; None if it does not move."""
        if base not in self._by_child or not self._moves(base):
            return None
        return _track([(time, _planar(matrix)) for time, matrix in self._by_child[base][1]])

    def _moves(self, frame: str) -> bool:
        seen = self._by_child[frame][1]
        return any(np.abs(matrix - seen[0][1]).max() > _FIXED for _, matrix in seen)


def is_bag(path: Path) -> bool:
    """Whether a path is a ROS 1 bag, a ROS 2 bag or a folder with one, or an MCAP file."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(16).startswith(_MAGIC)


class BagReader(LogReader):
    """Reads bags."""

    def matches(self, path: Path) -> bool:
        """Whether a path is a bag."""
        return is_bag(path)

    def read(self, path: Path, scans: Path | None, topics: BagTopics) -> RobotLog:
        """Read a bag; see `read_bag`."""
        log = read_bag(path, topics)
        if log.track is not None:
            report_track(path, log.track)
        return log


def read_bag(path: Path, topics: BagTopics | None = None) -> RobotLog:
    """Read scans and odometry of a bag.

    Raises:
        FileError: If the bag is damaged, lacks scans, or has several topics to choose from.
        ImportError: If `rosbags` is not installed.
    """
    if not is_installed("rosbags"):
        raise missing_extra("rosbags", f"{path}: a ROS bag")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    topics = topics or BagTopics()
    with (
        naming(path, "a ROS bag", _REMEDY),
        AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader,
    ):

        def messages(*wanted: str) -> Iterator[Any]:
            chosen = [one for one in reader.connections if one.topic in wanted]
            # Without a connection, `rosbags` yields all messages.
            for connection, time_ns, raw in reader.messages(chosen) if chosen else ():
                message = reader.deserialize(raw, connection.msgtype)
                if hasattr(message, "header") and _stamp(message.header) == 0:
                    stamp = message.header.stamp
                    stamp.sec, stamp.nanosec = divmod(time_ns, 10**9)
                yield message

        types = {one.topic: one.msgtype for one in reader.connections if one.msgcount}
        colour = {
            topic
            for topic, kind in types.items()
            if kind == _IMAGE and next(messages(topic)).encoding not in _DEPTHS
        }
        scans = _scan_topic(types, colour, topics.scan_topic)
        odometry = _choice(types, topics.odometry_topic, (_ODOMETRY,), "odometry", "--odometry-topic")
        transforms, track = _Transforms(), None
        for message in messages(*(name for name, kind in types.items() if kind == _TF)):
            transforms.add(message)
        frame = _frame(next(messages(scans)).header.frame_id)
        places = transforms.fixed(frame)
        base = list(places)[-1]
        if odometry is not None:
            readings = list(messages(odometry))
            base = _frame(readings[0].child_frame_id) or base
            if base not in places:
                logger.warning(
                    "%s: no fixed transform leads from %s to %s: the sensor counts as at the base.",
                    path,
                    frame,
                    base,
                )
            poses = [
                _planar(_matrix(reading.pose.pose.position, reading.pose.pose.orientation))
                for reading in readings
            ]
            track = _track([(_stamp(one.header), pose) for one, pose in zip(readings, poses, strict=True)])
        else:
            track = transforms.track_of(base)
        place = places.get(base, np.eye(4))
        if types[scans] not in _LASERS and len(places) == 1:
            logger.warning(
                "%s: no transform has %s: --slice-m counts from the sensor, which looks ahead.", path, frame
            )
            place = _OPTICAL if types[scans] == _IMAGE else place
        cameras = {name for name, kind in types.items() if kind == _CAMERA}
        cameras_of_frame = [one for one in messages(*cameras) if _frame(one.header.frame_id) == frame]
        make = _maker(types[scans], place, topics.slice_m, cameras_of_frame)
        scans_in_order = _in_order(path, [make(message) for message in messages(scans)])
        return _log(path, scans_in_order, track, _mount(place, types[scans] in _LASERS))


def _scan_topic(types: dict[str, str], colour: set[str], given: str | None) -> str:
    """The topic that scans come from; not one with colour images."""
    usable = {topic: kind for topic, kind in types.items() if topic not in colour}
    kinds = (*_LASERS, _POINTS, _IMAGE)
    for kind in (kinds,) if given else ((one,) for one in kinds):
        if (found := _choice(usable, given, kind, "scans", "--scan-topic")) is not None:
            return found
    shown = ", ".join(f"{name} ({kind})" for name, kind in sorted(types.items())) or "none"
    raise FileError(
        f"has no topic of {', '.join(kinds)}; its topics are {shown}. Record scans, or convert them to a TUM file and "
        "--scans."
    )


def _choice(
    types: dict[str, str], given: str | None, kinds: tuple[str, ...], what: str, option: str
) -> str | None:
    """A topic of some types: the given one, or the only one; None if there is none."""
    if given == "tf":
        return None
    names = sorted(name for name, kind in types.items() if kind in kinds)
    if given is not None:
        if given not in names:
            expected = ", ".join(names) or "none"
            raise FileError(f"{given!r} is no topic of {what} in it, expected one of {expected}.")
        return given
    if len(names) > 1:
        raise FileError(f"has {len(names)} topics of {what}: {', '.join(names)}. Choose one by {option}.")
    return names[0] if names else None


def _maker(kind: str, place: Matrix, slice_m: float, cameras: Sequence[Any]) -> Callable[[Any], _Scan]:
    """Makes scans of messages of a type from a sensor at a place."""
    if kind in _LASERS:
        return lambda message: _laser_scan(message, bool(place[2, 2] < 0))
    if kind == _POINTS:
        return lambda message: _slice(message, _cloud_points(message), place, slice_m)
    if not cameras:
        raise ValueError(f"it has depth images, and no {_CAMERA} of their frame")
    info = cameras[0]
    intrinsics = np.array(info.k if hasattr(info, "k") else info.K).reshape(3, 3)  # of ROS 2 and 1
    return lambda message: _slice(message, _depth_points(message, intrinsics), place, slice_m)


def _laser_scan(message: Any, is_inverted: bool) -> _Scan:
    """A scan; ranges beyond the largest hit nothing, those below the least and NaN were not measured."""
    if hasattr(message.ranges, "dtype"):
        ranges = np.asarray(message.ranges, float)
    else:
        ranges = np.array([echo.echoes[0] if len(echo.echoes) else np.nan for echo in message.ranges], float)
    with np.errstate(invalid="ignore"):
        ranges = np.where(ranges < max(message.range_min, 1e-3), np.nan, ranges)
        ranges = np.where(ranges > message.range_max, np.inf, ranges)
    n = len(ranges)
    bearing = message.angle_min + message.angle_increment * np.arange(n)
    step_s = float(message.time_increment)
    ends_s = (0.0, step_s * (n - 1))
    if is_inverted:
        bearing = -bearing
    if n > 1 and bearing[1] < bearing[0]:
        bearing, ranges, ends_s = bearing[::-1], ranges[::-1], ends_s[::-1]
    if n and bearing[0] < -np.pi - 1e-6:
        bearing = bearing + 2 * np.pi
    return _Scan(_stamp(message.header), bearing, ranges, ends_s if step_s > 0 else None)


def _slice(message: Any, points: Float[np.ndarray, "n 3"], place: Matrix, slice_m: float) -> _Scan:
    """The nearest points in each direction around the sensor, of those at a height above the base."""
    placed = points @ place[:3, :3].T + place[:3, 3]
    x, y = (placed[np.abs(placed[:, 2] - slice_m) <= _HALF_SLICE_M, :2] - place[:2, 3]).T
    column = np.floor((np.arctan2(y, x) + np.pi) / (2 * np.pi) * _DIRECTIONS).astype(int) % _DIRECTIONS
    ranges = np.full(_DIRECTIONS, np.inf)
    np.minimum.at(ranges, column, np.hypot(x, y))
    bearing = -np.pi + (np.arange(_DIRECTIONS) + 0.5) * 2 * np.pi / _DIRECTIONS
    return _Scan(_stamp(message.header), bearing, np.where(np.isfinite(ranges), ranges, np.nan))


def _cloud_points(message: Any) -> Float[np.ndarray, "n 3"]:
    """Points of a cloud in its frame."""
    order = ">" if message.is_bigendian else "<"
    fields = {field.name: field for field in message.fields}
    if missing := [name for name in "xyz" if name not in fields]:
        raise ValueError(f"its point clouds have no field {missing[0]!r}, but {', '.join(fields)}")
    dtype = np.dtype(
        {
            "names": list("xyz"),
            "formats": [order + _FIELDS[fields[name].datatype] for name in "xyz"],
            "offsets": [fields[name].offset for name in "xyz"],
            "itemsize": message.point_step,
        }
    )
    rows = np.asarray(message.data, np.uint8).reshape(message.height, message.row_step)
    cloud = np.ascontiguousarray(rows[:, : message.width * message.point_step]).view(dtype)
    points = np.stack([cloud[name].ravel().astype(float) for name in "xyz"], axis=1)
    return points[np.isfinite(points).all(axis=1)]


def _depth_points(message: Any, intrinsics: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "n 3"]:
    """Points of a depth image in the optical frame."""
    kind, unit_m = _DEPTHS[message.encoding]
    rows = np.asarray(message.data, np.uint8).reshape(message.height, message.step)
    width = message.width * np.dtype(kind).itemsize
    order = ">" if message.is_bigendian else "<"
    depth = unit_m * np.ascontiguousarray(rows[:, :width]).view(order + kind).astype(float)
    v, u = np.nonzero(np.isfinite(depth) & (depth > 0))
    z = depth[v, u]
    (fx, _, cx), (_, fy, cy), _ = intrinsics
    return np.column_stack([(u - cx) / fx * z, (v - cy) / fy * z, z])


def _in_order(path: Path, scans: list[_Scan]) -> list[_Scan]:
    """Scans by rising times, without those of a time that is there already."""
    ordered = sorted(scans, key=lambda scan: scan.time_s)
    rising = [ordered[0], *(b for a, b in pairwise(ordered) if b.time_s > a.time_s)]
    late = sum(b.time_s < a.time_s for a, b in pairwise(scans))
    if late or len(rising) < len(scans):
        logger.warning(
            "%s: %d scans come before an earlier one and are sorted, %d have the time of another and are left out",
            path,
            late,
            len(scans) - len(rising),
        )
    if len(rising) < 2:
        raise ValueError(f"{len(rising)} scans in it, expected two at least")
    return rising


def _log(
    path: Path, scans: list[_Scan], track: OdometryTrack | None, mount: Float[np.ndarray, "3"]
) -> RobotLog:
    """The log; without odometry all displacements are unknown."""
    times = np.array([scan.time_s for scan in scans])
    width = max(len(scan.bearing_rad) for scan in scans)
    if width < 1:
        raise ValueError("its scans have no beams")
    bearing = np.array([_padded(scan.bearing_rad, width) for scan in scans])
    ranges = np.array([np.append(scan.range_m, np.full(width - len(scan.range_m), np.nan)) for scan in scans])
    if (bearing == bearing[0]).all():
        bearing = bearing[0]
    if track is None:
        logger.warning(
            "%s: it has neither odometry nor transforms of the base: scans alone give the motion.", path
        )
        displacement, known = np.zeros((len(times), 3)), np.arange(len(times)) == 0
    else:
        track = OdometryTrack(
            times=track.times, poses=np.array([compose(pose, mount) for pose in track.poses])
        )
        displacement, known = track.steps(times)
        inside = (times >= track.times[0]) & (times <= track.times[-1])
        known[1:] &= inside[1:] & inside[:-1]
        displacement[~known] = 0.0
    log = RobotLog(
        name=path.stem,
        file=path,
        bearing_rad=bearing,
        range_m=ranges,
        displacement=displacement,
        known=known,
        times=times,
        track=track,
    )
    return log if scans[0].beam_s is None else with_beam_times(log, *scans[0].beam_s)


def _padded(bearing: Float[np.ndarray, " w"], width: int) -> Float[np.ndarray, " v"]:
    """Bearings with the last one repeated."""
    return np.append(bearing, np.full(width - len(bearing), bearing[-1] if len(bearing) else 0.0))


def _track(readings: list[tuple[float, Float[np.ndarray, "3"]]]) -> OdometryTrack:
    """Odometry by rising times."""
    times, first = np.unique([time for time, _ in readings], return_index=True)
    return OdometryTrack(times=times, poses=np.array([readings[i][1] for i in first]))


def _mount(place: Matrix, is_laser: bool) -> Float[np.ndarray, "3"]:
    """Pose of a laser on its base; the scan made of a slice has the axes of the base."""
    if not is_laser:
        return np.array([place[0, 3], place[1, 3], 0.0])
    if abs(place[2, 2]) < math.cos(_MOST_TIPPED):
        tipped = math.degrees(math.acos(np.clip(abs(place[2, 2]), 0, 1)))
        raise ValueError(
            f"the laser is tipped by {tipped:.0f} degrees, expected a plane parallel to the floor within "
            f"{math.degrees(_MOST_TIPPED):.0f}"
        )
    return _planar(place)


def _planar(matrix: Matrix) -> Float[np.ndarray, "3"]:
    """x, y and yaw of a transform."""
    return np.array([matrix[0, 3], matrix[1, 3], math.atan2(matrix[1, 0], matrix[0, 0])])


def _matrix(translation: Any, rotation: Any) -> Matrix:
    """A transform of ROS as a matrix; ValueError if its quaternion is zero."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat([rotation.x, rotation.y, rotation.z, rotation.w]).as_matrix()
    matrix[:3, 3] = translation.x, translation.y, translation.z
    return matrix


def _frame(name: str) -> str:
    """A frame's name, which ROS 1 may begin with a slash."""
    return name.lstrip("/")


def _stamp(header: Any) -> float:
    """Time of a header [s]."""
    return float(header.stamp.sec + 1e-9 * header.stamp.nanosec)
