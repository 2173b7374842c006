"""A building of several storeys: a YAML file that lists floor plans from the lowest up.

    name: house
    storeys:
      - plan: ground.yaml          # any floor plan, relative to this file, or a shipped one by name
        height: 2.6                # from floor to ceiling [m], 2.5 if not given
        slab: 0.3                  # thickness of the slab over it [m], 0.3 if not given
        material: concrete         # of that slab, if it differs from what the command says of floors and ceilings
        openings:                  # in that slab: polygons [m] in the plans' frame
          - [[2.0, 1.0], [3.0, 1.0], [3.0, 3.4], [2.0, 3.4]]
      - plan: first.yaml
        offset: [0.5, 0.0]         # moves a plan that has another origin [m]

Openings count where the floors below and above are both free. Only `storeys` and each `plan` are needed.
"""

from dataclasses import dataclass, replace
from pathlib import Path

from robosim.parts import MATERIAL
from robosim.plans.files import read_plan
from robosim.plans.floorplan import MAX_CELLS, FloorPlan, MapError
from robosim.plans.storey_plans import (
    MOST_STOREYS,
    STOREYS_FILE,
    STOREYS_REMEDY,
    Ring,
    StoreyPlan,
    StoreysPlan,
)
from robosim.support.from_dict import from_dict
from robosim.support.reading import reading, shown
from robosim.support.text_in import MOST_YAML, parse_yaml

#: Cells of all plans together.
_MOST_CELLS = 4 * MAX_CELLS


@dataclass(frozen=True, kw_only=True)
class _Storey:
    """Keys of a storey."""

    plan: str
    height: float = StoreyPlan.height_m
    slab: float = StoreyPlan.slab_m
    material: str | None = None
    openings: tuple[Ring, ...] | None = None
    offset: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class _Building:
    """Keys of the file."""

    storeys: tuple[_Storey, ...]
    name: str | None = None


def read_storeys(path: Path) -> StoreysPlan:
    """The storeys that a YAML file lists."""
    with reading(path, STOREYS_FILE, STOREYS_REMEDY, most_bytes=MOST_YAML, kind=MapError) as file:
        building = from_dict(_Building, parse_yaml(file.read()))
        if not 1 <= len(building.storeys) <= MOST_STOREYS:
            raise ValueError(f"storeys has {len(building.storeys)} entries, expected 1 to {MOST_STOREYS}")
    plans: dict[str, FloorPlan] = {}
    storeys = []
    for number, entry in enumerate(building.storeys):
        try:
            storeys.append(_storey(path.parent, entry, plans))
            if sum(plan.occupancy.size for plan in plans.values()) > _MOST_CELLS:
                raise ValueError(f"its plan and those below have more than {_MOST_CELLS:.2g} cells")
        except ValueError as error:
            raise MapError(f"{shown(path)}: storey {number}: {error}") from error
    plan = StoreysPlan(name=building.name or path.stem, storeys=tuple(storeys), file=shown(path))
    for number in range(len(storeys)):
        try:
            plan.storey(number)
        except MapError as error:
            raise MapError(f"{shown(path)}: {error}") from error
    return plan


def _storey(folder: Path, entry: _Storey, plans: dict[str, FloorPlan]) -> StoreyPlan:
    """Return the storey of an entry of the list; its plan is read once and added to `plans`."""
    file = folder / entry.plan
    if entry.plan not in plans:
        plans[entry.plan] = read_plan(file if file.exists() else entry.plan)
    plan = plans[entry.plan]
    x, y, yaw = plan.origin
    material = entry.material
    return StoreyPlan(
        plan=replace(plan, origin=(x + entry.offset[0], y + entry.offset[1], yaw)),
        height_m=entry.height,
        slab_m=entry.slab,
        slab_material=None if material is None else MATERIAL.name_in_data("material", material, folder),
        openings=entry.openings or (),
    )
