"""Planar laser scanners (2D lidars) on a robot: their interface, and lidars by name, as manufacturers describe them.

    rplidar-a1   Slamtec RPLIDAR A1M8, data sheet rev. 3.0: 360 beams at 5.5 turns a second, 0.15 to 12 m, ranges to
                 1 % of the distance
    lds-01       HLDS LDS-01 of the TurtleBot3 (ROBOTIS e-Manual): 360 beams, 0.12 to 3.5 m, precise to 10 mm up to
                 0.5 m and to 3.5 % beyond
    ust-10lx     Hokuyo UST-10LX, specification: 1081 beams over 270 degrees, 0.06 to 10 m, accurate to 40 mm
    ring-64      no product: 64 beams all around with the errors of an RPLIDAR A1, for learning
    rangers-4    four ultrasonic HC-SR04 (ElecFreaks data sheet), to the front, left, right and back: cones of 30
                 degrees, 0.02 to 4 m, precise to 3 mm
    vl53l5cx     ST VL53L5CX, data sheet DS13754: 8 columns of zones over 45 degrees, 0.02 to 4 m, precise to 15 mm up
                 to 0.2 m and to 5 % beyond

Each casts one ray per beam with Embree, and several for a cone, of which the nearest return counts. Ranges have
Gaussian noise that grows with the distance. Beams return nothing if no surface is within range, if they graze one, and
at random, rarely.
Left out: mixed pixels at edges, mirrors and glass, the robot's motion within a turn.

Data sheets give bounds: they are treated as two standard deviations, and the error of the Hokuyo, which is common to
all beams of a surface, as its spread. That one beam in a hundred returns nothing is an assumption.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
import trimesh
from jaxtyping import Float

from robosim.camera.rendering.merged_meshes import merge
from robosim.support.checks import LEVEL, Range, checked
from robosim.support.compiled import compiled
from robosim.support.ray_casting import make_ray_scene
from slam.poses import Pose, moved_ahead
from slam.sensing.laser import LaserScan

#: A number for each beam.
Beams = Float[np.ndarray, " n"]


#: Rays of a beam that is a cone.
_RAYS = 9


@dataclass(frozen=True, kw_only=True)
@checked
class LidarConfig:
    """Mounting of a lidar, and scale of its errors."""

    height_m: Annotated[float, Range(0.001, 100, "m")] = 0.2
    """Height of the beams above the floor [m]."""
    ahead_m: Annotated[float, Range(-10, 10, "m")] = 0.0
    """How far the scanner is ahead of the robot's centre [m]."""
    level: Annotated[float, LEVEL] = 1.0
    """Scale of its errors and of the part of beams that return nothing: 0 none, 1 as in its data sheet."""


@dataclass(frozen=True, kw_only=True)
@checked
class LidarModel:
    """A kind of lidar: its fan of beams and their errors; by default an RPLIDAR A1."""

    beams: Annotated[int, Range(3, 100_000, "beams")] = 360
    """Beams of a turn."""
    fov_deg: Annotated[float, Range(1, 360, "degrees")] = 360.0
    """Angle from the first to the last beam [deg]; 360 for all around."""
    cone_deg: Annotated[float, Range(0, 90, "degrees")] = 0.0
    """Width of a beam, which returns the range of the nearest surface in it [deg]; 0 for a ray."""
    min_range_m: Annotated[float, Range(0, 1000, "m")] = 0.15
    """Nearer surfaces are not measured [m]."""
    max_range_m: Annotated[float, Range(0.01, 1000, "m")] = 12.0
    """Farther surfaces are not measured [m]."""
    sigma_m: Annotated[float, Range(0, 10, "m")] = 0.002
    """Least standard deviation of a range [m]."""
    sigma_share: Annotated[float, Range(0, 1)] = 0.005
    """Standard deviation as a part of the range, where that is more."""
    missing: Annotated[float, Range(0, 1)] = 0.01
    """Part of the beams that return nothing at random."""
    grazing_deg: Annotated[float, Range(1, 90, "degrees")] = 85.0
    """Surfaces met at more than this from their normal return nothing [deg]."""

    def __post_init__(self) -> None:
        if not self.min_range_m < self.max_range_m:
            raise ValueError(
                f"min_range_m is {self.min_range_m} and max_range_m {self.max_range_m}, expected the first below the "
                "other."
            )

    @property
    def bearing_rad(self) -> Beams:
        """Directions of the beams in the robot's frame [rad], rising."""
        half = np.radians(self.fov_deg) / 2
        if self.fov_deg == 360.0:
            return np.linspace(-half, half, self.beams, endpoint=False)
        return np.linspace(-half, half, self.beams)

    def sigma_at(self, range_m: Beams) -> Beams:
        """Standard deviation of ranges [m]."""
        return np.maximum(self.sigma_m, self.sigma_share * range_m)


#: Triangles in `map` [m].
Moving = Float[np.ndarray, "m 3 3"]


@runtime_checkable
class Lidar(Protocol):
    """Interface of lidars."""

    def scan(self, pose: Pose, rng: np.random.Generator, moving: Moving | None = None) -> LaserScan:
        """Measure at a true pose in `map`, x [m], y [m], yaw [rad], with noise from a generator.

        `moving` are triangles in `map` [m] of what moves in the building; without movers it is not given.
        """

    def true_scan(self, pose: Pose, moving: Moving | None = None) -> LaserScan:
        """Measure without errors."""


