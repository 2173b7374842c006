"""Scans made of messages of bags: of planar lasers, and of point clouds and depth images in a slice."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from robosim.logs.bag_messages import CLOUD, ECHOES, IMAGE, POINTS, SCAN
from robosim.logs.frames import stamp_s
from robosim.support.reading import FileError

LASERS = (SCAN, ECHOES)
SOURCES = (LASERS, (POINTS,), (CLOUD,), (IMAGE,))
"""Kinds of messages that scans come from, the first that a bag has."""
#: Encodings of depth images, and their unit [m].
DEPTHS = {"16UC1": ("u2", 1e-3), "mono16": ("u2", 1e-3), "32FC1": ("f4", 1.0)}
#: Types of fields of point clouds.
_FIELDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
#: Half the height of a slice [m], and directions of the scan made of it.
_HALF_SLICE_M, _DIRECTIONS = 0.1, 720
#: Beams span no larger angle, and are no nearer to each other [rad].
_MOST_TURN, _LEAST_STEP = 2.1 * math.pi, 1e-5
#: Beams of a scan follow each other within [s].
_LONGEST_S = 10.0

Matrix = Float[np.ndarray, "4 4"]


class Scan(NamedTuple):
    """Ranges of one message, counter-clockwise, and when its first and last beam are measured after its time [s]."""

    time_s: float
    bearing_rad: Float[np.ndarray, " w"]
    range_m: Float[np.ndarray, " w"]
    beam_s: tuple[float, float] | None = None
    limit_m: float = math.inf
    """Longest range that the sensor measures [m]."""
    beyond_rad: float = 0.0
    """How far `angle_max` is from the last beam."""


def scan_maker(
    kind: str, place: Matrix, slice_m: float, cameras: Sequence[Any], is_rectified: bool = False
) -> Callable[[Any], Scan]:
    """Makes scans of messages of a type from a sensor at a place."""
    if kind in LASERS:
        return lambda message: _laser_scan(message, bool(place[2, 2] < 0))
    if kind in (POINTS, CLOUD):
        return lambda message: _slice(message, _cloud_points(message), place, slice_m)
    if not cameras:
        raise ValueError("it has depth images, and no CameraInfo of their frame")
    info = cameras[0]
    k, p, _ = _matrices(info)
    # Pixels of raw images are those of K, and of rectified ones of P; uncalibrated drivers leave P zero.
    intrinsics = p if is_rectified and p.any() else k
    if not (np.isfinite(intrinsics).all() and intrinsics[0, 0] > 0 < intrinsics[1, 1]):
        fx, fy = intrinsics[0, 0], intrinsics[1, 1]
        raise FileError(f"CameraInfo has the focal lengths {fx:g} and {fy:g} px. Record a calibrated camera.")
    # Intrinsics are those of the whole picture; images are a region of it, of binned pixels.
    binning, region = np.maximum([info.binning_x, info.binning_y], 1), info.roi
    intrinsics[:2, 2] -= region.x_offset, region.y_offset
    intrinsics[:2] /= binning[:, None]
    size = ([region.width or info.width, region.height or info.height] // binning).tolist()
    return lambda message: _slice(message, _depth_points(message, size, intrinsics), place, slice_m)


def is_distorted(info: Any) -> bool:
    """Whether raw images of a camera differ from rectified ones."""
    k, p, d = _matrices(info)
    return bool(d.any() or (p.any() and not np.allclose(k, p)))


def _matrices(
    info: Any,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"], Float[np.ndarray, " n"]]:
    """K, the left part of P, and D of a CameraInfo, of ROS 2 and 1."""
    k, p, d = (np.array(getattr(info, name, getattr(info, name.upper(), ())), float) for name in "kpd")
    return k.reshape(3, 3), p.reshape(3, 4)[:, :3].copy(), d


def _laser_scan(message: Any, is_inverted: bool) -> Scan:
    """A scan; ranges below the least and NaN were not measured, infinite ones hit nothing.

    Raises:
        FileError: If its angles or limits are impossible.
    """
    if hasattr(message.ranges, "dtype"):
        ranges = np.asarray(message.ranges, float)
    else:
        ranges = np.array([echo.echoes[0] if len(echo.echoes) else np.nan for echo in message.ranges], float)
    n, time_s = len(ranges), stamp_s(message.header)
    first, step, limit_m = float(message.angle_min), float(message.angle_increment), float(message.range_max)
    least_m, step_s = float(message.range_min), float(getattr(message, "time_increment", 0.0))
    for value, name, good, expected in (
        (first, "angle_min", abs(first) <= 4 * math.pi, "an angle in radians"),
        (
            step,
            "angle_increment",
            _LEAST_STEP <= abs(step) <= abs(step) * max(n - 1, 1) <= _MOST_TURN,
            f"a turn of beams at most, in radians, and {_LEAST_STEP:g} or more",
        ),
        (limit_m, "range_max", limit_m > 0, "a positive range in metres"),
        (least_m, "range_min", abs(least_m) < limit_m, f"metres below range_max, which is {limit_m:g}"),
        (step_s, "time_increment", 0 <= step_s * n <= _LONGEST_S, f"{_LONGEST_S:g} s for all beams at most"),
    ):
        if not good:
            raise FileError(
                f"the scan at {time_s:.3f} s has {name} {value:g} and {n} beams, expected {expected}. Mend the "
                "driver's settings, and record again."
            )
    with np.errstate(invalid="ignore"):
        ranges = np.where(ranges < max(least_m, 1e-3), np.nan, ranges)
    bearing = first + step * np.arange(n)
    beyond_rad = abs(float(message.angle_max) - bearing[-1]) if n else 0.0
    ends_s = (0.0, step_s * (n - 1))
    if is_inverted:
        bearing = -bearing
    if n > 1 and bearing[1] < bearing[0]:
        bearing, ranges, ends_s = bearing[::-1], ranges[::-1], ends_s[::-1]
    if n and bearing[0] < -np.pi - 1e-6:
        bearing = bearing + 2 * np.pi
    return Scan(time_s, bearing, ranges, ends_s if step_s > 0 else None, limit_m, beyond_rad)


def _slice(message: Any, points: Float[np.ndarray, "n 3"], place: Matrix, slice_m: float) -> Scan:
    """The nearest points in each direction around the sensor, of those at a height above the base."""
    placed = points @ place[:3, :3].T + place[:3, 3]
    x, y = (placed[np.abs(placed[:, 2] - slice_m) <= _HALF_SLICE_M, :2] - place[:2, 3]).T
    column = np.floor((np.arctan2(y, x) + np.pi) / (2 * np.pi) * _DIRECTIONS).astype(int) % _DIRECTIONS
    ranges = np.full(_DIRECTIONS, np.inf)
    np.minimum.at(ranges, column, np.hypot(x, y))
    bearing = -np.pi + (np.arange(_DIRECTIONS) + 0.5) * 2 * np.pi / _DIRECTIONS
    return Scan(stamp_s(message.header), bearing, np.where(np.isfinite(ranges), ranges, np.nan))


def _cloud_points(message: Any) -> Float[np.ndarray, "n 3"]:
    """Points of a cloud in its frame."""
    if hasattr(message, "channels"):  # PointCloud, of ROS before PointCloud2
        points = np.array([(point.x, point.y, point.z) for point in message.points], float).reshape(-1, 3)
        return points[np.isfinite(points).all(axis=1)]
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
    cloud = _rows(message, message.row_step, message.point_step).view(dtype)
    points = np.stack([cloud[name].ravel().astype(float) for name in "xyz"], axis=1)
    # Where nothing is measured, lidars give NaN or the place of the sensor.
    return points[np.isfinite(points).all(axis=1) & points.any(axis=1)]


def _rows(message: Any, row_bytes: int, pixel_bytes: int) -> UInt8[np.ndarray, "h w"]:
    """Rows of a cloud or an image without their padding."""
    rows = np.asarray(message.data, np.uint8).reshape(message.height, row_bytes)
    if (n_bytes := message.width * pixel_bytes) > row_bytes:
        raise ValueError(
            f"its rows have {row_bytes} bytes, expected {n_bytes} of {message.width} points or more"
        )
    return np.ascontiguousarray(rows[:, :n_bytes])


def _depth_points(
    message: Any, size: list[int], intrinsics: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "n 3"]:
    """Points of a depth image in the optical frame; FileError if it has another size than its CameraInfo states."""
    if all(size) and [message.width, message.height] != size:
        raise FileError(
            f"a depth image has {message.width} x {message.height} pixels, expected {size[0]} x {size[1]} by its "
            "CameraInfo. Record the CameraInfo of the depth images."
        )
    kind, unit_m = DEPTHS[message.encoding]
    order = ">" if message.is_bigendian else "<"
    depth = unit_m * _rows(message, message.step, np.dtype(kind).itemsize).view(order + kind).astype(float)
    v, u = np.nonzero(np.isfinite(depth) & (depth > 0))
    z = depth[v, u]
    (fx, _, cx), (_, fy, cy), _ = intrinsics
    return np.column_stack([(u - cx) / fx * z, (v - cy) / fy * z, z])
