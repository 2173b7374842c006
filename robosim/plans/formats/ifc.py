"""Floor plans of storeys of building models in IFC, read by `ifcopenshell` (extra `ifc`).

All products with a shape are triangles in metres, z up, of which `robosim.plans.formats.mesh_slice` makes the plan of
one storey. Doors and what fills them are left out, so that doorways are open; spaces, openings and annotations have no
surfaces; furniture stays. A process of its own reads the model, since damaged ones can end the process of the library.

Reference: ISO 16739-1:2018 (IFC 4).
"""

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from robosim.plans.floorplan import FloorPlan, MapError, ReadingOptions
from robosim.plans.formats.mesh_file import Triangles
from robosim.plans.formats.mesh_slice import plan_from_triangles
from robosim.support.installation import is_installed, missing_extra
from robosim.support.reading import reading

#: Classes of products that are no walls, floors or things.
LEFT_OUT = ["IfcDoor", "IfcSpace", "IfcOpeningElement", "IfcAnnotation", "IfcGrid", "IfcSite"]
LAST = b"END-ISO-10303-21;"
#: Longer reading is an error [s].
MOST_S = 600.0
_REMEDY = "Export it again as IFC 2x3 or IFC 4 (.ifc)."


def read_ifc(path: Path, options: ReadingOptions) -> FloorPlan:
    """Floor plan of a storey; uses what meshes use but `unit_m` and `up`, which the model knows."""
    if not is_installed("ifcopenshell"):
        raise missing_extra("ifcopenshell", "An IFC model")
    with reading(path, "an IFC model", _REMEDY, kind=MapError) as file:
        content = file.read()
        if LAST not in content[-1000:]:
            raise ValueError(f"it is cut off: its last line is not {LAST.decode()}")
        return plan_from_triangles(_triangles_of(content), options, name=path.stem)


def _triangles_of(content: bytes) -> Triangles:
    """Surfaces of all products in the model's coordinates [m], read by another process."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "triangles.npy"
        done = subprocess.run(
            [sys.executable, "-m", __name__, str(file)],
            input=content,
            capture_output=True,
            timeout=MOST_S,
            check=False,
        )
        if done.returncode:
            words = done.stderr.decode("utf-8", "replace").strip().splitlines()
            raise ValueError(
                words[-1] if done.returncode > 0 else f"its reader crashed, signal {-done.returncode}"
            )
        triangles = np.load(file)
    if not len(triangles):
        raise MapError("it has no walls or floors with a shape.")
    return triangles


def _write_triangles(content: bytes, path: Path) -> None:
    """Read a model and write its triangles, in the process that may end."""
    import ifcopenshell
    import ifcopenshell.geom

    settings: Any = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    model = ifcopenshell.file.from_string(content.decode("utf-8", "replace"))
    shapes: Any = ifcopenshell.geom.iterator(settings, model, 1, exclude=LEFT_OUT)
    batches = [np.empty((0, 3, 3))]
    more = bool(shapes.initialize())
    while more:
        geometry = shapes.get().geometry
        corners = np.array(geometry.verts, float).reshape(-1, 3)
        batches.append(corners[np.array(geometry.faces, np.int64).reshape(-1, 3)])
        more = bool(shapes.next())
    np.save(path, np.concatenate(batches))


if __name__ == "__main__":
    _write_triangles(sys.stdin.buffer.read(), Path(sys.argv[1]))
