"""Floor plans to and from files: one door for all formats.

`read_plan` picks the reader by the file's ending:

- ``.yaml``, ``.yml``: ROS map_server map and the image it names (`robosim.plans.formats.ros_map`);
- ``.pgm``, ``.png`` and other images: light is free; needs the resolution (`robosim.plans.formats.plan_image`);
- ``.out``: top-down grid of mmwRobotNav (`robosim.plans.formats.mmwrobotnav`);
- ``.json``: HouseExpo (`robosim.plans.formats.houseexpo`);
- ``.npy``: NumPy array; needs the resolution (`robosim.plans.formats.plan_array`);
- ``.glb``, ``.ply``, ``.obj``, ``.stl`` and other meshes: a slice of one storey (`robosim.plans.formats.mesh_slice`).

A bare name is a plan that comes with the package (`robosim.support.assets`). A reader of your own is one of
`robosim.parts.READER`. `write_ros` and `write_png` write.
"""

import stat
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import Protocol, runtime_checkable

from robosim.parts import READER
from robosim.plans.floorplan import FloorPlan, MapError, MapReading, check_resolution, check_size
from robosim.plans.formats import mesh_slice
from robosim.plans.formats.houseexpo import read_houseexpo
from robosim.plans.formats.mesh_slice import UpAxis, read_mesh
from robosim.plans.formats.mmwrobotnav import read_mmwrobotnav
from robosim.plans.formats.plan_array import plan_from_array, read_npy
from robosim.plans.formats.plan_image import read_image_plan, write_png
from robosim.plans.formats.ros_map import read_ros, write_ros
from robosim.plans.storeys import is_storeys
from robosim.support.assets import shipped_plans
from robosim.support.parts import Part, told
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
}
_FILES_OF_A_HINT = 1000


@dataclass(frozen=True, kw_only=True)
class Said:
    """What was said of a plan beside its file; readers take what they need."""

    resolution_m: float | None = None
    """Side of a cell [m]."""
    floor_height_m: float | None = None
    """Height of the storey's floor [m]."""
    slice_m: tuple[float, float] | None = None
    """Heights above the floor between which nothing may stand in free cells [m]."""
    up: UpAxis = "auto"
    """Axis that points up."""
    unit_m: float | None = None
    """Unit of length [m]; None for metres, if the mesh is of a plausible size then."""
    ground_m: float | None = None
    """Height of level ground to add below a mesh without a floor [m]."""
    thinnest_wall_m: float | None = None
    """Thickness below which dark strokes of a picture are no walls [m]."""
    allow_large: bool = False
    """Whether a picture or array may be of a building longer than `robosim.plans.floorplan.LARGEST_M`."""
    map_reading: MapReading = "common"
    """How greys of a ROS map become unknown."""


@runtime_checkable
class PlanReader(Protocol):
    """Reads floor plans of one format."""

    def __call__(self, path: Path, said: Said) -> FloorPlan:
        """The plan in a file. `MapError`, a ValueError, says what is wrong with one that is damaged."""


def read_plan(
    path: str | Path,
    *,
    resolution_m: float | None = None,
    floor_height_m: float | None = None,
    slice_m: tuple[float, float] | None = None,
    up: UpAxis = "auto",
    unit_m: float | None = None,
    ground_m: float | None = None,
    thinnest_wall_m: float | None = None,
    allow_large: bool = False,
    map_reading: MapReading = "common",
    reader: Part = "auto",
) -> FloorPlan:
    """Read a floor plan from a file of any known format, or a shipped one by its name.

    Args:
        path: The file, or the name of a shipped plan.
        resolution_m: Side of a cell [m]. Needed for images and arrays, which do not say; otherwise 0.05 for
            grids, HouseExpo and meshes. A ROS map says itself.
        floor_height_m: For meshes: height of the storey's floor [m]; the lowest storey if not given.
        slice_m: For meshes: heights above the floor between which nothing may stand in free cells [m];
            0.2 to 1.5 if not given.
        up: For meshes: the axis that points up; "auto" is y for glTF and z for others.
        unit_m: For meshes: the file's unit of length [m], for example 0.001 for millimetres; metres if not given, and
            an error if the building is implausibly large then.
        ground_m: For meshes without a floor: height of level ground below all of it [m].
        thinnest_wall_m: For images: dark strokes thinner than this are not walls but text, door arcs or furniture, and
            are dropped [m]; all are walls if not given.
        allow_large: For images and arrays: confirms a building longer than 500 m.
        map_reading: For ROS maps: "common" reads a common grey as unknown where map_server's thresholds would make it
            free, with a warning; "letter" goes by the thresholds alone.
        reader: Who reads it, of `robosim.parts.READER`; "auto" goes by the file's ending.

    Returns:
        The plan; rows of images, which grow downwards, are turned so that y grows upwards.

    Raises:
        MapError: If there is no such file, its kind is unknown, an option does not apply to it, or its
            content is damaged or senseless. The message names the file, the value and the fix.
        ValueError: If there is no such reader.
    """
    path = _resolve(path, any_ending=reader != "auto")
    said = Said(
        resolution_m=resolution_m,
        floor_height_m=floor_height_m,
        slice_m=slice_m,
        up=up,
        unit_m=unit_m,
        ground_m=ground_m,
        thinnest_wall_m=thinnest_wall_m,
        allow_large=allow_large,
        map_reading=map_reading,
    )
    if reader == "auto":
        reader = _READERS[path.suffix.lower()]
    read: PlanReader = READER.make(reader, field="reader")
    if isinstance(reader, str) and reader in READER.shipped:
        _check_said(path, said, reader)
    try:
        if resolution_m is not None:
            check_resolution(resolution_m)
        plan = read(path, said)
        if not isinstance(plan, FloorPlan):
            raise MapError(f"reader {told(reader)} gave a {type(plan).__name__}, expected a FloorPlan")
        return plan
    except MapError as error:
        # What is wrong with the plan as such is said by its name; the user knows it by its file.
        if shown(path) in str(error):
            raise
        raise MapError(f"{shown(path)}: {error}") from error