class EmbreeLidar:
    """Casts a ray for each beam. Needs no OpenGL; works in any process."""

    def __init__(self, meshes: Sequence[trimesh.Trimesh], config: LidarConfig, *, model: LidarModel) -> None:
        """Build the tree of triangles of what beams can hit, in `map`."""
        self.config, self.model = config, model
        self._bearing = model.bearing_rad
        scenery = merge(meshes)
        self._centre = scenery.centre
        self._scene = make_ray_scene(scenery.triangles)
        self._normal = _normals(scenery.triangles)

    def scan(self, pose: Pose, rng: np.random.Generator, moving: Moving | None = None) -> LaserScan:
        """Measure; see `robosim.lidar.Lidar`."""
        model, level = self.model, self.config.level
        ranges, slant = self._cast(pose, moving)
        # Drawn for every beam, so that what one of them hits does not change the noise of another.
        error, chance = rng.normal(size=len(ranges)), rng.random(len(ranges))
        with np.errstate(invalid="ignore"):  # infinite ranges
            measured = ranges + level * model.sigma_at(ranges) * error
        lost = chance < level * model.missing
        if level > 0:
            lost |= slant > math.radians(model.grazing_deg)
        lost |= (measured < model.min_range_m) | (measured > model.max_range_m)
        measured[lost | np.isinf(ranges)] = math.inf
        return self._make_scan(measured)

    def true_scan(self, pose: Pose, moving: Moving | None = None) -> LaserScan:
        """Measure without errors."""
        return self._make_scan(self._cast(pose, moving)[0])

    def _make_scan(self, range_m: Beams) -> LaserScan:
        return LaserScan(
            bearing_rad=self._bearing,
            range_m=range_m,
            max_range_m=self.model.max_range_m,
            height_m=self.config.height_m,
            ahead_m=self.config.ahead_m,
        )

    def _cast(self, pose: Pose, moving: Moving | None) -> tuple[Beams, Beams]:
        """Ranges [m], inf where nothing is within reach, and angles from the normals [rad]."""
        pose = moved_ahead(pose, self.config.ahead_m)
        half = math.radians(self.model.cone_deg) / 2
        rays = np.linspace(-half, half, _RAYS) if half else np.zeros(1)
        angle = (self._bearing[:, None] + rays + pose[2]).ravel()
        direction = np.zeros((len(angle), 3), np.float32)
        direction[:, 0], direction[:, 1] = np.cos(angle), np.sin(angle)
        origin = np.empty_like(direction)
        origin[:] = np.array([pose[0], pose[1], self.config.height_m]) - self._centre
        scenes = [(self._scene, self._normal)]
        if moving is not None:
            z = moving[:, :, 2]
            met = moving[(z.min(axis=1) <= self.config.height_m) & (z.max(axis=1) >= self.config.height_m)]
            if len(met):
                scenes.append((make_ray_scene(met - self._centre), _normals(met)))
        scans = []
        for scene, normal in scenes:
            hits = scene.run(origin, direction, output=True)
            scans.append(
                _ranges_and_slants(angle, hits["tfar"], hits["primID"], normal, self.model.max_range_m)
            )
        ranges, slant = (
            np.column_stack(each).reshape(len(self._bearing), -1) for each in zip(*scans, strict=True)
        )
        nearest = ranges.argmin(axis=1)[:, None]
        return np.take_along_axis(ranges, nearest, 1)[:, 0], np.take_along_axis(slant, nearest, 1)[:, 0]


def _normals(triangles: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit normals of triangles; zero for triangles without an area."""
    a, b, c = np.moveaxis(triangles.astype(float), 1, 0)
    normal = np.cross(b - a, c - a)
    return normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]


@compiled
def _ranges_and_slants(
    angle: Beams, far: np.ndarray, face: np.ndarray, normal: Float[np.ndarray, "m 3"], max_range_m: float
) -> tuple[Beams, Beams]:
    """Ranges of what rays hit, inf for nothing within `max_range_m`, and angles from the normals [rad]."""
    ranges, slant = np.full(len(angle), math.inf), np.zeros(len(angle))
    for k in range(len(angle)):
        if face[k] >= 0 and far[k] <= max_range_m:
            ranges[k] = far[k]
            across = normal[face[k], 0] * math.cos(angle[k]) + normal[face[k], 1] * math.sin(angle[k])
            slant[k] = math.acos(min(abs(across), 1.0))
    return ranges, slant


RPLIDAR_A1 = LidarModel()
rplidar_a1 = partial(EmbreeLidar, model=RPLIDAR_A1)
lds_01 = partial(
    EmbreeLidar,
    model=LidarModel(min_range_m=0.12, max_range_m=3.5, sigma_m=0.005, sigma_share=0.0175),
)
ust_10lx = partial(
    EmbreeLidar,
    model=LidarModel(
        beams=1081, fov_deg=270.0, min_range_m=0.06, max_range_m=10.0, sigma_m=0.02, sigma_share=0.0
    ),
)
ring_64 = partial(EmbreeLidar, model=LidarModel(beams=64))
rangers_4 = partial(
    EmbreeLidar,
    model=LidarModel(
        beams=4, cone_deg=30.0, min_range_m=0.02, max_range_m=4.0, sigma_m=0.0015, sigma_share=0.0
    ),
)
vl53l5cx = partial(
    EmbreeLidar,
    model=LidarModel(
        beams=8,
        fov_deg=45.0 * 7 / 8,
        cone_deg=45.0 / 8,
        min_range_m=0.02,
        max_range_m=4.0,
        sigma_m=0.0075,
        sigma_share=0.025,
    ),
)
