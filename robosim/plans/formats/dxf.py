"""Floor plans in DXF drawings, read by `ezdxf` (extra `dxf`).

Lines, polylines with bulges, arcs, circles, ellipses, splines, multilines, hatches and solids of the model space, those
of blocks included, as `robosim.plans.formats.line_drawing` reads them. What is on layer 0 of a block is on the layer of
its reference. Layers that are off or frozen are left out, and so are blocks whose reference is on a frozen
layer, text, dimensions and paper space; surfaces, solids and objects of other programs with a warning, if they are on
a layer of walls; and the frames of fitted polylines. The unit is the drawing's ($INSUNITS) or given; coordinates become
those of `map`.

Reference: Autodesk, DXF Reference (2018), sections Header and Entities.
"""

import logging
import math
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robosim.plans.floorplan import FloorPlan, MapError, ReadingOptions
from robosim.plans.formats.line_drawing import FLAT_M, Shape, plan_from_shapes
from robosim.support.checks import shown
from robosim.support.installation import is_installed, missing_extra
from robosim.support.reading import one_line, reading

if TYPE_CHECKING:
    from ezdxf.entities.dxfentity import DXFEntity

logger = logging.getLogger(__name__)

#: Units of length of buildings by their numbers: in, ft, mm, cm, m, yd, dm, US survey ft [m].
UNITS_M = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0, 10: 0.9144, 14: 0.1, 21: 1200 / 3937}
#: Entities that are drawn as lines, as areas by one outline, and as areas by several.
LINES = ("LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE")
SOLIDS, HATCHES = ("SOLID", "TRACE"), ("HATCH", "MPOLYGON")
#: Entities that are no walls.
_NOTES = re.compile(
    "TEXT|ATT|DIM|LEADER|TOLER|TABLE|POINT|VIEWPORT|IMAGE|UNDERLAY|OLE|WIPEOUT|LIGHT|XLINE|RAY"
)
#: Flag of vertices that a fitted polyline does not pass through.
_FRAME = 16
#: Most blocks within blocks, and entities in all; one of a block is copied, which takes as long as several.
MOST_DEEP, MOST_ENTITIES, COPY = 20, 300_000, 5
BINARY = b"AutoCAD Binary DXF"
_REMEDY = "Save it again as DXF, of any version, with the walls as lines, polylines or hatches."


def read_dxf(path: Path, options: ReadingOptions) -> FloorPlan:
    """Floor plan from a DXF drawing; uses `unit_m` and what `plan_from_shapes` uses."""
    if not is_installed("ezdxf"):
        raise missing_extra("ezdxf", "A DXF drawing")
    from ezdxf import recover
    from ezdxf.audit import AuditError
    from ezdxf.filemanagement import readfile

    with reading(path, "a DXF drawing", _REMEDY, kind=MapError) as file:
        is_binary = file.read(len(BINARY)) == BINARY
        file.seek(0)
        document, auditor = (readfile(path), None) if is_binary else recover.read(file)
        unit_m = options.unit_m or UNITS_M.get(document.units)
        if unit_m is None:
            raise MapError(
                f"the drawing does not say its unit of length ($INSUNITS is {document.units}). Give it: --unit 0.001 "
                "for millimetres, --unit 1 for metres, --unit 0.0254 for inches."
            )
        repairs = () if auditor is None else (*auditor.fixes, *auditor.errors)
        missing = {one_line(each.message) for each in repairs if each.code == AuditError.UNDEFINED_BLOCK}
        shapes = list(_shapes(_entities(document.modelspace(), "", [0], missing), unit_m))
        if missing:
            logger.warning(
                f"{path}: blocks that it does not contain, and clippings, are left out: {'; '.join(sorted(missing))}."
            )
        return plan_from_shapes(shapes, path, options)


