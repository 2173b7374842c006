"""One link in a building that may change under one's hands: paths at once, then what a receiver makes of them.

Paths take milliseconds. What is measured and estimated of them takes ten times as long, and seconds to make ready: it
is made by whoever asks for it first, in a thread of its own.
"""

from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Annotated

import numpy as np
import shapely
from jaxtyping import Float

from robosim.building.building import Building, BuildingConfig, make_building
from robosim.parts import MaterialPart
from robosim.plans.floorplan import FloorPlan
from robosim.radio.link import RadioLink, RadioLinkConfig
from robosim.radio.measurement import Interpreter, Measurement
from robosim.radio.receivers import ReceiverGrid, receiver_grid
from robosim.radio.scene import RadioConfig
from robosim.support.checks import FREQUENCY_HZ, Range, checked
from wireless.paths import LinkState, Paths
from wireless.tracing.tracer import Tracer, TracerConfig

#: A handle that is let go in a wall stays so far in front of it [m].
CLEARANCE_M = 0.05
#: Places that are tried for the robot at first are so far apart [m].
FIRST_STEP_M = 1.0
#: Walls that the page offers.
WALL_MATERIALS = ("partition", "concrete_wall", "glazing", "door", "metal")


@dataclass(frozen=True, kw_only=True)
@checked
class LinkSettings:
    """What the page's sliders set."""

    frequency_hz: Annotated[float, FREQUENCY_HZ] = 28e9
    """Carrier frequency."""
    height_m: Annotated[float, Range(0, 100, "m")] = 1.5
    """Height of both antennas above the floor [m]."""
    tx_power_dbm: Annotated[float, Range(-200, 200, "dBm", "Try 23.")] = 23.0
    """Power sent [dBm]."""
    wall_material: MaterialPart = "partition"
    """Radio material of walls."""
    tracer: TracerConfig = field(default_factory=TracerConfig)
    """Which paths are looked for."""

    @classmethod
    def of(cls, config: RadioConfig) -> "LinkSettings":
        """The same as `robosim trace` takes it."""
        return cls(
            frequency_hz=config.frequency_hz,
            height_m=config.height_m,
            tx_power_dbm=config.tx_power_dbm,
            wall_material=config.building.wall_material,
            tracer=config.tracer,
        )


@dataclass(frozen=True, eq=False)
class Heard:
    """What the robot's receiver makes of a link."""

    measurement: Measurement
    """Estimated paths, and the probability of each link state."""
    paths: Paths
    """The true ones at that place."""


class LinkModel:
    """A building ready for tracing, and a receiver in it."""

    def __init__(self, plan: FloorPlan, building: BuildingConfig, settings: LinkSettings) -> None:
        """Build and prepare.

        Raises:
            MapError: If the plan has no free area.
            ValueError: If antennas do not fit under the ceiling, or a material is unknown at this frequency.
        """
        self.plan, self._config, self.settings = plan, building, settings
        walls = replace(
            building, wall_material=settings.wall_material, furniture_material=settings.wall_material
        )
        self.building: Building = make_building(plan, config=walls)
        self._prepare()

    def _prepare(self) -> None:
        if not 0 < self.settings.height_m < self.building.height_m:
            raise ValueError(
                f"height is {self.settings.height_m:g} m, expected antennas between floor and ceiling, 0 to "
                f"{self.building.height_m:g} m."
            )
        self.tracer = Tracer(
            self.building, frequency_hz=self.settings.frequency_hz, config=self.settings.tracer
        )
        free = self.building.free_at(self.settings.height_m)
        inside = free.buffer(-CLEARANCE_M)
        self.free = free if inside.is_empty else inside
        shapely.prepare(self.free)
        self._lock = Lock()
        self._receiver: tuple[RadioLink, Interpreter] | None = None
        self._grids: dict[float, ReceiverGrid] = {}

    def changed(self, settings: LinkSettings) -> "LinkModel":
        """The same plan with other settings; its building is kept where it may be."""
        if settings.wall_material != self.settings.wall_material:
            return LinkModel(self.plan, self._config, settings)
        other = LinkModel.__new__(LinkModel)
        other.plan, other._config, other.building = self.plan, self._config, self.building
        other.settings = settings
        other._prepare()
        return other

    def nearest_free(self, at: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """The point of free space that is nearest to a place [m]: the place itself, unless it is in a wall."""
        if not np.isfinite(at).all():
            at = np.array(self.free.representative_point().coords[0])
        point = shapely.Point(*at)
        if self.free.covers(point):
            return np.array(at, float)
        return np.array(shapely.shortest_line(self.free, point).coords[0])

    def first_places(self) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
        """Where transmitter and robot stand at first: in the largest part of free space, out of each other's sight."""
        parts = shapely.get_parts(self.free)
        largest = parts[int(np.argmax(shapely.area(parts)))]
        tx = self.nearest_free(np.array(largest.representative_point().coords[0]))
        try:
            places = self.grid(FIRST_STEP_M).position
        except ValueError:  # a room smaller than that
            return tx, self.nearest_free(tx + FIRST_STEP_M)
        paths = self.tracer.trace(np.array([[*tx, self.settings.height_m]]), places, workers=1)
        return tx, self.nearest_free(places[_telling(paths)][:2])

    def paths(self, tx: Float[np.ndarray, "2"], rx: Float[np.ndarray, "2"]) -> Paths:
        """True paths between two places [m]."""
        height = self.settings.height_m
        return self.tracer.trace(np.array([[*tx, height]]), np.array([[*rx, height]]), workers=1)

    def listen(self, tx: Float[np.ndarray, "2"], pose: Float[np.ndarray, "3"], seed: int) -> Heard:
        """What the robot's receiver measures, estimates and takes the link state to be; seconds at the first call.

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
            return Heard(interpreter.interpret(estimates, pose), link.paths)

    def _make_receiver(self) -> tuple[RadioLink, Interpreter]:
        s = self.settings
        config = RadioLinkConfig(frequency_hz=s.frequency_hz, height_m=s.height_m, tracer=s.tracer)
        link = RadioLink(self.building, config)
        self._receiver = link, Interpreter(link, "generated")
        return self._receiver

    def grid(self, step_m: float) -> ReceiverGrid:
        """Places all over the free space, so far from each other [m].

        Raises:
            ValueError: If none fits.
        """
        if step_m not in self._grids:
            self._grids[step_m] = receiver_grid(self.building, step_m, self.settings.height_m)
        return self._grids[step_m]


def _telling(paths: Paths) -> int:
    """The receiver with most paths of those out of sight; of any, if all are in sight."""
    count, state = paths.count()[0], paths.link_state()[0]
    hidden = np.where(state == LinkState.FIRST_ORDER, count, 0)
    return int(np.argmax(hidden if hidden.any() else count))
