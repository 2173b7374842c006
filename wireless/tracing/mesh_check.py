"""Requirements of a mesh for tracing."""

import hashlib

import numpy as np
import trimesh
from jaxtyping import Integer

from wireless.geometry.plan import REACH_M
from wireless.geometry.tolerance import check_rounding


class SceneError(ValueError):
    """A mesh that cannot be traced."""


def check_mesh(mesh: trimesh.Trimesh, snap_m: float) -> None:
    """Raise SceneError for a mesh that is none, in no metres, or rounded far from zero."""
    vertex, face = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    if not len(face) or not np.isfinite(vertex).all():
        raise SceneError(f"The mesh has {len(face)} faces and must have some, with finite vertices.")
    wrong = np.flatnonzero(((face < 0) | (face >= len(vertex))).any(axis=1))
    if len(wrong):
        raise SceneError(
            f"Face {wrong[0]} of the mesh has the vertices {face[wrong[0]].tolist()}, expected numbers from 0 to "
            f"{len(vertex) - 1}, as there are {len(vertex)} vertices."
        )
    with np.errstate(over="ignore"):
        span = np.ptp(vertex, axis=0).max()
    if span >= REACH_M:
        raise SceneError(f"The mesh is {span:g} m long, expected under {REACH_M:g} m. Is it in millimetres?")
    try:
        check_rounding(vertex)
    except ValueError as error:
        raise SceneError(f"Of the vertices of the mesh, {error}.") from None
    side = np.diff(vertex[face[:, [0, 1, 2, 0]]], axis=1)
    area = np.linalg.norm(np.cross(side[:, 0], side[:, 1]), axis=1)
    if not np.any(area > snap_m * np.linalg.norm(side, axis=2).max(axis=1)):
        raise SceneError(
            f"None of the {len(face)} triangles of the mesh is wider than {snap_m:g} m: it has no walls. "
            "Is it in metres?"
        )


def surfaces_digest(
    mesh: trimesh.Trimesh, face_material: Integer[np.ndarray, " n_faces"], materials: tuple[object, ...]
) -> str:
    """A text that changes with any vertex, face or material; materials are names or layers of their own."""
    seen = hashlib.sha256()
    for array in (mesh.vertices, mesh.faces, face_material):
        seen.update(np.ascontiguousarray(array, float).tobytes())
    named = (material if isinstance(material, str) else repr(material) for material in materials)
    seen.update("|".join(named).encode())
    return seen.hexdigest()[:16]
