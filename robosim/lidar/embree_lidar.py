"""A lidar by ray casting with Embree, one ray a beam.

Ranges err by Gaussian noise that grows with the distance. Beams return nothing where no surface is within reach, where
they graze one, and now and then for no reason.
Left out: mixed pixels at edges, mirrors and glass, the robot's motion within a turn.
"""

from collections.abc import Sequence

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Float

from robosim.camera.rendering.scenery import merge
from robosim.lidar.model import LidarConfig, LidarModel
from slam.sensing.laser import LaserScan


class EmbreeLidar:
    """Casts a ray for each beam. Needs no OpenGL; works in any process."""

    def __init__(self, meshes: Sequence[trimesh.Trimesh], config: LidarConfig, *, model: LidarModel) -> None:
        """Build the tree of triangles.

        Args:
            meshes: What stands in the way, in `map`; it stays as it is.
            config: How it is used.
            model: What it is.
        """
        self.config, self.model = config, model
        self._bearing = model.bearing_rad
        scenery = merge(meshes)
        self._centre = scenery.centre
        self._scene = EmbreeScene(robust=True)
        self._triangles = TriangleMesh(self._scene, scenery.vertices[scenery.faces])
        a, b, c = np.moveaxis(scenery.vertices[scenery.faces].astype(float), 1, 0)
        normal = np.cross(b - a, c - a)
        self._normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]

    def scan(self, pose: Float[np.ndarray, "3"], rng: np.random.Generator) -> LaserScan:
        """Measure; see `robosim.lidar.model.Lidar`."""
        model, level = self.model, self.config.level
        ranges, slant = self._cast(pose)
        # Drawn for every beam, so that what one of them meets changes no other's noise.
        error, fate = rng.normal(size=len(ranges)), rng.random(len(ranges))
        seen = np.isfinite(ranges)
        near = np.where(seen, ranges, 0.0)
        measured = near + level * model.sigma_at(near) * error
        lost = (fate < level * model.missing) | ((slant > np.radians(model.grazing_deg)) & (level > 0))
        seen &= ~lost & (measured >= model.min_range_m) & (measured <= model.max_range_m)
        return self._told(np.where(seen, measured, np.inf))

    def true_scan(self, pose: Float[np.ndarray, "3"]) -> LaserScan:
        """What it would measure if it did not err."""
        return self._told(self._cast(pose)[0])

    def _told(self, range_m: Float[np.ndarray, " n"]) -> LaserScan:
        return LaserScan(
            bearing_rad=self._bearing,
            range_m=range_m,
            max_range_m=self.model.max_range_m,
            height_m=self.config.height_m,
        )

    def _cast(self, pose: Float[np.ndarray, "3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Ranges [m], inf where nothing is within reach, and angles from the normals [rad]."""
        angle = self._bearing + pose[2]
        way = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
        start = np.array([pose[0], pose[1], self.config.height_m]) - self._centre
        origin = np.broadcast_to(start.astype(np.float32), way.shape)
        hits = self._scene.run(np.ascontiguousarray(origin), way.astype(np.float32), output=True)
        ranges, face = hits["tfar"].astype(float), hits["primID"]
        across = np.abs((self._normal[face] * way).sum(axis=1))
        there = (face >= 0) & (ranges <= self.model.max_range_m)
        return np.where(there, ranges, np.inf), np.arccos(np.clip(across, 0.0, 1.0))
