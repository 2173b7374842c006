"""Floor plans in SVG drawings, read by `svgelements` (extra `svg`).

Paths, lines, polylines, polygons, rectangles, circles and ellipses with their transforms, as
`robosim.plans.formats.line_drawing` reads them: dark fills are areas, strokes are lines of their own width. Layers are
groups, by the labels that Inkscape gives them, their ids or their classes; shapes can be chosen by their own id and
class too. The lower left corner of the picture is the origin of `map`.

A picture's size in mm, cm, in, pt or pc is that of the building, unless a unit is given: then the view box has that
unit, and without either a drawing is an error. Left out: text, pictures, clipping, what covers what; with a
warning, dashes, origins of transforms, symbols with view boxes, rules of style sheets for more than a name, and colours
with other separators than commas. Of colours for light and dark screens the light one counts.

Reference: W3C, Scalable Vector Graphics 2 (2018), chapter 8 (coordinate systems, transformations and units).
"""

import io
import logging
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from robosim.plans.floorplan import FloorPlan, MapError, ReadingOptions
from robosim.plans.formats.line_drawing import FLAT_M, Shape, plan_from_shapes
from robosim.support.installation import is_installed, missing_extra
from robosim.support.reading import one_line, reading

logger = logging.getLogger(__name__)

UNITS_M = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "pt": 0.0254 / 72, "pc": 0.0254 / 6}
#: A user unit of a picture without a view box [m].
PIXEL_M = 0.0254 / 96
#: Lighter fills and strokes are paper, from 0 to 255.
PAPER = 200
#: Most shapes, copies included; most lines of a curve.
MOST_SHAPES, MOST_LINES = 100_000, 1000
_REMEDY = "Save it again as plain SVG."
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
#: Attributes of numbers, and words that are NaN or infinite.
_NUMBERS = {"x", "y", "r", "cx", "cy", "rx", "ry", "x1", "y1", "x2", "y2", "d", "points", "width", "height"}
_NUMBERS |= {"transform", "viewBox", "stroke-width", "style"}
_LENGTHS = {"r", "rx", "ry", "width", "height", "stroke-width"}
#: Elements that are not drawn where they are; attributes that place a drawing within the drawing.
_UNDRAWN, _PLACE = ("symbol", "marker", "mask", "foreignObject"), ("viewBox", "x", "y")
#: Selectors of style sheets that are read, and rules of a sheet as such.
_SELECTOR = re.compile(r"\s*(\*|@.*|#[\w-]+|[\w-]*\.?[\w-]+)\s*")
#: Properties of style that are not read: those that break a line (zeros and words do not), and turn about a point.
_UNREAD = (
    (
        re.compile(r"stroke-dasharray\s*:[^;}]*[1-9]"),
        "dashed lines, by {} styles with stroke-dasharray, are read as full ones. Take out those that are no walls.",
    ),
    (
        re.compile(r"(?<![\w-])transform-origin\s*:"),
        "transform-origin is not read, so that shapes of {} styles may lie in a wrong place. Save it without.",
    ),
)
#: Paints of a style; the light one of two, as of draw.io; those of the group above; those that svgelements reads.
_PAINT = re.compile(r"(?<![\w-])(?:fill|stroke)\s*:\s*([^;}]*[^;}\s])")
_BY_SCHEME = re.compile(r"light-dark\(((?:[^(),]|\([^()]*\))*),[^;}]*")
_INHERITED = re.compile(r"(?:^|(?<![\w-])(?:fill|stroke)\s*:)\s*(?:inherit|unset)(?![\w-])")
_COLOUR = re.compile(
    r"#[0-9a-f]{3,8}|url\([^)]*\)|[a-z-]+|rgba?\(\s*\d+\s*(,\s*\d+\s*){2}(,\s*[\d.]+\s*)?\)"
    r"|(rgb|hsl)a?\([^,]*(,[^,]*%\s*){2}(,[^%]*)?\)",
    re.IGNORECASE,
)
_NAN = re.compile(r"(?<![\w.#-])[+-]?(nan|inf(inity)?)(?![\w-])", re.IGNORECASE)
_LENGTH = re.compile(r"\s*([0-9.eE+-]+)\s*([a-z%]*)\s*")


