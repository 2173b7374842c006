"""Lidars by name, as their manufacturers describe them.

    rplidar-a1   Slamtec RPLIDAR A1M8, data sheet rev. 3.0: 360 beams at 5.5 turns a second, 0.15 to 12 m, ranges to
                 1 % of the distance
    lds-01       HLDS LDS-01 of the TurtleBot3 (ROBOTIS e-Manual): 360 beams, 0.12 to 3.5 m, precise to 10 mm up to
                 0.5 m and to 3.5 % beyond
    ust-10lx     Hokuyo UST-10LX, specification: 1081 beams over 270 degrees, 0.06 to 10 m, accurate to 40 mm
    ring-64      no product: 64 beams all around with the errors of an RPLIDAR A1, for learning

Each casts one ray per beam with Embree. Ranges have Gaussian noise that grows with the distance. Beams return nothing
if no surface is within range, if they graze one, and at random, rarely.
Left out: mixed pixels at edges, mirrors and glass, the robot's motion within a turn.

Data sheets give bounds: they are treated as two standard deviations, and the error of the Hokuyo, which is common to
all beams of a surface, as its spread. That one beam in a hundred returns nothing is an assumption.
"""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
import trimesh
from jaxtyping import Float

from robosim.camera.rendering.merged_meshes import merge
from robosim.lidar.lidar import LidarConfig, LidarModel
from robosim.support.ray_casting import make_ray_scene
from slam.sensing.laser import LaserScan
from wireless.support.compiled import compiled


class EmbreeLidar:
    """Casts a ray for each beam. Needs no OpenGL; works in any process."""

    def __init__(self, meshes: Sequence[trimesh.Trimesh], config: LidarConfig, *, model: LidarModel) -> None:
        """Build the tree of triangles of what beams can hit, in `map`."""
        self.config, self.model = config, model
        self._bearing = model.bearing_rad
        scenery = merge(meshes)
        self._centre = scenery.centre
        self._scene = make_ray_scene(scenery.triangles)
        a, b, c = np.moveaxis(scenery.triangles.astype(float), 1, 0)
        normal = np.cross(b - a, c - a)
        self._normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]

    def scan(self, pose: Float[np.ndarray, "3"], rng: np.random.Generator) -> LaserScan:
        """Measure; see `robosim.lidar.lidar.Lidar`."""
        model, level = self.model, self.config.level
        ranges, slant = self._cast(pose)
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

    def true_scan(self, pose: Float[np.ndarray, "3"]) -> LaserScan:
        """Measure without errors."""
        return self._make_scan(self._cast(pose)[0])

    def _make_scan(self, range_m: Float[np.ndarray, " n"]) -> LaserScan:
        return LaserScan(
            bearing_rad=self._bearing,
            range_m=range_m,
            max_range_m=self.model.max_range_m,
            height_m=self.config.height_m,
        )

    def _cast(self, pose: Float[np.ndarray, "3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Ranges [m], inf where nothing is within reach, and angles from the normals [rad]."""
        angle = self._bearing + pose[2]
        direction = np.zeros((len(angle), 3), np.float32)
        direction[:, 0], direction[:, 1] = np.cos(angle), np.sin(angle)
        origin = np.empty_like(direction)
        origin[:] = np.array([pose[0], pose[1], self.config.height_m]) - self._centre
        hits = self._scene.run(origin, direction, output=True)
        return _ranges_and_slants(angle, hits["tfar"], hits["primID"], self._normal, self.model.max_range_m)


@compiled
def _ranges_and_slants(
    angle: Float[np.ndarray, " n"],
    far: np.ndarray,
    face: np.ndarray,
    normal: Float[np.ndarray, "m 3"],
    most: float,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Ranges of what rays hit, inf for nothing within `most`, and angles from the normals [rad]."""
    ranges, slant = np.full(len(angle), math.inf), np.zeros(len(angle))
    for k in range(len(angle)):
        if face[k] >= 0 and far[k] <= most:
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
