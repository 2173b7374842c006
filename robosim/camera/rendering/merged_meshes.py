"""All meshes that a camera sees, merged to one: the fewer parts, the faster they are drawn."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float, Float32, Int32, UInt8


@dataclass(frozen=True, eq=False)
class Scenery:
    """Triangles with coloured vertices, relative to a centre of their own, in single precision."""

    centre: Float[np.ndarray, "3"]
    """Origin of the vertices in `map` [m]."""
    vertices: Float32[np.ndarray, "n 3"]
    """Relative to the centre [m]: single precision resolves a micrometre within ten metres of it only."""
    faces: Int32[np.ndarray, "m 3"]
    colours: UInt8[np.ndarray, "n 3"]
    """Red, green and blue of the vertices."""

    @property
    def triangles(self) -> Float32[np.ndarray, "m 3 3"]:
        """Corners of the faces, relative to the centre [m]."""
        return self.vertices[self.faces]

    def to_local(
        self, T_map_camera: Float[np.ndarray, "4 4"]
    ) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
        """Axes (columns) and place [m] of a camera relative to the centre; ValueError for a pose that is none."""
        T = np.asarray(T_map_camera, dtype=np.float64)
        if T.shape != (4, 4) or not math.isfinite(T.sum()):
            raise ValueError(f"T_map_camera is\n{T}\nexpected a 4 by 4 matrix of finite numbers.")
        return T[:3, :3], T[:3, 3] - self.centre


def merge(meshes: Sequence[trimesh.Trimesh]) -> Scenery:
    """Merge meshes in `map` to one; meshes without colours get trimesh's grey. ValueError if there is no triangle."""
    if sum(len(mesh.faces) for mesh in meshes) == 0:
        raise ValueError(f"The {len(meshes)} meshes have no triangles, expected at least one to look at.")
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    if not np.isfinite(vertices).all():
        count = (~np.isfinite(vertices)).any(axis=1).sum()
        raise ValueError(f"{count} vertices of the meshes are not finite, expected coordinates in metres.")
    first = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first, strict=False)])
    centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    return Scenery(
        centre=centre,
        vertices=(vertices - centre).astype(np.float32),
        faces=faces.astype(np.int32),
        colours=np.concatenate([_colours(mesh) for mesh in meshes]),
    )


def _colours(mesh: trimesh.Trimesh) -> UInt8[np.ndarray, "n 3"]:
    visual: Any = mesh.visual
    if visual.kind == "texture":
        visual = visual.to_color()
    return np.asarray(visual.vertex_colors, np.uint8)[:, :3]