def _check_said(path: Path, said: Said, reader: str) -> None:
    """Refuse what a reader that comes with this package would not look at."""
    if said.resolution_m is not None and reader == "ros":
        raise MapError(
            f"{shown(path)}: a ROS map says its resolution itself. Leave the option out, or edit the file."
        )
    options = (
        ("floor height", said.floor_height_m, None, "mesh"),
        ("slice", said.slice_m, None, "mesh"),
        ("up axis", said.up, "auto", "mesh"),
        ("unit", said.unit_m, None, "mesh"),
        ("ground", said.ground_m, None, "mesh"),
        ("thinnest wall", said.thinnest_wall_m, None, "image"),
        ("map reading", said.map_reading, "common", "ros"),
    )
    kinds = {"ros": "ROS map"}
    for name, value, default, of in options:
        if value != default and reader != of:
            raise MapError(
                f"{shown(path)}: {name} is {value}, but this is no {kinds.get(of, of)}. Leave the option out."
            )


def ros_map(path: Path, said: Said) -> FloorPlan:
    """A ROS map_server map."""
    if is_storeys(path):
        raise MapError(
            f"{shown(path)}: is a building of several storeys, expected one floor plan. Give one of the plans that it "
            "lists; `robosim trace` and `robosim dataset` take the whole building."
        )
    return read_ros(path, map_reading=said.map_reading)


def image(path: Path, said: Said) -> FloorPlan:
    """A picture in which light is free."""
    return read_image_plan(
        path, said.resolution_m, thinnest_wall_m=said.thinnest_wall_m, allow_large=said.allow_large
    )


def array(path: Path, said: Said) -> FloorPlan:
    """A NumPy array."""
    plan = read_npy(path, said.resolution_m)
    if not said.allow_large:
        check_size(plan.shape, plan.resolution_m)
    return plan


def navigation_grid(path: Path, said: Said) -> FloorPlan:
    """A grid of mmwRobotNav."""
    return read_mmwrobotnav(path, said.resolution_m or 0.05)


def house(path: Path, said: Said) -> FloorPlan:
    """A plan of HouseExpo."""
    return read_houseexpo(path, said.resolution_m or 0.05)


def storey(path: Path, said: Said) -> FloorPlan:
    """A slice of a mesh."""
    return read_mesh(
        path,
        resolution_m=said.resolution_m or mesh_slice.RESOLUTION_M,
        floor_height_m=said.floor_height_m,
        slice_m=said.slice_m or mesh_slice.SLICE_M,
        up=said.up,
        unit_m=said.unit_m,
        ground_m=said.ground_m,
    )


def _resolve(path: str | Path, *, any_ending: bool = False) -> Path:
    """The file that is meant, of a known kind unless any will do."""
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
    """Whether a path, which may be no path at all, is a folder."""
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
        beside = [p for p in file.parent.iterdir() if p.suffix.lower() in _READERS]
        names.update({p.name: str(p) for p in beside})
        names.update({Path(name).stem: full for name, full in list(names.items()) if full not in shipped})
    near = get_close_matches(file.name, names, 2, cutoff=0.7)
    if near:
        return f" Did you mean {' or '.join(dict.fromkeys(repr(shown(names[name])) for name in near))}?"
    return f" Shipped plans: {', '.join(shipped)}." if shipped else ""


def _plans_inside(folder: Path) -> str:
    # A hint is not worth a walk through a whole disk.
    inside = _plans_in(folder, most=_FILES_OF_A_HINT)
    if not inside:
        return ""
    more = f" and {len(inside) - 5} more" if len(inside) > 5 else ""
    return f" Inside are {', '.join(shown(p.relative_to(folder)) for p in inside[:5])}{more}."


def find_plans(plans: Sequence[str | Path], reader: Part = "auto") -> list[Path]:
    """Files of floor plans: those given, shipped ones by name, and all that lie in given folders, in order.

    In folders, ROS maps, mmwRobotNav grids and HouseExpo files count; images, arrays and meshes do not, since
    they need options or belong to a map.

    Raises:
        MapError: If a file or name does not exist or is of an unknown kind, or a folder has no plan.
    """
    found: list[Path] = []
    for plan in plans:
        folder = expanded(plan)
        if not _is_folder(folder):
            found.append(_resolve(plan, any_ending=reader != "auto"))
            continue
        inside = _plans_in(folder)
        if not inside:
            raise MapError(
                f"{shown(folder)}: no floor plan in this folder, expected ROS .yaml, .out or HouseExpo .json files."
            )
        found += inside
    return found


def _plans_in(folder: Path, most: int | None = None) -> list[Path]:
    """Floor plans in a folder and those below, by name, among so many files at most."""
    marks = {".yaml": b"image:", ".yml": b"image:", ".json": b'"verts"', ".out": b""}
    return sorted(
        p
        for p in islice(folder.rglob("*"), most)
        if p.suffix in marks and p.is_file() and _holds(p, marks[p.suffix])
    )


def _holds(path: Path, mark: bytes) -> bool:
    """Whether a file has a mark in it, so that other files of the same ending are passed over."""
    if not mark:
        return True
    try:
        with reading(path, "a floor plan", most_bytes=MOST_JSON) as file:
            return mark in file.read()
    except FileError:
        return False
