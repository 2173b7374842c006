"""A radio link in a building that a person explores: paths at once, and what a receiver measures of them.

Paths take milliseconds. Measuring and estimating takes ten times as long, and seconds to prepare: the receiver is made
when it is first needed, in the thread that needs it. A building of one storey has a receiver and a grid of places.
"""

from copy import copy
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Annotated

import numpy as np
import shapely
from jaxtyping import Float

from robosim.building.building import Building, BuildingConfig, make_building
from robosim.building.multi_storey import Storey, Storeys, StoreysConfig, make_storeys
from robosim.parts import MaterialPart
from robosim.plans.floorplan import FloorPlan
from robosim.plans.storey_plans import StoreysPlan
from robosim.radio.link import RadioLink, RadioLinkConfig
from robosim.radio.measurement import Interpreter, Measurement
from robosim.radio.receivers import ReceiverGrid, receiver_grid
from robosim.radio.scene import RadioConfig
from robosim.support.checks import FREQUENCY_HZ, Range, checked
from wireless.paths import LinkState, Paths
from wireless.tracing.tracer import Tracer, TracerConfig

#: Distance from the wall at which a handle stands that was dropped in it [m].
CLEARANCE_M = 0.05
#: Distance between the places that are tried for the robot at first [m].
FIRST_STEP_M = 1.0
#: Walls that the page offers.
WALL_MATERIALS = ("partition", "concrete_wall", "glazing", "door", "metal")


@dataclass(frozen=True, kw_only=True)
@checked
class LinkSettings:
    """Settings of the page's sliders."""

    frequency_hz: Annotated[float, FREQUENCY_HZ] = 28e9
    """Carrier frequency."""
    height_m: Annotated[float, Range(0, 100, "m")] = 1.5
    """Height of both antennas above the floor [m]."""
    tx_power_dbm: Annotated[float, Range(-200, 200, "dBm", "Try 23.")] = 23.0
    """Power sent [dBm]."""
    wall_material: MaterialPart = "partition"
    """Radio material of walls."""
    tracer: TracerConfig = field(default_factory=TracerConfig)
    """Which paths are traced."""

    @classmethod
    def of(cls, config: RadioConfig) -> "LinkSettings":
        """The settings of `robosim trace`."""
        return cls(
            frequency_hz=config.frequency_hz,
            height_m=config.height_m,
            tx_power_dbm=config.tx_power_dbm,
            wall_material=config.building.wall_material,
            tracer=config.tracer,
        )


@dataclass(frozen=True, eq=False)
class Reception:
    """What the robot's receiver makes of a link."""

    measurement: Measurement
    """Estimated paths, and the probability of each link state."""
    paths: Paths
    """The true ones at that place."""


