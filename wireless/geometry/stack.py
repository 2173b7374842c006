"""Scenes that are stacked storeys, found in any triangle mesh: floor plans over each other, with slabs between.

Level faces lie at an even number of heights: floor and ceiling of each storey, from the lowest up. Between two of
these heights is a layer, in which all walls stand from the lower one to the upper one: a storey's walls, or within a
slab the rims of its openings. So each layer is a floor plan, and a slab is open wherever no level face is.
Walls that go through several layers in one piece are cut.

Left out: what floor or ceiling does not cover at least half of, which are tables and shelves rather than storeys.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
import trimesh
from jaxtyping import Float, Int

from wireless.geometry.extruded import upright_and_level, walls_of
from wireless.geometry.facets import clusters


@dataclass(frozen=True, kw_only=True, eq=False)
class Stack:
    """Layers of walls and the level faces between them, from the lowest up."""

    origin: Float[np.ndarray, "2"]
    """Where (0, 0) of walls and level faces lies [m]."""
    level_m: Float[np.ndarray, " k"]
    """Heights of floor, ceiling, floor, ceiling and so on [m]."""
    walls: tuple[Float[np.ndarray, "_ 2 2"], ...]
    """Ends (x, y) [m] of the walls of each layer, around the origin: storey, slab, storey and so on."""
    wall_face: tuple[Int[np.ndarray, " _"], ...]
    """A mesh face of each wall."""
    level: tuple[shapely.Geometry, ...]
    """Area that faces cover at each height, seen from above [m]."""


def find_stack(
    mesh: trimesh.Trimesh, face_material: Int[np.ndarray, " n_faces"], snap_m: float
) -> Stack | None:
    """The storeys that a mesh is made of; None if it is none, or a single one.

    Args:
        mesh: Any triangles [m], z up.
        face_material: A number for the material of each face: walls of two materials are two walls.
        snap_m: Ends of walls, and heights, closer than this are one.
    """
    corners = np.asarray(mesh.vertices, float)[np.asarray(mesh.faces)]
    origin = np.round(mesh.bounds.mean(axis=0)[:2], 3)
    corners[:, :, :2] -= origin
    sorted_out = upright_and_level(corners)
    if sorted_out is None or not len(sorted_out[1]):
        return None
    upright, flat = sorted_out
    group = clusters(corners[flat][:, :, 2].mean(axis=1), snap_m)
    level_m = np.array([corners[flat[group == i]][:, :, 2].mean() for i in range(group.max() + 1)])
    if len(level_m) < 4 or len(level_m) % 2:
        return None
    level = tuple(
        shapely.union_all(shapely.polygons(corners[flat[group == i]][:, :, :2])) for i in range(len(level_m))
    )
    for floor, ceiling in zip(level[::2], level[1::2], strict=True):
        if min(floor.area, ceiling.area) < max(floor.area, ceiling.area) / 2:
            return None
    triangles, face = _cut(corners[upright], upright, level_m, snap_m)
    walls, wall_face = [], []
    for low, high in pairwise(level_m):
        z = triangles[:, :, 2]
        here = (z.min(axis=1) > low - snap_m) & (z.max(axis=1) < high + snap_m)
        if not here.any():
            walls.append(np.empty((0, 2, 2)))
            wall_face.append(np.empty(0, np.int64))
            continue
        members, faces = triangles[here], face[here]
        storey_walls = walls_of(members, np.asarray(face_material)[faces], float(low), float(high), snap_m)
        if storey_walls is None:
            return None
        walls.append(storey_walls[0])
        wall_face.append(faces[storey_walls[1]])
        triangles, face = triangles[~here], face[~here]
    if len(triangles) or not len(walls[0]):
        return None
    return Stack(origin=origin, level_m=level_m, walls=tuple(walls), wall_face=tuple(wall_face), level=level)


def _cut(
    triangles: Float[np.ndarray, "n 3 3"],
    face: Int[np.ndarray, " n"],
    level_m: Float[np.ndarray, " k"],
    snap_m: float,
) -> tuple[Float[np.ndarray, "m 3 3"], Int[np.ndarray, " m"]]:
    """Triangles cut at some heights, and the face that each is a part of."""
    for level in level_m[1:-1]:
        off = triangles[:, :, 2] - level
        off[np.abs(off) < snap_m] = 0.0
        across = (off.min(axis=1) < -snap_m) & (off.max(axis=1) > snap_m)
        if not across.any():
            continue
        # The corner alone on its side comes first, or one off the cut; the other side is two triangles.
        sign = np.sign(off[across])
        alone = np.abs(sign.sum(axis=1, keepdims=True) - sign) == 2
        first = np.argmax(2 * alone + np.abs(sign), axis=1)
        order = (first[:, None] + np.arange(3)) % 3
        row = np.arange(len(first))[:, None]
        corners, height = triangles[across][row, order], off[across][row, order]
        share = height[:, :1] / (height[:, :1] - height[:, 1:])
        cut = corners[:, :1] + share[:, :, None] * (corners[:, 1:] - corners[:, :1])
        parts = np.stack(
            [
                np.stack([corners[:, 0], cut[:, 0], cut[:, 1]], axis=1),
                np.stack([cut[:, 0], corners[:, 1], corners[:, 2]], axis=1),
                np.stack([cut[:, 0], corners[:, 2], cut[:, 1]], axis=1),
            ],
            axis=1,
        ).reshape(-1, 3, 3)
        side = np.linalg.norm(np.cross(parts[:, 1] - parts[:, 0], parts[:, 2] - parts[:, 0]), axis=1) > 0
        triangles = np.concatenate([triangles[~across], parts[side]])
        face = np.concatenate([face[~across], np.repeat(face[across], 3)[side]])
    return triangles, face
