"""Floor plans of storeys of building models in IFC, read by `ifcopenshell` (extra `ifc`).

All products with a shape are triangles in metres, z up, of which `robosim.plans.formats.mesh_slice` makes the plan of
one storey. Doors and what fills them are left out, so that doorways are open; spaces, zones, openings, virtual
elements and annotations have no surfaces; furniture stays. A process of its own reads the model, since damaged ones can
end the process of the library, which leaves out what it cannot read: lines that are missing reject the model, and
products without their shape are reported.

Reference: ISO 16739-1:2018 (IFC 4).
"""

import logging
import re
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

logger = logging.getLogger(__name__)

#: Classes of products that are no walls, floors or things.
LEFT_OUT = ["IfcDoor", "IfcSpace", "IfcOpeningElement", "IfcAnnotation", "IfcGrid", "IfcSite"]
LEFT_OUT += ["IfcSpatialZone", "IfcExternalSpatialElement", "IfcVirtualElement"]
#: Names of representations that are shapes in space.
_BODIES = ("Body", "Facetation", "Tessellation")
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
        triangles, note = _triangles_of(content)
        plan = plan_from_triangles(triangles, options, name=path.stem)
    if note:
        logger.warning(f"{path}: {note}")
    return plan


def _triangles_of(content: bytes) -> tuple[Triangles, str]:
    """Surfaces of all products in the model's coordinates [m], read by another process, and what they lack."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "triangles.npy"
        command = [sys.executable, "-m", __name__, str(file)]
        try:
            done = subprocess.run(command, input=content, capture_output=True, timeout=MOST_S, check=False)
        except subprocess.TimeoutExpired:
            raise ValueError(f"it takes longer than {MOST_S:g} s") from None
        if done.returncode:
            words = done.stderr.decode("utf-8", "replace").strip().splitlines()
            if done.returncode < 0 or not words:
                raise ValueError(f"its reader crashed, signal {-done.returncode}")
            raise ValueError(words[-1].removeprefix("ValueError: "))
        triangles, note = np.load(file), file.with_suffix(".txt").read_text()
    if not len(triangles):
        raise MapError("it has no walls or floors with a shape.")
    return triangles, note


def _write_triangles(content: bytes, path: Path) -> None:
    """Read a model and write its triangles, in the process that may end."""
    import ifcopenshell
    import ifcopenshell.geom

    settings: Any = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    model = ifcopenshell.file.from_string(content.decode("utf-8", "replace"))
    _check_lines(content, sum(1 for _ in model))
    shapes: Any = ifcopenshell.geom.iterator(settings, model, 1, exclude=LEFT_OUT)
    batches = [np.empty((0, 3, 3))]
    read, more = set(), bool(shapes.initialize())
    while more:
        shape = shapes.get()
        geometry = shape.geometry
        read.add(shape.id)
        corners = np.array(geometry.verts, float).reshape(-1, 3)
        batches.append(corners[np.array(geometry.faces, np.int64).reshape(-1, 3)])
        more = bool(shapes.next())
    np.save(path, np.concatenate(batches))
    if any("unit information" in line for line in ifcopenshell.get_log().splitlines() if "[error]" in line):
        raise ValueError("its units of length cannot be read")
    lacking = [each for each in model.by_type("IfcProduct") if each.id() not in read and _has_body(each)]
    note = ""
    if lacking:
        note = (
            f"{len(lacking)} of {len(lacking) + len(read)} products have a shape that cannot be read, such as "
            f"#{lacking[0].id()}, an {lacking[0].is_a()}: they are missing in the plan. Check it, or export again."
        )
    path.with_suffix(".txt").write_text(note)


def _check_lines(content: bytes, n_read: int) -> None:
    """Raise ValueError if entities were not read, or are missing though others refer to them."""
    text = re.sub(rb"'[^']*'|/\*.*?\*/", b"", content, flags=re.DOTALL)
    names = re.findall(rb";\s*#(\d+)\s*=", text)
    if n_read < len(names):
        raise ValueError(f"{len(names) - n_read} of its {len(names)} entities cannot be read")
    if missing := set(re.findall(rb"#(\d+)", text)) - set(names):
        raise ValueError(
            f"{len(missing)} of its entities are missing, such as #{min(missing, key=int).decode()}"
        )


def _has_body(product: Any) -> bool:
    """Whether a product that is read has a shape in space, apart from axes and outlines."""
    if product.Representation is None or any(product.is_a(kind) for kind in LEFT_OUT):
        return False
    return any(each.RepresentationIdentifier in _BODIES for each in product.Representation.Representations)


if __name__ == "__main__":
    _write_triangles(sys.stdin.buffer.read(), Path(sys.argv[1]))
