"""Floor plans of a building of several storeys.

All plans are in one frame, `map`, as ROS maps of one building are. Each but the highest has a slab over it, with
openings for stairs and shafts where polygons in that frame say so.
"""

import hashlib
import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from robosim.plans.floorplan import FARTHEST_M, FloorPlan, MapError
from robosim.support.reading import FileError, reading
from robosim.support.text_in import MOST_YAML

#: Heights of storeys, and thicknesses of slabs [m].
HEIGHTS_M, SLABS_M = (0.1, 100.0), (0.01, 10.0)
#: Storeys of a building.
MOST_STOREYS = 200
#: Middles of the plans of storeys are no farther from each other [m].
_APART_M = 1000.0

#: Name of such files in messages, and what to do about a damaged one.
STOREYS_FILE = "the YAML file of a building of several storeys"
STOREYS_REMEDY = (
    "List the storeys from the lowest up, such as 'storeys: [{plan: ground.yaml}, {plan: first.yaml}]'."
)

Ring = tuple[tuple[float, float], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class StoreyPlan:
    """Storey, and the slab over it."""

    plan: FloorPlan
    """Where its walls are."""
    height_m: float = 2.5
    """From its floor to its ceiling [m]."""
    slab_m: float = 0.3
    """Thickness of the slab over it [m]; not used for the highest storey."""
    slab_material: str | None = None
    """Radio material of all of that slab; None for what the building says of floors, ceilings and slabs."""
    openings: tuple[Ring, ...] = ()
    """Polygons (x, y) [m] in `map` in which the slab is open, where the floors below and above are free too."""

    def __post_init__(self) -> None:
        for name, value, bounds in (("height", self.height_m, HEIGHTS_M), ("slab", self.slab_m, SLABS_M)):
            low, high = bounds
            if not low <= value <= high:
                raise MapError(f"{name} is {value:g}, expected {low:g} to {high:g} m.")
        for ring in self.openings:
            if len(ring) < 3 or not all(
                len(point) == 2 and all(math.isfinite(v) and abs(v) <= FARTHEST_M for v in point)
                for point in ring
            ):
                raise MapError(
                    f"openings has {str(ring)[:60]}, expected three points or more, each of an x and a y in metres, "
                    "such as [[1, 1], [3, 1], [3, 2.5], [1, 2.5]]."
                )


@dataclass(frozen=True, kw_only=True, eq=False)
class StoreysPlan:
    """Storeys of a building, from the lowest up."""

    name: str
    """Its name in reports and files."""
    storeys: tuple[StoreyPlan, ...]
    """Each with the slab over it."""
    file: str = ""
    """File that it was read from, for messages."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.storeys) <= MOST_STOREYS:
            raise MapError(
                f"{self.label}: storeys has {len(self.storeys)} entries, expected 1 to {MOST_STOREYS}, "
                "the lowest first."
            )
        middles = [each.plan.to_map(np.array(each.plan.shape[::-1]) / 2) for each in self.storeys]
        away_m = np.hypot(*(np.array(middles) - middles[0]).T)
        if (k := int(away_m.argmax())) and away_m[k] > _APART_M:
            raise MapError(
                f"{self.label}: storey {k} is {away_m[k]:.6g} m from storey 0. Correct its offset."
            )

    @property
    def label(self) -> str:
        """Its name in messages: its file, if it has one."""
        return self.file or self.name

    def floor_m(self, storey: int) -> float:
        """Height of a storey's floor above that of the lowest [m]."""
        return float(sum(lower.height_m + lower.slab_m for lower in self.storeys[:storey]))

    def digest(self) -> str:
        """A text that changes with everything that a building depends on."""
        seen = hashlib.sha256()
        for storey in self.storeys:
            sizes = storey.height_m, storey.slab_m
            seen.update(repr((storey.plan.digest(), *sizes, storey.slab_material, storey.openings)).encode())
        return seen.hexdigest()[:16]

    def storey(self, number: int) -> "OneStorey":
        """A storey of the building, counted from the lowest, 0, as a place for receivers or a robot."""
        if not 0 <= number < len(self.storeys):
            raise MapError(
                f"{self.label}: storey is {number}, expected 0, the lowest, to {len(self.storeys) - 1}."
            )
        return OneStorey(building=self, number=number)


@dataclass(frozen=True, kw_only=True, eq=False)
class OneStorey:
    """Storey of a building with the others around it."""

    building: StoreysPlan
    """All storeys."""
    number: int
    """Which of them, the lowest is 0."""
    plan: FloorPlan = field(init=False)
    """Its own plan, named after building and number."""

    def __post_init__(self) -> None:
        plan = self.building.storeys[self.number].plan
        object.__setattr__(self, "plan", replace(plan, name=self.name))

    @property
    def name(self) -> str:
        """Building and number."""
        return f"{self.building.name}_storey_{self.number}"

    @property
    def floor_m(self) -> float:
        """Height of its floor [m]."""
        return self.building.floor_m(self.number)

    def digest(self) -> str:
        """A text that changes with the building and the number."""
        return hashlib.sha256(f"{self.building.digest()} {self.number}".encode()).hexdigest()[:16]


def storeys_of(plan: FloorPlan | StoreysPlan) -> list[FloorPlan | OneStorey]:
    """Each storey of a building of several, or the only floor plan."""
    match plan:
        case StoreysPlan():
            return [plan.storey(number) for number in range(len(plan.storeys))]
    return [plan]


def is_storeys(path: Path) -> bool:
    """Whether a file is of a building of several storeys, and not a map."""
    if path.suffix.lower() not in (".yaml", ".yml") or not path.is_file():
        return False
    try:
        with reading(path, STOREYS_FILE, STOREYS_REMEDY, most_bytes=MOST_YAML) as file:
            keys = [line.split(b":")[0].strip() for line in file.read().splitlines() if line[:1].strip()]
    except FileError:
        return False
    return b"storeys" in keys and b"image" not in keys