class LinkModel:
    """A building with one or several storeys, ready for tracing."""

    def __init__(
        self, plan: FloorPlan | StoreysPlan, building: BuildingConfig, settings: LinkSettings
    ) -> None:
        """Build and prepare.

        Raises:
            MapError: If a plan has no free area.
            ValueError: If antennas do not fit under a ceiling, or a material is unknown at this frequency.
        """
        self.plan, self._config = plan, building
        walls = replace(
            building, wall_material=settings.wall_material, furniture_material=settings.wall_material
        )
        if isinstance(plan, StoreysPlan):
            whole = make_storeys(plan, config=StoreysConfig(building=walls))
            self._faces: Building | Storeys = whole
            self.storeys = whole.storeys
        else:
            self._faces = only = make_building(plan, config=walls)
            self.storeys = (Storey(building=only, floor_m=0.0, opening=shapely.MultiPolygon()),)
        #: The lowest storey.
        self.building: Building = self.storeys[0].building
        self._prepare(settings)

    def _prepare(self, settings: LinkSettings) -> None:
        self.settings = settings
        lowest = min(one.building.height_m for one in self.storeys)
        if not 0 < settings.height_m < lowest:
            where = " of each storey" if len(self) > 1 else ""
            raise ValueError(
                f"height is {settings.height_m:g} m, expected antennas between floor and ceiling{where}, 0 to "
                f"{lowest:g} m."
            )
        self.tracer = Tracer(self._faces, frequency_hz=settings.frequency_hz, config=settings.tracer)
        self._free = []
        for storey in self.storeys:
            free = storey.building.free_at(settings.height_m)
            inside = free.buffer(-CLEARANCE_M)
            self._free.append(free if inside.is_empty else inside)
            shapely.prepare(self._free[-1])
        self._lock = Lock()
        self._receiver: tuple[RadioLink, Interpreter] | None = None
        self._grids: dict[float, ReceiverGrid] = {}

    def __len__(self) -> int:
        """Number of storeys."""
        return len(self.storeys)

    def changed(self, settings: LinkSettings) -> "LinkModel":
        """The same plan with other settings; the building is made again only if its material changes."""
        if settings.wall_material != self.settings.wall_material:
            return LinkModel(self.plan, self._config, settings)
        other = copy(self)
        other._prepare(settings)
        return other

    def level_m(self, storey: int) -> float:
        """Height of antennas on a storey above the lowest floor [m]."""
        return self.storeys[storey].floor_m + self.settings.height_m

    def antenna(self, at: Float[np.ndarray, "2"], storey: int = 0) -> Float[np.ndarray, "3"]:
        """Position of an antenna on a storey, height above the lowest floor [m]."""
        return np.array([*at, self.level_m(storey)])

    def nearest_free(self, at: Float[np.ndarray, "2"], storey: int = 0) -> Float[np.ndarray, "2"]:
        """The point of a storey's free space that is nearest to a place [m]: the place itself, unless in a wall."""
        free = self._free[storey]
        if not np.isfinite(at).all():
            at = np.array(free.representative_point().coords[0])
        point = shapely.Point(*at)
        if free.covers(point):
            return np.array(at, float)
        return np.array(shapely.shortest_line(free, point).coords[0])

    def first_place(self, storey: int = 0) -> Float[np.ndarray, "2"]:
        """A place on a storey: below the opening of its slab, if it has one, else in its largest part [m]."""
        opening = self.storeys[storey].opening
        parts = shapely.get_parts(self._free[storey])
        inside = opening if not opening.is_empty else parts[int(np.argmax(shapely.area(parts)))]
        return self.nearest_free(np.array(inside.representative_point().coords[0]), storey)

    def place_out_of_sight(self, tx: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """A place with many paths from a transmitter on the same storey, out of its sight if there is one [m]."""
        try:
            places = self.grid(FIRST_STEP_M).position
        except ValueError:  # a room smaller than that
            return self.nearest_free(tx + FIRST_STEP_M)
        paths = self.tracer.trace(self.antenna(tx)[None], places, workers=1)
        count, hidden = paths.count()[0], paths.link_state()[0] == LinkState.FIRST_ORDER
        best = int(np.argmax(np.where(hidden, count, 0) if hidden.any() else count))
        return self.nearest_free(places[best][:2])

    def paths(
        self, tx: Float[np.ndarray, "2"], rx: Float[np.ndarray, "2"], storeys: tuple[int, int] = (0, 0)
    ) -> Paths:
        """True paths between two places [m] on their storeys."""
        ends = self.antenna(tx, storeys[0]), self.antenna(rx, storeys[1])
        return self.tracer.trace(ends[0][None], ends[1][None], workers=1)

    def receive(self, tx: Float[np.ndarray, "2"], pose: Float[np.ndarray, "3"], seed: int) -> Reception:
        """Measure the link, estimate paths and classify the link state; seconds at the first call.

        Args:
            tx: The transmitter's place [m].
            pose: The robot's: x [m], y [m], yaw [rad].
            seed: Of the noise.
        """
        with self._lock:
            link, interpreter = self._receiver or self._make_receiver()
            link.place(tx)
            estimates = link.measure(pose, np.random.default_rng(seed))
            assert link.paths is not None  # it has just measured
            return Reception(interpreter.interpret(estimates, pose), link.paths)

    def _make_receiver(self) -> tuple[RadioLink, Interpreter]:
        s = self.settings
        config = RadioLinkConfig(frequency_hz=s.frequency_hz, height_m=s.height_m, tracer=s.tracer)
        link = RadioLink(self.building, config)
        self._receiver = link, Interpreter(link, "generated")
        return self._receiver

    def grid(self, step_m: float) -> ReceiverGrid:
        """Places all over the free space at this distance [m].

        Raises:
            ValueError: If none fits.
        """
        if step_m not in self._grids:
            self._grids[step_m] = receiver_grid(self.building, step_m, self.settings.height_m)
        return self._grids[step_m]
