"""A mesh at a place in a building: a table, a shelf, anything that sensors and radio waves pass over and under.

Its triangles are sorted into bodies: which of them close a volume, and which are sheets. Corners nearer than `MERGED_M`
are one, so that meshes whose triangles share none, as those of STL files, come out in one piece. Triangles that share a
side belong to one body. A body is closed if each of its sides has two triangles; if these run along it in opposite
directions it is oriented too, and its normals are turned outwards.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from robosim.parts import MATERIAL, MaterialPart
from robosim.support.checks import FARTHEST, check_number

#: Corners nearer than this are one [m].
MERGED_M = 1e-6


class Bodies(NamedTuple):
    """Triangles in bodies."""

    vertices: Float[np.ndarray, "n 3"]
    """Corners [m], no two of them the same."""
    faces: Int[np.ndarray, "m 3"]
    """Triangles, counter-clockwise as seen from outside where their body is oriented."""
    body: Int[np.ndarray, " m"]
    """Number of each triangle's body, from 0."""
    closed: Bool[np.ndarray, " k"]
    """Whether each body closes a volume."""
    oriented: Bool[np.ndarray, " k"]
    """Whether it is closed, and all its normals point outwards."""


def find_bodies(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Bodies:
    """Sort triangles into bodies; triangles that are points or lines are left out."""
    _, first, merged = np.unique(
        np.round(vertices / MERGED_M), axis=0, return_index=True, return_inverse=True
    )
    vertices, faces = vertices[first], merged.ravel()[faces].reshape(-1, 3)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0]
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    side = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    _, number, count = np.unique(side, return_inverse=True, return_counts=True)
    owner = np.repeat(np.arange(len(faces)), 3)
    # Faces and sides as the nodes of one graph.
    n = len(faces) + len(count)
    links = coo_array((np.ones(len(owner), bool), (owner, len(faces) + number.ravel())), shape=(n, n))
    _, label = connected_components(links, directed=False)
    _, body = np.unique(label[: len(faces)], return_inverse=True)
    n_bodies = int(body.max(initial=-1)) + 1
    closed = np.bincount(body[owner], count[number.ravel()] != 2, n_bodies) == 0
    turns = np.abs(np.bincount(number.ravel(), np.where(start < end, 1, -1), len(count))) > 0
    oriented = closed & (np.bincount(body[owner], turns[number.ravel()], n_bodies) == 0)
    # About a corner of its own, so that far from the origin volumes lose no digits.
    a, b, c = (vertices[faces] - vertices.mean(axis=0)).transpose(1, 0, 2)
    volume = np.bincount(body, np.einsum("ij,ij->i", a, np.cross(b, c)), n_bodies)
    faces = np.where((oriented & (volume < 0))[body][:, None], faces[:, ::-1], faces)
    return Bodies(vertices, faces, body, closed, oriented)


#: Heights above the floor that anything stands at, and sizes of things [m].
_HEIGHT_M, _SIZE_M, _LEAST_M = 1000.0, 1000.0, 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Furnishing:
    """A mesh at a place in a building."""

    mesh: trimesh.Trimesh
    """Triangles [m] in a frame of its own: z up, the floor at z = 0. Normals of closed bodies may point inwards or
    outwards; a mesh may have several bodies, and sheets of no thickness."""
    at: tuple[float, float]
    """Place of its origin, x, y [m] in `map`."""
    z_m: float = 0.0
    """Height of its z = 0 above the floor [m]."""
    yaw_rad: float = 0.0
    """Rotation about its z axis, counter-clockwise [rad]."""
    name: str = "furnishing"
    """Name of the furnishing in messages."""
    material: MaterialPart = "wood"
    """Radio material of the furnishing."""
    colour: tuple[int, int, int] = (166, 124, 82)
    """Red, green and blue of it, 0 to 255."""
    source: str = ""
    """File and entry that place it, for messages; empty for one from memory."""
    said: Mapping[str, Any] = field(default_factory=dict)
    """Keys of a file in place of the mesh, such as {"piece": "table"}; empty for a mesh from memory."""

    def __post_init__(self) -> None:
        if not self.name.strip() or not self.name.isprintable() or len(self.name) > 200:
            raise ValueError(
                f"name is {self.name[:80]!r}, expected printable text of at most 200 letters, such as 'table'."
            )
        for what, value, limit, unit in (
            ("x", self.at[0], FARTHEST, "m"),
            ("y", self.at[1], FARTHEST, "m"),
            ("z_m", self.z_m, _HEIGHT_M, "m above the floor"),
            ("yaw_rad", self.yaw_rad, 100.0, "rad. Files have degrees"),
        ):
            check_number(f"{what} of {self.name}", float(value), -limit, limit, unit)
        if len(self.colour) != 3 or not all(0 <= value <= 255 for value in self.colour):
            raise ValueError(
                f"colour of {self.name} is {self.colour}, expected red, green and blue from 0 to 255."
            )
        MATERIAL.check(f"material of {self.name}", self.material)
        vertices, faces = np.asarray(self.mesh.vertices, float), np.asarray(self.mesh.faces)
        if not len(faces) or not np.isfinite(vertices).all():
            raise ValueError(
                f"mesh of {self.name} has {len(faces)} triangles, expected some, with finite corners."
            )
        size_m = float(np.abs(vertices).max())
        if not _LEAST_M < size_m <= _SIZE_M:
            bound = f"at most {_SIZE_M:g}" if size_m > _SIZE_M else f"more than {_LEAST_M:g}"
            raise ValueError(
                f"mesh of {self.name} reaches {size_m:.4g} m from its origin, expected {bound} m. Is it "
                "in millimetres? Give unit_m: 0.001."
            )

    def __repr__(self) -> str:
        return f"<Furnishing {self.name!r} at ({self.at[0]:g}, {self.at[1]:g}) m: {len(self.mesh.faces)} triangles>"

    def to_map(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Points of its own frame in `map` [m]."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        turned = np.asarray(points, float) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return turned + np.array([*self.at, self.z_m])

    @cached_property
    def bodies(self) -> Bodies:
        """Triangles in `map`, sorted into bodies."""
        bodies = find_bodies(np.asarray(self.mesh.vertices, float), np.asarray(self.mesh.faces, np.int64))
        return bodies._replace(vertices=self.to_map(bodies.vertices))

    @property
    def triangles(self) -> Float[np.ndarray, "n 3 3"]:
        """Triangles in `map` [m]."""
        return self.bodies.vertices[self.bodies.faces]
