"""Furnishings of a building as a YAML file: a list of pieces of furniture and of meshes, each at its place.

    - piece: table              # one of robosim.plans.furnishings.pieces.PIECES, and any of its sizes
      width_m: 1.6
      at: [2.0, 1.5]            # x, y of its middle [m], in the frame of the plan
      yaw_deg: 90               # counter-clockwise
    - mesh: chair.stl           # STL, OBJ, PLY, GLB, GLTF or OFF; relative to this file
      unit_m: 0.001             # of its coordinates; metres if not given
      up: z                     # y for GLB and GLTF if not given, z for others
      origin: middle            # of the mesh: the middle of its lowest level, or "own"
      at: [3.1, 1.5]
      z_m: 0.0                  # its lowest point above the floor
      material: plywood         # radio material: a registered name, or a file of layers relative to this file
      colour: [120, 90, 60]
      name: chair by the window

Only `piece` or `mesh`, and `at`, are needed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, make_dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import trimesh
import yaml

from robosim.parts import MATERIAL
from robosim.plans.floorplan import MapError, UpAxis
from robosim.plans.formats.mesh_file import MOST_BYTES, load_triangles
from robosim.plans.formats.mesh_slice import turned_up
from robosim.plans.furnishings.furnishing import Furnishing
from robosim.plans.furnishings.pieces import PIECES, make_piece
from robosim.support.checks import check_choice, check_number
from robosim.support.files import write_whole
from robosim.support.from_dict import from_dict
from robosim.support.parts import names_code, part_name
from robosim.support.reading import FileError, reading, shown
from robosim.support.text_in import check_object, parse_yaml

Origin = Literal["middle", "own"]

#: Entries of a file, and triangles of all its meshes together.
_MOST_ENTRIES, _MOST_TRIANGLES = 10_000, 2_000_000
_WHAT = "a list of what is placed in a building"
_REMEDY = "Give entries such as '- {piece: table, at: [2, 1.5]}' or '- {mesh: chair.stl, at: [3, 1.5]}'."
_UNIT_M = 1e-9, 1e6, "m, such as 0.001 for millimetres"


@dataclass(frozen=True, kw_only=True)
class _Entry:
    """Keys of any entry."""

    at: tuple[float, float]
    z_m: float = 0.0
    yaw_deg: float = 0.0
    name: str | None = None
    material: str | None = None
    colour: tuple[int, int, int] | None = None


@dataclass(frozen=True, kw_only=True)
class _MeshEntry(_Entry):
    """Keys of a mesh."""

    mesh: str
    unit_m: float = 1.0
    up: UpAxis = "auto"
    origin: Origin = "middle"


def read_furnishings(path: str | Path) -> tuple[Furnishing, ...]:
    """The furnishings that a file lists.

    Raises:
        FileError: If it, or a file that it names, is damaged, or an entry makes no sense.
    """
    path = Path(path)
    with reading(path, _WHAT, _REMEDY, kind=MapError) as file:
        entries = parse_yaml(file.read())
        if not isinstance(entries, list) or len(entries) > _MOST_ENTRIES:
            raise ValueError(f"it holds no list of at most {_MOST_ENTRIES} entries")
        furnishings: list[Furnishing] = []
        for number, entry in enumerate(entries, 1):
            try:
                furnishing = _furnishing(check_object(entry, ("at",)), path.parent)
                furnishings.append(replace(furnishing, source=f"{shown(path)}: entry {number}"))
            except FileError as error:
                raise MapError(f"{shown(path)}: entry {number}: {error}") from error
            except ValueError as error:
                raise ValueError(f"entry {number}: {error}") from error
            if sum(len(furnishing.mesh.faces) for furnishing in furnishings) > _MOST_TRIANGLES:
                raise ValueError(f"more than {_MOST_TRIANGLES} triangles up to entry {number}")
        return tuple(furnishings)


def furnishing_from_file(
    mesh: str | Path,
    *,
    unit_m: float = 1.0,
    up: UpAxis = "auto",
    origin: Origin = "middle",
    **placement: Any,
) -> Furnishing:
    """A mesh file at a place.

    Args:
        mesh: STL, OBJ, PLY, GLB, GLTF or OFF.
        unit_m: The file's unit of length [m].
        up: The axis that points up; "auto" is y for glTF and z for others.
        origin: "middle" of its lowest level, or the file's "own".
        **placement: Fields of `Furnishing`: at, its place x, y [m] in `map`; z_m; yaw_rad; name, that of the file if
            not given; material; colour.

    Raises:
        FileError: If the file is damaged, or has no triangles.
        ValueError: If an option has a senseless value.
    """
    mesh = Path(mesh)
    check_choice("up", up, get_args(UpAxis))
    check_choice("origin", origin, get_args(Origin))
    check_number("unit_m", unit_m, *_UNIT_M)
    remedy = "Export it again, as GLB, PLY, OBJ or STL."
    with reading(mesh, "a mesh", remedy, most_bytes=MOST_BYTES, kind=MapError) as file:
        axis = up if up != "auto" else "y" if mesh.suffix.lower() in (".glb", ".gltf") else "z"
        triangles = turned_up(load_triangles(file.read(), mesh, unit_m), axis)
        if origin == "middle":
            low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
            triangles = triangles - [*(low + high)[:2] / 2, low[2]]
        faces = np.arange(3 * len(triangles)).reshape(-1, 3)
        body = trimesh.Trimesh(triangles.reshape(-1, 3), faces, process=False, validate=False)
        # Checks the mesh: errors of the place are not errors of its file.
        Furnishing(mesh=body, at=(0.0, 0.0))
    said = {"mesh": str(mesh.resolve()), "unit_m": unit_m, "up": axis, "origin": origin}
    return Furnishing(mesh=body, said=said, **{"name": mesh.stem, **placement})


def write_furnishings(furnishings: Sequence[Furnishing], path: str | Path) -> Path:
    """Write a file that `read_furnishings` reads back; meshes from memory go into OBJ files in its folder.

    Angles are written in degrees, so that they may come back changed in the last digit.
    """
    path = Path(path)
    entries = []
    for number, furnishing in enumerate(furnishings, 1):
        said = dict(furnishing.said)
        if not said:
            file = path.with_name(f"{path.stem}-{number}.obj")
            write_whole(file, _obj(furnishing.mesh))
            said = {"mesh": file.name, "up": "z", "origin": "own"}
        material = part_name(furnishing.material)
        if names_code(material):
            raise MapError(
                f"{path}: material of {furnishing.name} is {material}, which a file cannot name. Write its layers into "
                "a .yaml file, and name that."
            )
        if not MATERIAL.is_name(material):
            material = str(Path(material).resolve())
        entries.append(
            {
                **{
                    key: value if isinstance(value, (str, int)) else float(value)
                    for key, value in said.items()
                },
                "at": [float(value) for value in furnishing.at],
                "yaw_deg": float(np.degrees(furnishing.yaw_rad)),
                "z_m": float(furnishing.z_m),
                "name": furnishing.name,
                "material": material,
                "colour": [int(value) for value in furnishing.colour],
            }
        )
    text = yaml.safe_dump(
        entries, sort_keys=False, default_flow_style=None, width=1_000_000, allow_unicode=True
    )
    write_whole(path, text.encode("utf-8"))
    return path


def _obj(mesh: trimesh.Trimesh) -> bytes:
    """A mesh as an OBJ file with all digits of its corners."""
    corners = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(mesh.vertices, float).tolist()]
    faces = [f"f {a} {b} {c}" for a, b, c in (np.asarray(mesh.faces) + 1).tolist()]
    return "\n".join([*corners, *faces, ""]).encode()


def _furnishing(keys: dict[str, Any], folder: Path) -> Furnishing:
    """One entry; raises ValueError in a few words."""
    if ("piece" in keys) == ("mesh" in keys):
        raise ValueError("expected one of piece and mesh")
    if "piece" in keys:
        check_choice("piece", keys["piece"], PIECES)
        kind: Any = PIECES[keys["piece"]]
        known: Any = make_dataclass(
            "_PieceEntry", [("piece", str)], bases=(_Entry, kind), frozen=True, kw_only=True
        )
        entry = from_dict(known, keys)
        sizes = {size.name: getattr(entry, size.name) for size in fields(kind) if size.name in keys}
        return make_piece(keys["piece"], **_place(entry, folder), **sizes)
    stated = from_dict(_MeshEntry, keys)
    return furnishing_from_file(
        folder / stated.mesh,
        unit_m=stated.unit_m,
        up=stated.up,
        origin=stated.origin,
        **_place(stated, folder),
    )


def _place(entry: _Entry, folder: Path) -> dict[str, Any]:
    """The keys that all entries have in common."""
    place: dict[str, Any] = {"at": entry.at, "z_m": entry.z_m, "yaw_rad": float(np.radians(entry.yaw_deg))}
    for key in ("name", "colour"):
        if getattr(entry, key) is not None:
            place[key] = getattr(entry, key)
    if entry.material is not None:
        place["material"] = MATERIAL.name_in_data("material", entry.material, folder)
    return place
