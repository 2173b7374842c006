"""A building of several storeys: a YAML file that lists floor plans from the lowest up.

    name: house
    storeys:
      - plan: ground.yaml          # any floor plan, beside this file, or a shipped one by name
        height: 2.6                # from floor to ceiling [m], 2.5 if not given
        slab: 0.3                  # thickness of the slab over it [m], 0.3 if not given
        material: concrete         # of that slab, if it differs from what the command says of floors and ceilings
        openings:                  # in that slab: polygons [m] in the plans' frame
          - [[2.0, 1.0], [3.0, 1.0], [3.0, 3.4], [2.0, 3.4]]
      - plan: first.yaml
        offset: [0.5, 0.0]         # moves a plan that has another origin [m]

Openings count where the floors below and above are both free. Only `storeys` and each `plan` are needed.
"""

from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from robosim.parts import MATERIAL
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FARTHEST_M, FloorPlan, MapError
from robosim.plans.storeys import STOREYS_FILE, STOREYS_REMEDY, StoreyPlan, StoreysPlan
from robosim.support.reading import reading, shown
from robosim.support.text_in import MOST_YAML, check_object, parse_yaml
from wireless.em.materials import check_material

_KEYS = ("plan", "height", "slab", "material", "openings", "offset")


def read_storeys(path: Path) -> StoreysPlan:
    """The storeys that a YAML file lists.

    Raises:
        MapError: If it or one of its plans is missing or damaged, or a value makes no sense. The message names the
            file, the storey, the value and the fix.
    """
    with reading(path, STOREYS_FILE, STOREYS_REMEDY, most_bytes=MOST_YAML, kind=MapError) as file:
        content = check_object(parse_yaml(file.read()), ("storeys",))
    _only(shown(path), content, ("name", "storeys"))
    listed, name = content["storeys"], content.get("name", path.stem)
    if not isinstance(listed, list) or not listed:
        raise MapError(f"{shown(path)}: storeys is {_cut(listed)}, expected a list. {STOREYS_REMEDY}")
    if not isinstance(name, str):
        raise MapError(f"{shown(path)}: name is {_cut(name)}, expected a text, such as house.")
    storeys = tuple(_storey(path, number, one) for number, one in enumerate(listed))
    plan = StoreysPlan(name=name, storeys=storeys, file=shown(path))
    for number in range(len(storeys)):
        try:
            plan.one(number)
        except MapError as error:
            raise MapError(f"{shown(path)}: {error}") from error
    return plan


def _storey(path: Path, number: int, given: Any) -> StoreyPlan:
    """One entry of the list."""
    told = f"{shown(path)}: storey {number}"
    if not isinstance(given, dict) or not isinstance(given.get("plan"), str):
        raise MapError(
            f"{told} is {_cut(given)}, expected keys and values, and a plan, such as 'plan: ground.yaml'."
        )
    _only(told, given, _KEYS)
    numbers = {}
    for key, field in (("height", "height_m"), ("slab", "slab_m")):
        value = given.get(key)
        if value is not None and (not isinstance(value, int | float) or isinstance(value, bool)):
            raise MapError(f"{told}: {key} is {_cut(value)}, expected a number of metres, such as 2.5.")
        if value is not None:
            numbers[field] = float(value)
    material = given.get("material")
    if material is not None and not isinstance(material, str):
        raise MapError(f"{told}: material is {_cut(material)}, expected a name, such as concrete.")
    try:
        if material is not None:
            _check_material(material)
        return StoreyPlan(
            plan=_plan(path, given, told),
            slab_material=material,
            openings=_openings(given.get("openings"), told),
            **numbers,
        )
    except MapError as error:
        raise error if str(error).startswith(told) else MapError(f"{told}: {error}") from error
    except ValueError as error:
        raise MapError(f"{told}: {error}") from error


def _check_material(name: str) -> None:
    """See that a material is one by name."""
    MATERIAL.check("material", name)
    if MATERIAL.is_name(name):
        check_material(name, "material")


def _plan(path: Path, given: dict[Any, Any], told: str) -> FloorPlan:
    """The plan of an entry, moved by its offset."""
    beside = path.parent / given["plan"]
    plan = read_plan(beside if beside.exists() else given["plan"])
    offset = given.get("offset", (0.0, 0.0))
    if not _is_point(offset):
        raise MapError(
            f"{told}: offset is {_cut(offset)}, expected an x and a y in metres, such as [0.5, 0]."
        )
    x, y, yaw = plan.origin
    return replace(plan, origin=(x + offset[0], y + offset[1], yaw))


def _openings(given: Any, told: str) -> tuple[tuple[tuple[float, float], ...], ...]:
    """The polygons of an entry."""
    if given is None:
        return ()
    good = isinstance(given, list) and all(
        isinstance(ring, list) and len(ring) >= 3 and all(map(_is_point, ring)) for ring in given
    )
    if not good:
        raise MapError(
            f"{told}: openings is {_cut(given)}, expected a list of polygons, each of three points or more [m]: "
            "[[[1, 1], [3, 1], [3, 2.5], [1, 2.5]]]."
        )
    return tuple(tuple((float(x), float(y)) for x, y in ring) for ring in given)


def _is_point(value: Any) -> bool:
    """Whether a value is an x and a y that may be metres."""
    return (
        isinstance(value, list | tuple)
        and len(value) == 2
        and all(
            isinstance(v, int | float) and not isinstance(v, bool) and abs(v) <= FARTHEST_M for v in value
        )
    )


def _only(told: str, given: dict[Any, Any], known: tuple[str, ...]) -> None:
    """Refuse keys that are none."""
    for key in given:
        if key not in known:
            near = get_close_matches(str(key), known, 1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise MapError(f"{told}: the key {_cut(key)} is unknown, expected {', '.join(known)}.{hint}")


def _cut(value: Any) -> str:
    """A value as messages show it."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."
