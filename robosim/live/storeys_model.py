"""One link in a building of several storeys: paths at once, through slabs' openings and walls alike."""

from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Float

from robosim.building.building import BuildingConfig
from robosim.building.multi_storey import StoreysConfig, make_storeys
from robosim.live.link_model import CLEARANCE_M, LinkSettings
from robosim.plans.storey_plans import StoreysPlan
from wireless.paths import Paths
from wireless.tracing.tracer import Tracer


class StoreysModel:
    """A building of several storeys ready for tracing."""

    def __init__(self, plan: StoreysPlan, building: BuildingConfig, settings: LinkSettings) -> None:
        """Build and prepare.

        Raises:
            MapError: If a plan has no free area.
            ValueError: If antennas do not fit under a ceiling, or a material is unknown at this frequency.
        """
        walls = replace(
            building, wall_material=settings.wall_material, furniture_material=settings.wall_material
        )
        self.plan, self.settings = plan, settings
        self.whole = make_storeys(plan, config=StoreysConfig(building=walls))
        lowest = min(one.building.height_m for one in self.whole.storeys)
        if not 0 < settings.height_m < lowest:
            raise ValueError(
                f"height is {settings.height_m:g} m, expected antennas between floor and ceiling of each storey, 0 to "
                f"{lowest:g} m."
            )
        self.tracer = Tracer(self.whole, frequency_hz=settings.frequency_hz, config=settings.tracer)
        self._free = []
        for one in self.whole.storeys:
            free = one.building.free_at(settings.height_m)
            inside = free.buffer(-CLEARANCE_M)
            self._free.append(free if inside.is_empty else inside)
            shapely.prepare(self._free[-1])

    def __len__(self) -> int:
        return len(self.whole.storeys)

    def level_m(self, storey: int) -> float:
        """Height of antennas on a storey above the lowest floor [m]."""
        return self.whole.storeys[storey].floor_m + self.settings.height_m

    def nearest_free(self, at: Float[np.ndarray, "2"], storey: int) -> Float[np.ndarray, "2"]:
        """The point of a storey's free space that is nearest to a place [m]: the place itself, unless in a wall."""
        free = self._free[storey]
        point = shapely.Point(*at)
        if free.covers(point):
            return np.array(at, float)
        return np.array(shapely.shortest_line(free, point).coords[0])

    def first_place(self, storey: int) -> Float[np.ndarray, "2"]:
        """A place on a storey, beside the opening of the slab over it, if it has one, else in its largest part [m]."""
        opening = self.whole.storeys[storey].opening
        parts = shapely.get_parts(self._free[storey])
        inside = opening if not opening.is_empty else parts[int(np.argmax(shapely.area(parts)))]
        return self.nearest_free(np.array(inside.representative_point().coords[0]), storey)

    def paths(self, tx: Float[np.ndarray, "3"], rx: Float[np.ndarray, "3"]) -> Paths:
        """True paths between two places, heights above the lowest floor [m]."""
        return self.tracer.trace(tx[None], rx[None], workers=1)