def read_svg(path: Path, options: ReadingOptions) -> FloorPlan:
    """Floor plan from an SVG drawing; uses `unit_m` and what `plan_from_shapes` uses."""
    if not is_installed("svgelements"):
        raise missing_extra("svgelements", "An SVG drawing")
    from svgelements import SVG

    with reading(path, "an SVG drawing", _REMEDY, kind=MapError) as file:
        root = ET.parse(file).getroot()
        if root.tag.rpartition("}")[2] != "svg":
            raise ValueError(f"it begins with <{root.tag}>, expected <svg>")
        for element in root.iter():
            for key, value in element.attrib.items():
                if key in _NUMBERS and _NAN.search(value):
                    tag = element.tag.rpartition("}")[2]
                    raise MapError(
                        f"{key} of <{tag}> is {one_line(value)!r}, expected finite numbers. Export it again."
                    )
                if key in _LENGTHS and value.lstrip().startswith("-"):
                    raise MapError(f"{key} is {one_line(value)!r}, expected 0 or more. Export it again.")
        _check_copies(root)
        _simplify_paints(root, path)
        _rearrange(root, path)
        (left, top, width, height), physical_m = _view(root, needs_unit=options.unit_m is None)
        unit_m = options.unit_m or physical_m
        if unit_m is None:
            raise MapError(
                "the drawing does not say how large its units are. Give it: --unit 0.01 if a unit is a centimetre of "
                "the building, or set width and height in mm, cm or in."
            )
        # Coordinates of the view box, one to one.
        root.attrib.update(
            width=f"{width!r}", height=f"{height!r}", viewBox=f"{left!r} {top!r} {width!r} {height!r}"
        )
        picture = SVG.parse(io.BytesIO(ET.tostring(root)), reify=True)
        return plan_from_shapes(_shapes(picture, (), unit_m, height), path, options)


def _simplify_paints(root: ET.Element, path: Path) -> None:
    """Rewrite paints that svgelements reads as black, with a warning for colours that it may read wrongly."""
    strange = []
    for element in root.iter():
        paints = {"fill", "stroke", "style"}.intersection(element.attrib)
        texts = {key: element.attrib.pop(key) for key in sorted(paints)}
        if element.tag.rpartition("}")[2] == "style":
            texts[""] = element.text or ""
        for key, text in texts.items():
            text = _INHERITED.sub("", _BY_SCHEME.sub(r"\1", text.replace("!important", ""))).strip()
            strange += _PAINT.findall(text if key in ("style", "") else f"fill:{text}")
            if not key:
                element.text = text
            elif text:
                element.set(key, text)
    strange = [paint for paint in strange if not _COLOUR.fullmatch(paint)]
    if strange:
        logger.warning(
            f"{path}: {len(strange)} colours such as {one_line(strange[0])!r} are not understood and may be read as "
            "black or left out. Save it with colours such as #ffffff."
        )


def _rearrange(root: ET.Element, path: Path) -> None:
    """Take out what svgelements draws in a wrong place, with a warning; put style sheets before all shapes.

    It draws symbols where they are defined too, and without the transform of their view boxes.
    """
    sheets: list[ET.Element] = []
    undrawn, scaled = ET.Element(f"{root.tag[:-3]}defs"), 0
    for parent in [*root.iter()]:
        for child in [*parent]:
            tag = child.tag.rpartition("}")[2]
            if tag in ("svg", "symbol") and any(child.get(key, "").strip(" 0.px") for key in _PLACE):
                scaled += 1
                del child[:]
            if tag == "style":
                child.text = (child.text or "").replace("}", ";}")
            if tag in ("style", *_UNDRAWN):
                parent.remove(child)
                (sheets if tag == "style" else undrawn).append(child)
    root[:0] = [*sheets, undrawn]
    if scaled:
        logger.warning(
            f"{path}: {scaled} symbols or drawings within the drawing, which have a view box or place, are left out. "
            "Unlink and ungroup them."
        )
    styles = [";".join([*map(":".join, each.items()), each.text or ""]) for each in root.iter()]
    for pattern, problem in _UNREAD:
        if count := sum(map(bool, map(pattern.search, styles))):
            logger.warning(f"{path}: {problem.format(count)}")
    text = re.sub(r"/\*.*?\*/", "", " ".join(sheet.text or "" for sheet in sheets), flags=re.DOTALL)
    rules = [rule for piece in text.split("{")[:-1] for rule in piece.rpartition("}")[2].split(",")]
    unread = [rule.strip() for rule in rules if not _SELECTOR.fullmatch(rule)]
    if unread:
        logger.warning(
            f"{path}: the rules of its style sheet for {one_line(unread[0])!r} are not read, so that shapes may be "
            "painted otherwise. Save it with attributes instead of a style sheet."
        )


