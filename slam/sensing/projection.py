"""From a depth image of a level camera to points, and to a scan.

A pixel (u, v) with depth z lies z ahead of the camera, z (c_u - u) / f to its left and z (v - c_v) / f below
it. All pixels of one column share their bearing, so what a robot on a flat floor needs of an image is, for
each column, the nearest depth at which something stands between floor and robot height: a 2-D scan. The floor
between robot and that surface is free.

A surface must fill two neighbouring rows of a column, which single wild pixels do not; its depth is then the
mean over the rows that see it, which averages sensor noise. Depth that is 0, not finite, or outside of
the limits means: nothing measured there.
Left out: tilted cameras, lens distortion, pixels that straddle an edge.
Reference: Hartley and Zisserman, Multiple View Geometry in Computer Vision, 2nd ed., 2004, section 6.1 (the pinhole).
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float, Float32

from robosim.support.checks import Range, checked

#: A number for each column of a picture.
Columns = Float32[np.ndarray, " w"]
#: Depth of each pixel [m], or its height [m].
Depths = Float32[np.ndarray, "h w"]


#: Points of a surface for each column of a scan: neighbours are of one if they lie no farther apart than this [m].
BETWEEN, ONE_SURFACE_M = 4, 0.2
#: Floor before something that is left out of a scan is seen up to this distance from it [m].
_BEFORE_M = 0.1


@dataclass(frozen=True, kw_only=True)
@checked
class CameraModel:
    """A level pinhole camera with square pixels that looks forward from above the robot's middle line."""

    hfov_deg: Annotated[float, Range(4, 170, "degrees", "The angle is in degrees, not in radians.")] = 90.0
    """Horizontal field of view [deg]."""
    height_m: Annotated[float, Range(0.01, 100, "m")] = 1.25
    """Height above the floor [m]."""
    ahead_m: Annotated[float, Range(-10, 10, "m")] = 0.0
    """How far it is ahead of the robot's centre [m]."""
    min_depth_m: Annotated[float, Range(0, 100, "m")] = 0.05
    """Nearer depths count as missing [m]."""
    max_depth_m: Annotated[float, Range(0.01, 1000, "m")] = 10.0
    """Farther depths count as missing [m]."""

    def __post_init__(self) -> None:
        if not self.min_depth_m < self.max_depth_m:
            raise ValueError(
                f"min_depth_m is {self.min_depth_m} and max_depth_m {self.max_depth_m}, expected the first below "
                "the other."
            )

    def slopes(self, shape: tuple[int, int]) -> tuple[Columns, Float32[np.ndarray, " h"]]:
        """Leftward offset of each column and fall of each row, per metre of depth."""
        h, w = shape
        focal = w / 2 / math.tan(math.radians(self.hfov_deg) / 2)
        left = (w / 2 - 0.5 - np.arange(w)) / focal
        down = (np.arange(h) + 0.5 - h / 2) / focal
        return left.astype(np.float32), down.astype(np.float32)


