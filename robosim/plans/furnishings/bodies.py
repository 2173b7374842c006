"""Triangles sorted into bodies: which of them close a volume, and which are sheets.

Corners nearer than `MERGED_M` are one, so that meshes whose triangles share none, as those of STL files, come out in
one piece. Triangles that share a side belong to one body. A body is closed if each of its sides has two triangles; if
these run along it in opposite directions it is oriented too, and its normals are turned outwards.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

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
    """Sort triangles into bodies; those that are points or lines are left out."""
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
