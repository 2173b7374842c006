"""Faces of a building by kind and material."""

import hashlib
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int, UInt8

from robosim.plans.furnishings.furnishing import Furnishing
from wireless.em.materials import Material

#: Kinds of faces, which `face_kind` is an index of, as in `robosim.building.extrusion`.
KINDS = ("wall", "floor", "ceiling", "furniture", "placed")


@dataclass(frozen=True, kw_only=True, eq=False)
class Faces:
    """A mesh whose faces know their kind and material, in `map`."""

    mesh: trimesh.Trimesh
    """All faces, with normals into free space, those of walls, floor and ceiling first; of these, vertices are corners
    of walls only. Faces of placed meshes that close no volume may have either orientation."""
    face_kind: UInt8[np.ndarray, " n_faces"]
    """Kind of each face: index into `KINDS`; rims of slabs between storeys are walls."""
    materials: tuple[str | Material, ...]
    """Radio materials of the faces, by the names of `wireless.em.materials`, or of layers of their own."""
    face_material: UInt8[np.ndarray, " n_faces"]
    """Material of each face: index into `materials`."""
    furnishings: tuple[Furnishing, ...] = ()
    """Meshes placed in it, with heights above the lowest floor, in the order of their faces."""

    @property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest x, y, z [m] in `map`."""
        return self.mesh.bounds

    @property
    def digest(self) -> str:
        """A text that changes with any vertex, face or material."""
        seen = hashlib.sha256()
        for array in (self.mesh.vertices, self.mesh.faces, self.face_material):
            seen.update(np.ascontiguousarray(array, float).tobytes())
        named = (one if isinstance(one, str) else repr(one) for one in self.materials)
        seen.update("|".join(named).encode())
        return seen.hexdigest()[:16]

    def submesh(self, *kinds: str) -> trimesh.Trimesh:
        """The faces of some kinds, as a mesh of their own."""
        if unknown := [kind for kind in kinds if kind not in KINDS]:
            raise ValueError(f"kind is {unknown[0]!r}, expected one of {', '.join(KINDS)}.")
        return self._part(np.isin(self.face_kind, [KINDS.index(kind) for kind in kinds]))

    def of_material(self, material: str) -> trimesh.Trimesh:
        """The faces of one radio material, as a mesh of their own."""
        names = list(map(str, self.materials))
        if material not in names:
            raise ValueError(f"material is {material!r}, expected one of {', '.join(names)}.")
        return self._part(self.face_material == names.index(material))

    def _part(self, mask: Bool[np.ndarray, " n_faces"]) -> trimesh.Trimesh:
        used, faces = np.unique(self.mesh.faces[mask], return_inverse=True)
        return plain_mesh(self.mesh.vertices[used], faces.reshape(-1, 3), self.mesh.metadata)


def plain_mesh(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], metadata: dict[str, object]
) -> trimesh.Trimesh:
    """Mesh whose vertices stay as they are, unmerged and in order."""
    mesh = trimesh.Trimesh(vertices, faces, process=False, validate=False, metadata=dict(metadata))
    mesh.units = "m"
    return mesh