def _entities(
    entities: Iterable["DXFEntity"], layer: str, count: list[int], missing: set[str], deep: int = 0
) -> Iterator[tuple["DXFEntity", str]]:
    """Entities with their layers, those of blocks in their places; `layer` is that of the block's reference.

    Names of blocks that are missing, or are in other files, and clippings are added to `missing`.
    """
    from ezdxf.xclip import XClip

    for entity in entities:
        count[0] += COPY if deep else 1
        inner: Any = entity
        attributes = {**inner.graphic_properties(), **entity.dxfattribs()}
        for key, value in attributes.items():
            if isinstance(value, float) and not math.isfinite(value):
                raise MapError(
                    f"{key} of a {entity.dxftype()} is {value}, expected a number. Export it again."
                )
        if deep > MOST_DEEP or count[0] > MOST_ENTITIES:
            raise MapError(
                f"it has blocks in blocks, more than {MOST_DEEP} deep, or more than {MOST_ENTITIES} entities. Explode "
                "them, or export the layers of walls alone."
            )
        layer_of_entity = attributes.get("layer", "0")
        layer_of_entity = layer if layer and layer_of_entity == "0" else layer_of_entity
        kind = entity.dxftype()
        known = inner.doc.layers.get(layer_of_entity) if layer_of_entity in inner.doc.layers else None
        # Layers of a block are drawn though that of its reference is off, but not if it is frozen.
        if known is not None and (known.is_frozen() or (known.is_off() and kind != "INSERT")):
            continue
        if attributes.get("invisible", 0):
            continue
        if kind == "INSERT":
            block = inner.block()
            if block is None or block.block.is_xref or block.block.is_xref_overlay:
                name, path = inner.dxf.name, "" if block is None else block.block.dxf.get("xref_path", "")
                missing.add(f"{shown(name)} of {shown(path)}" if path else shown(name))
                continue
            if XClip(inner).is_clipping_enabled:
                missing.add(
                    f"the clipping (XCLIP) of {shown(inner.dxf.name)}, which is read whole: explode it"
                )
            count[0] += COPY * inner.mcount * (inner.mcount > 1)
            if count[0] > MOST_ENTITIES:
                raise MapError(
                    f"it has {inner.mcount} copies of block {shown(inner.dxf.name)}. Explode it first."
                )
            for reference in inner.multi_insert() if inner.mcount > 1 else [inner]:
                yield from _entities(reference.virtual_entities(), layer_of_entity, count, missing, deep + 1)
        elif kind == "MLINE":
            yield from _entities(inner.virtual_entities(), layer_of_entity, count, missing, deep + 1)
        else:
            yield entity, layer_of_entity


def _shapes(entities: Iterable[tuple["DXFEntity", str]], unit_m: float) -> Iterator[Shape]:
    """Shapes of the drawing, in metres."""
    from ezdxf.path import from_hatch, make_path

    for entity, layer in entities:
        kind = entity.dxftype()
        graphic: Any = entity
        is_mesh = kind == "POLYLINE" and not (graphic.is_2d_polyline or graphic.is_3d_polyline)
        if is_mesh or kind not in (*LINES, *SOLIDS, *HATCHES):
            if not _NOTES.search(kind):
                yield Shape((layer,), (), unread=kind)
            continue
        if kind == "POLYLINE":
            graphic.vertices[:] = [each for each in graphic.vertices if not each.dxf.flags & _FRAME]
        if kind == "HATCH":  # without islands that its style ignores
            paths = graphic.paths
            paths.paths = list(paths.rendering_paths(graphic.dxf.hatch_style)) or paths.paths
        widths = _widths(graphic) if kind in ("LWPOLYLINE", "POLYLINE") else [0.0]
        if len(set(widths)) > 1:
            pieces: dict[float, list[Any]] = {}
            for piece, width in zip(graphic.virtual_entities(), widths, strict=True):
                pieces.setdefault(width, []).append(make_path(piece))
        else:
            pieces = {widths[0]: list(from_hatch(graphic)) if kind in HATCHES else [make_path(graphic)]}
        for width, outlines in pieces.items():
            lines = tuple(
                unit_m * np.array([(point.x, point.y) for point in path.flattening(FLAT_M / unit_m)])
                for path in outlines
                if len(path)
            )
            if lines:
                yield Shape((layer,), lines, kind not in LINES, unit_m * width)


def _widths(polyline: Any) -> list[float]:
    """Widths that the segments of a polyline are drawn with, in drawing units; of tapered ones the mean."""
    dxf = polyline.dxf
    if polyline.dxftype() == "LWPOLYLINE":
        if dxf.get("const_width", 0.0):  # counts more than those of segments in AutoCAD
            return [dxf.const_width]
        ends, is_closed = [point[2:4] for point in polyline], polyline.closed
    elif polyline.is_2d_polyline:
        ends = [
            (
                vertex.dxf.get("start_width", dxf.default_start_width),
                vertex.dxf.get("end_width", dxf.default_end_width),
            )
            for vertex in polyline.vertices
        ]
        is_closed = polyline.is_closed
    else:
        return [0.0]
    return [float(np.mean(each)) for each in (ends if is_closed else ends[:-1])] or [0.0]
