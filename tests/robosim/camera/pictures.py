"""A room as cameras see it."""

import numpy as np
import trimesh

from robosim.camera.model import RGBD

ROOM = (4.0, 3.0, 2.5)


def room(size: tuple[float, float, float] = ROOM) -> trimesh.Trimesh:
    """An empty room about the origin, floor at z = 0, with normals into it and a colour for each corner."""
    mesh = trimesh.creation.box(size)
    mesh.invert()
    mesh.apply_translation((0.0, 0.0, size[2] / 2))
    rgb = np.arange(24).reshape(8, 3) * 10
    mesh.visual.vertex_colors = np.column_stack([rgb, np.full(8, 255)]).astype(np.uint8)
    return mesh


def same(a: RGBD, b: RGBD) -> bool:
    """Whether two pictures are equal bit for bit."""
    return np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth, b.depth)
