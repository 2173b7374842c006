"""Floor plans to and from files of all formats.

`read_plan` chooses the reader by the file's ending:

- ``.yaml``, ``.yml``: ROS map_server map and the image it names (`robosim.plans.formats.ros_map`);
- ``.pgm``, ``.png`` and other images: light is free; needs the resolution (`robosim.plans.formats.plan_image`);
- ``.out``: top-down grid of mmwRobotNav (`robosim.plans.formats.mmwrobotnav`);
- ``.json``: HouseExpo (`robosim.plans.formats.houseexpo`);
- ``.npy``: NumPy array; needs the resolution (`robosim.plans.formats.plan_array`);
- ``.glb``, ``.ply``, ``.obj``, ``.stl`` and other meshes: a slice of one storey (`robosim.plans.formats.mesh_slice`);
- ``.dxf``, ``.svg``: walls of a drawing (`robosim.plans.formats.line_drawing`);
- ``.ifc``: one storey of a building model (`robosim.plans.formats.ifc`).

A bare name is a plan that comes with the package (`robosim.support.installation`). Further readers are those of
`robosim.parts.READER`. `write_ros` and `write_png` write.
"""

import stat
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import fields
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from robosim.parts import READER
from robosim.plans.floorplan import FloorPlan, MapError, ReadingOptions, check_resolution
from robosim.plans.formats.plan_array import plan_from_array
from robosim.plans.formats.plan_image import write_png
from robosim.plans.formats.ros_map import write_ros
from robosim.support.installation import shipped_plans
from robosim.support.parts import Part, part_name
from robosim.support.reading import FileError, expanded, reading, reason_of, shown
from robosim.support.text_in import MOST_JSON

__all__ = ["find_plans", "plan_from_array", "read_plan", "write_png", "write_ros"]

IMAGES = (".pgm", ".png", ".bmp", ".tif", ".tiff", ".gif", ".jpg", ".jpeg", ".webp", ".pbm", ".ppm", ".pnm")
MESHES = (".glb", ".gltf", ".ply", ".obj", ".stl", ".off")
#: Reader of each ending, of `robosim.parts.READER`.
_READERS = {
    ".yaml": "ros",
    ".yml": "ros",
    **dict.fromkeys(IMAGES, "image"),
    ".out": "mmwrobotnav",
    ".json": "houseexpo",
    ".npy": "array",
    **dict.fromkeys(MESHES, "mesh"),
    ".dxf": "dxf",
    ".svg": "svg",
    ".ifc": "ifc",
}
#: Options of some formats only, the name in messages and the readers of each.
_OPTIONS_OF_SOME = {
    "floor_height_m": ("floor height", ("mesh", "ifc")),
    "slice_m": ("slice", ("mesh", "ifc")),
    "up": ("up axis", ("mesh",)),
    "unit_m": ("unit", ("mesh", "dxf", "svg")),
    "ground_m": ("ground", ("mesh", "ifc")),
    "thinnest_wall_m": ("thinnest wall", ("image",)),
    "map_reading": ("map reading", ("ros",)),
    "wall_layers": ("wall layers", ("dxf", "svg")),
    "line_thickness_m": ("line thickness", ("dxf", "svg")),
}
_KINDS = {"ros": "ROS map", "dxf": "DXF drawing", "svg": "SVG drawing", "ifc": "IFC model"}
#: Files that are looked at for a hint in a message.
_FILES_OF_A_HINT = 1000


@runtime_checkable
class PlanReader(Protocol):
    """Reads floor plans of one format."""

    def __call__(self, path: Path, options: ReadingOptions) -> FloorPlan:
        """The plan in a file. `MapError`, a ValueError, says what is wrong with one that is damaged."""


def read_plan(path: str | Path, *, reader: Part = "auto", **options: Any) -> FloorPlan:
    """Read a floor plan from a file of any known format, or a shipped one by its name.

    Args:
        path: The file, or the name of a shipped plan.
        reader: Reader, of `robosim.parts.READER`; "auto" chooses by the file's ending.
        **options: Fields of `robosim.plans.floorplan.ReadingOptions`: resolution_m, floor_height_m, slice_m, up,
            unit_m, ground_m, thinnest_wall_m, allow_large, map_reading, wall_layers, line_thickness_m.

    Returns:
        The plan; rows of images, which grow downwards, are reversed so that y grows upwards.

    Raises:
        MapError: If there is no such file, its kind is unknown, an option does not apply to it, or its
            content is damaged or senseless. The message names the file, the value and the fix.
    """
    path = _resolve(path, any_ending=reader != "auto")
    chosen = ReadingOptions(**options)
    if reader == "auto":
        reader = _READERS[path.suffix.lower()]
    read: PlanReader = READER.make(reader, field="reader")
    if isinstance(reader, str) and reader in READER.shipped:
        _check_options(path, chosen, reader)
    try:
        if chosen.resolution_m is not None:
            check_resolution(chosen.resolution_m)
        plan = read(path, chosen)
        if not isinstance(plan, FloorPlan):
            raise MapError(f"reader {part_name(reader)} gave a {type(plan).__name__}, expected a FloorPlan")
        return plan
    except MapError as error:
        # Errors of a plan as such name the plan; the user knows it by its file.
        if shown(path) in str(error):
            raise
        raise MapError(f"{shown(path)}: {error}") from error


