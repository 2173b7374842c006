"""A lidar by ray casting with Embree, one ray per beam.

Ranges have Gaussian noise that grows with the distance. Beams return nothing if no surface is within range, if they
graze one, and at random, rarely.
Left out: mixed pixels at edges, mirrors and glass, the robot's motion within a turn.
"""

import math
from collections.abc import Sequence

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
        """Build the tree of triangles.

        Args:
            meshes: What beams can hit, in `map`.
            config: Height and scale of its errors.
            model: Its beams and errors.
        """
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