def _view(root: ET.Element, needs_unit: bool) -> tuple[tuple[float, float, float, float], float | None]:
    """The view box in user units, and how large a unit is if the picture says so [m]; ValueError if it says two."""
    sides = [_LENGTH.fullmatch(root.get(name, "")) for name in ("width", "height")]
    numbers = [float(side[1]) if side and side[2] != "%" else math.nan for side in sides]
    box = [float(word) for word in root.get("viewBox", "").replace(",", " ").split()]
    sizes_m = [UNITS_M.get(side[2]) if side else None for side in sides]
    size_m = sizes_m[0]
    if not box:
        if size_m is not None:
            numbers = [n * (unit or size_m) / PIXEL_M for n, unit in zip(numbers, sizes_m, strict=True)]
        box, size_m = [0.0, 0.0, *numbers], None if size_m is None else PIXEL_M
    if len(box) != 4 or not (np.isfinite(box).all() and box[2] > 0 and box[3] > 0):
        raise ValueError("it has neither a viewBox of four numbers, of positive size, nor width and height")
    if root.get("viewBox") and size_m is not None:
        units_m = [n * s / side for n, s, side in zip(numbers, sizes_m, box[2:], strict=True) if s]
        if needs_unit and max(units_m) > 1.02 * min(units_m):
            raise ValueError(f"by width a unit is {units_m[0]:g} m, by height {units_m[1]:g} m; give --unit")
        size_m = units_m[0]
    return (box[0], box[1], box[2], box[3]), size_m


def _check_copies(root: ET.Element) -> None:
    """Raise MapError for copies (<use>) of themselves, and for too many shapes."""
    by_id = {element.get("id"): element for element in root.iter() if element.get("id")}
    known: dict[ET.Element, int] = {}

    def count(element: ET.Element, above: tuple[ET.Element, ...]) -> int:
        if element in above:
            raise MapError("it has a copy (<use>) of itself. Save it again without copies.")
        if element not in known:
            inside = list(element)
            if element.tag.rpartition("}")[2] == "use":
                link = next((value for key, value in element.attrib.items() if key.endswith("href")), "")
                inside += [by_id[link[1:]]] if link[1:] in by_id else []
            known[element] = 1 + sum(count(child, (*above, element)) for child in inside)
        return known[element]

    if count(root, ()) > MOST_SHAPES:
        raise MapError(f"it has more than {MOST_SHAPES} shapes. Save the layers of walls alone.")


def _shapes(group: Any, names: tuple[str, ...], unit_m: float, height: float) -> Iterator[Shape]:
    """What is drawn in a group and those within, in metres; `names` are those of the groups, the innermost first."""
    import svgelements

    for element in group:
        values = element.values.get("attributes", element.values)
        label, identifiers = values.get(_LABEL), [values.get(name) for name in ("id", "class")]
        if isinstance(element, svgelements.Group | svgelements.Use):
            yield from _shapes(element, (*filter(None, [label, *identifiers]), *names), unit_m, height)
        elif isinstance(element, svgelements.Shape) and not _is_hidden(element.values):
            path = abs(svgelements.Path(element))  # with the transform that turned rectangles have
            lines = tuple(
                unit_m * np.array([[x, height - y] for x, y in line])
                for line in (_flattened(svgelements.Path(subpath), unit_m) for subpath in path.as_subpaths())
                if len(line) > 1
            )
            if not lines:
                continue
            all_names = (*(names or ("",)), *filter(None, [label, *identifiers]))
            if _is_dark(element.fill, values.get("fill") is None) and not isinstance(
                element, svgelements.SimpleLine
            ):
                is_nonzero = element.values.get("fill-rule") != "evenodd"
                yield Shape(all_names, lines, is_area=True, is_nonzero=is_nonzero)
            if _is_dark(element.stroke, False):
                yield Shape(all_names, lines, width_m=unit_m * float(path.stroke_width or 0.0))


def _is_hidden(values: dict[str, Any]) -> bool:
    """Whether a shape, or a group that it is in, is invisible or wholly transparent."""
    return values.get("visibility") in ("hidden", "collapse") or bool(
        re.fullmatch(r"\s*[0.]+%?\s*", values.get("opacity", "1"))
    )


def _is_dark(colour: Any, by_default: bool) -> bool:
    """Whether something is painted, and not as light as paper."""
    if colour is None or colour.value is None:
        return by_default and colour is None
    return bool(255 - colour.alpha / 255 * (255 - (colour.red + colour.green + colour.blue) / 3) < PAPER)


def _flattened(path: Any, unit_m: float) -> list[tuple[float, float]]:
    """Corners of lines along one part of a path."""
    import svgelements

    points: list[tuple[float, float]] = []
    for segment in path:
        if segment.end is None:
            continue
        if isinstance(segment, svgelements.Curve):
            left, top, right, bottom = segment.bbox()
            length_m = unit_m * 2 * math.hypot(right - left, bottom - top)
            count = min(max(2, math.ceil(math.sqrt(length_m / FLAT_M))), MOST_LINES)
            points += [tuple(segment.point(t)) for t in np.linspace(0, 1, count + 1)[1:]]
        else:
            points.append((float(segment.end.x), float(segment.end.y)))
    return points