def _check_options(path: Path, options: ReadingOptions, reader: str) -> None:
    """Raise MapError for an option that a shipped reader would ignore."""
    if options.resolution_m is not None and reader == "ros":
        raise MapError(
            f"{shown(path)}: a ROS map says its resolution itself. Leave the option out, or edit the file."
        )
    for field in fields(options):
        name, readers = _OPTIONS_OF_SOME.get(field.name, ("", (reader,)))
        value = getattr(options, field.name)
        if value != field.default and reader not in readers:
            kind = " or ".join(_KINDS.get(kind_name, kind_name) for kind_name in readers)
            raise MapError(f"{shown(path)}: {name} is {value}, but this is no {kind}. Leave the option out.")


def _resolve(path: str | Path, *, any_ending: bool = False) -> Path:
    """The file of a path or a shipped plan's name; its ending must be known unless `any_ending`."""
    file = expanded(path)
    if _is_folder(file):
        raise MapError(f"{shown(file)}: is a folder, expected one floor plan.{_plans_inside(file)}")
    if not file.exists():
        shipped = shipped_plans()
        if str(path) in shipped:
            return shipped[str(path)]
        raise MapError(
            f"{shown(file)}: no such file, and no shipped plan of that name.{_did_you_mean(file, shipped)}"
        )
    if not any_ending and file.suffix.lower() not in _READERS:
        raise MapError(
            f"{shown(file)}: the ending '{shown(file.suffix)}' is unknown, expected one of {' '.join(_READERS)}. "
            "Rename or convert the file, or give a reader of your own: --reader module:Name."
        )
    return file


def _is_folder(path: Path) -> bool:
    """Whether a path is a folder; raises MapError for what cannot be a path."""
    try:
        return stat.S_ISDIR(path.stat().st_mode)
    except FileNotFoundError:
        return False
    except (OSError, ValueError) as error:
        raise MapError(f"{shown(path)}: cannot be opened ({reason_of(error)}).") from error


def _did_you_mean(file: Path, shipped: dict[str, Path]) -> str:
    """A hint at files and shipped plans with a similar name."""
    names = {name: name for name in shipped}
    with suppress(OSError):
        siblings = [p for p in file.parent.iterdir() if p.suffix.lower() in _READERS]
        names.update({p.name: str(p) for p in siblings})
        names.update({Path(name).stem: full for name, full in list(names.items()) if full not in shipped})
    near = get_close_matches(file.name, names, 2, cutoff=0.7)
    if near:
        return f" Did you mean {' or '.join(dict.fromkeys(repr(shown(names[name])) for name in near))}?"
    return f" Shipped plans: {', '.join(shipped)}." if shipped else ""


def _plans_inside(folder: Path) -> str:
    # A hint is not worth reading a whole disk.
    inside = _plans_in(folder, max_files=_FILES_OF_A_HINT)
    if not inside:
        return ""
    more = f" and {len(inside) - 5} more" if len(inside) > 5 else ""
    return f" Inside are {', '.join(shown(p.relative_to(folder)) for p in inside[:5])}{more}."


def find_plans(plans: Sequence[str | Path], reader: Part = "auto") -> list[Path]:
    """Files of floor plans: given ones, shipped ones by name, and all in given folders, in order.

    In folders, ROS maps, mmwRobotNav grids and HouseExpo files count; images, arrays and meshes do not, since
    they need options or belong to a map.
    """
    files: list[Path] = []
    for plan in plans:
        folder = expanded(plan)
        if not _is_folder(folder):
            files.append(_resolve(plan, any_ending=reader != "auto"))
            continue
        inside = _plans_in(folder)
        if not inside:
            raise MapError(
                f"{shown(folder)}: no floor plan in this folder, expected ROS .yaml, .out or HouseExpo .json files."
            )
        files += inside
    return files


def _plans_in(folder: Path, max_files: int | None = None) -> list[Path]:
    """Floor plans in a folder and its subfolders, sorted, among the first `max_files` files."""
    marks = {".yaml": b"image:", ".yml": b"image:", ".json": b'"verts"', ".out": b""}
    return sorted(
        p
        for p in islice(folder.rglob("*"), max_files)
        if p.suffix in marks and p.is_file() and _holds(p, marks[p.suffix])
    )


def _holds(path: Path, mark: bytes) -> bool:
    """Whether a file contains a mark; other files of the same ending are skipped."""
    if not mark:
        return True
    try:
        with reading(path, "a floor plan", most_bytes=MOST_JSON) as file:
            return mark in file.read()
    except FileError:
        return False