@dataclass(frozen=True, kw_only=True)
@checked
class Band:
    """Which heights above the floor stop the robot."""

    low_m: Annotated[float, Range(0, 100, "m")] = 0.10
    """Lower edge [m]: lower surfaces count as floor. The published map uses 0.25 m."""
    high_m: Annotated[float, Range(0, 100, "m")] = 1.50
    """Upper edge [m]: higher surfaces pass over the robot."""

    def __post_init__(self) -> None:
        if not self.low_m < self.high_m:
            raise ValueError(
                f"low_m is {self.low_m} and high_m {self.high_m}, expected the first below the other."
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """For each image column, the nearest surface that stops the robot. Columns run from left to right."""

    left: Float32[np.ndarray, " w"]
    """Leftward offset per metre of depth: tangent of the bearing."""
    depth_m: Float32[np.ndarray, " w"]
    """Depth of the nearest surface along the camera axis [m]; inf where none was seen."""
    clear_m: Float32[np.ndarray, " w"]
    """Depth up to which nothing stops the robot [m]; 0 where the column measured nothing."""
    top_m: Float32[np.ndarray, " w"]
    """Height of the highest row that saw the nearest surface [m]; 0 where none was seen."""
    far_m: Float32[np.ndarray, " w"]
    """Depth of the surface behind, where the nearest is lower than the camera and something taller follows [m];
    else inf."""
    ahead_m: float = 0.0
    """How far the camera is ahead of the robot's centre [m]."""

    @property
    def hit(self) -> Bool[np.ndarray, " w"]:
        """Columns that saw a surface."""
        return np.isfinite(self.depth_m)

    def without(self, columns: Bool[np.ndarray, " w"]) -> "Scan":
        """The scan with some columns that saw nothing but free floor up to where their surface was."""
        if not columns.any():
            return self
        nothing = np.float32(np.inf)
        return Scan(
            ahead_m=self.ahead_m,
            left=self.left,
            depth_m=np.where(columns, nothing, self.depth_m),
            clear_m=np.where(columns, np.maximum(self.clear_m - _BEFORE_M, 0), self.clear_m).astype(
                np.float32
            ),
            top_m=np.where(columns, np.float32(0), self.top_m),
            far_m=np.where(columns, nothing, self.far_m),
        )


def clean_depth(depth: Depths, camera: CameraModel) -> Depths:
    """Depth with every missing measurement (0, not finite, outside of the limits) set to inf."""
    known = (depth >= camera.min_depth_m) & (depth <= camera.max_depth_m)
    return np.where(known, depth, np.float32(np.inf))


def _band_limits(
    down: Float32[np.ndarray, " h"], camera: CameraModel, band: Band
) -> tuple[Float32[np.ndarray, "h 1"], Float32[np.ndarray, "h 1"]]:
    """Least and greatest depth [m] at which the rays of a row are within the band of heights."""
    with np.errstate(divide="ignore", invalid="ignore"):
        at_low, at_high = (camera.height_m - band.low_m) / down, (camera.height_m - band.high_m) / down
    first, last = np.minimum(at_low, at_high), np.maximum(at_low, at_high)
    # A ray that rises passes the lower edge behind the camera, and the camera may itself be in the band.
    inside = band.low_m < camera.height_m < band.high_m
    first = np.where(inside, 0.0, first)
    never = last <= 0
    return (
        np.where(never, np.inf, first).astype(np.float32)[:, None],
        np.where(never, -np.inf, last).astype(np.float32)[:, None],
    )


def scan_from_depth(depth: Depths, camera: CameraModel, band: Band = Band()) -> Scan:
    """The nearest surface in each column of a depth image, as a scan with one entry for each column."""
    left, down = camera.slopes(depth.shape)
    known = clean_depth(depth, camera)
    first, last = _band_limits(down, camera, band)
    standing = np.where((known >= first) & (known <= last), known, np.float32(np.inf))
    nearest = np.maximum(standing[:-1], standing[1:]).min(axis=0)
    hit = np.isfinite(nearest)
    reach = np.where(np.isfinite(known), known, 0.0).max(axis=0)
    depth_m, top_m = _surface(standing, np.where(hit, nearest, 0.0), down, camera)
    far_m = np.where(hit & (top_m < camera.height_m), _eye_level(standing, down), np.inf)
    far_m = np.where(far_m > depth_m + 0.1, far_m, np.inf).astype(np.float32)
    return Scan(
        left=left,
        depth_m=np.where(hit, depth_m, np.inf).astype(np.float32),
        clear_m=np.where(hit, depth_m, reach).astype(np.float32),
        top_m=np.where(hit, np.minimum(top_m, band.high_m), 0.0).astype(np.float32),
        far_m=far_m,
        ahead_m=camera.ahead_m,
    )


def _surface(
    standing: Depths, nearest: Columns, down: Float32[np.ndarray, " h"], camera: CameraModel
) -> tuple[Columns, Columns]:
    """Mean depth [m] and greatest height [m] of the rows that see the nearest surface of each column."""
    # The nearest of many noisy rows is some standard deviations short: the window opens farther than it closes.
    spread = 0.02 + 0.02 * nearest
    same = (standing >= nearest - spread) & (standing <= nearest + 2 * spread)
    count = np.maximum(same.sum(axis=0), 1)
    mean = (np.where(same, standing, 0.0).sum(axis=0) / count).astype(np.float32)
    top = camera.height_m - mean * down[np.argmax(same, axis=0)]
    return mean, top


def _eye_level(standing: Depths, down: Float32[np.ndarray, " h"]) -> Columns:
    """Depth [m] of what stands at the height of the camera; inf where nothing does."""
    middle = np.argsort(np.abs(down))[:2]
    return standing[middle].max(axis=0)


def dense_points(left: Columns, depth_m: Columns, range_m: float) -> Float[np.ndarray, "n 2"]:
    """Points of a scan with others in between on each surface, so that far walls have no holes.

    The inverse depth of a plane is linear in the column, so the points in between lie exactly on it.
    """
    inverse = 1 / depth_m
    a, b = inverse[:-1], inverse[1:]
    share = (np.arange(BETWEEN) / BETWEEN).astype(np.float32)
    dense = a[:, None] * (1 - share) + b[:, None] * share
    slope = left[:-1, None] * (1 - share) + left[1:, None] * share
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = np.hypot(1 / a - 1 / b, left[:-1] / a - left[1:] / b)
        z = 1 / dense
    use = (z <= range_m) & ((share == 0) | (gap < ONE_SURFACE_M)[:, None])
    return np.column_stack([z[use], z[use] * slope[use]])


def surface_points(scan: Scan, range_m: float) -> Float[np.ndarray, "n 2"]:
    """Points (x forward, y left) [m] on the surfaces of a scan, near and behind, within a depth."""
    parts = [dense_points(scan.left, depth, range_m) for depth in (scan.depth_m, scan.far_m)]
    return np.concatenate(parts)
