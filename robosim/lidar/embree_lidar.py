"""A lidar by ray casting with Embree, one ray a beam.

Ranges err by Gaussian noise that grows with the distance. Beams return nothing where no surface is within reach, where
they graze one, and now and then for no reason.
Left out: mixed pixels at edges, mirrors and glass, the robot's motion within a turn.
"""

import math
from collections.abc import Sequence

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Float

from robosim.camera.rendering.scenery import merge
from robosim.lidar.model import LidarConfig, LidarModel
from slam.sensing.laser import LaserScan
from wireless.support.compiled import compiled


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
        grazing = math.radians(model.grazing_deg) if level > 0 else math.inf
        measured = _measured(
            ranges, slant, error, fate, model.sigma_m, model.sigma_share, level, level * model.missing, grazing,
            model.min_range_m, model.max_range_m,
        )  # fmt: skip
        return self._told(measured)

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
        way = np.zeros((len(angle), 3), np.float32)
        way[:, 0], way[:, 1] = np.cos(angle), np.sin(angle)
        origin = np.empty_like(way)
        origin[:] = np.array([pose[0], pose[1], self.config.height_m]) - self._centre
        hits = self._scene.run(origin, way, output=True)
        return _met(angle, hits["tfar"], hits["primID"], self._normal, self.model.max_range_m)


@compiled
def _met(
    angle: Float[np.ndarray, " n"],
    far: np.ndarray,
    face: np.ndarray,
    normal: Float[np.ndarray, "m 3"],
    most: float,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Ranges of what rays have met, inf for nothing within the most, and angles from the normals."""
    ranges, slant = np.full(len(angle), math.inf), np.zeros(len(angle))
    for k in range(len(angle)):
        if face[k] >= 0 and far[k] <= most:
            ranges[k] = far[k]
            across = normal[face[k], 0] * math.cos(angle[k]) + normal[face[k], 1] * math.sin(angle[k])
            slant[k] = math.acos(min(abs(across), 1.0))
    return ranges, slant


@compiled
def _measured(
    ranges: Float[np.ndarray, " n"], slant: Float[np.ndarray, " n"],
    error: Float[np.ndarray, " n"], fate: Float[np.ndarray, " n"],
    sigma_m: float, sigma_share: float, level: float, missing: float, grazing: float, least: float, most: float,
) -> Float[np.ndarray, " n"]:  # fmt: skip
    """Ranges with their errors, inf for beams that return nothing."""
    measured = np.full(len(ranges), math.inf)
    for k in range(len(ranges)):
        if math.isinf(ranges[k]) or fate[k] < missing or slant[k] > grazing:
            continue
        near = ranges[k] + level * max(sigma_m, sigma_share * ranges[k]) * error[k]
        if least <= near <= most:
            measured[k] = near
    return measured
