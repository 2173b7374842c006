"""Surfaces and patches of a mesh, which of a large one are cached on disk: a city takes seconds to prepare.

The key is the content: vertices, faces and materials of faces, the tolerance, and the code and the libraries that
compute surfaces (`wireless.support.cached_array`), so that a changed mesh is prepared again.
"""

from typing import Any

import numpy as np
import shapely
import trimesh
from jaxtyping import Int

from robosim.support.compiled import source_digest
from wireless.geometry.facets import Surfaces, find_surfaces
from wireless.geometry.patches import Patches, find_patches
from wireless.support.cached_array import cached_arrays

#: Meshes of fewer triangles are prepared in half a second.
LARGE = 10_000


def prepare_surfaces(
    mesh: trimesh.Trimesh, face_material: Int[np.ndarray, " n_faces"], snap_m: float
) -> tuple[Surfaces, Patches]:
    """Facets and edges of any mesh, and the patches of its facets; arguments as in `find_surfaces`."""

    def make() -> list[np.ndarray]:
        surfaces = find_surfaces(mesh, face_material, snap_m)
        return [np.asarray(value) for value in (*surfaces, *find_patches(surfaces))]

    code = source_digest(__name__) if len(mesh.faces) >= LARGE else ""
    if code:
        versions = code, snap_m, shapely.__version__, shapely.geos_version
        content = np.asarray(mesh.vertices, float), mesh.faces, face_material
        made_of = [repr(versions).encode(), *(np.ascontiguousarray(array).tobytes() for array in content)]
        arrays = list(cached_arrays("surfaces", made_of, (), make))
    else:
        arrays = make()
    values: list[Any] = [array if array.ndim else float(array) for array in arrays]
    n = len(Surfaces._fields)
    return Surfaces(*values[:n]), Patches(*values[n:])
