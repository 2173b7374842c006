"""Ray casting with Embree."""

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Float


def make_ray_scene(triangles: Float[np.ndarray, "n 3 3"]) -> EmbreeScene:
    """A scene of triangles, given by their corners, that rays can be cast in.

    Coordinates are stored in single precision, so corners should lie near the origin. A ray through an edge between
    two triangles always hits one of them.
    """
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, np.ascontiguousarray(triangles, np.float32))
    return scene
