"""A floor plan, or a storey of a building, with its tracer and checked places of terminals."""

from dataclasses import dataclass, field, replace
from typing import Annotated, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from robosim.building.building import Building, BuildingConfig, make_building
from robosim.building.multi_storey import Storeys, StoreysConfig, make_storeys
from robosim.plans.floorplan import FloorPlan
from robosim.plans.storey_plans import OneStorey
from robosim.radio.receivers import ReceiverGrid, check_height, receiver_grid
from robosim.support.checks import FARTHEST, FREQUENCY_HZ, Range, check_number, checked
from wireless.tracing.tracer import Tracer, TracerConfig

#: A place this far from free space still counts as on its edge [m].
ON_EDGE_M = 1e-6


@dataclass(frozen=True, kw_only=True)
@checked
class RadioConfig:
    """What is traced and how."""

    frequency_hz: Annotated[float, FREQUENCY_HZ] = 28e9
    """Carrier frequency."""
    height_m: Annotated[float, Range(0, 100, "m")] = 1.5
    """Height of receivers, and of transmitters without a height of their own [m]."""
    tx_power_dbm: Annotated[float, Range(-200, 200, "dBm", "Try 23.")] = 23.0
    """Transmit power, from which received powers count."""
    threshold_dbm: Annotated[float | None, Range(-400, 200, "dBm", "Try -100.")] = None
    """Paths received with less do not count for link states; None counts all."""
    tracer: TracerConfig = field(default_factory=TracerConfig)
    """Which paths are traced."""
    building: BuildingConfig = field(default_factory=BuildingConfig)
    """Walls of the plan."""

    @property
    def threshold_db(self) -> float:
        """Least power gain of paths that count for link states."""
        return -np.inf if self.threshold_dbm is None else self.threshold_dbm - self.tx_power_dbm


class Built(NamedTuple):
    """A building, or a storey of one."""

    building: Building
    """The storey on its own, its floor at z = 0."""
    whole: Building | Storeys
    """Everything that is traced: the same, or all storeys."""
    floor_m: float
    """Height of the storey's floor [m]."""


def built(plan: FloorPlan | OneStorey, config: BuildingConfig) -> Built:
    """Make the building of a plan, or all storeys around one.

    Raises:
        MapError: If a plan has no free area.
        ValueError: If a setting does not fit a building of several storeys.
    """
    if isinstance(plan, FloorPlan):
        building = make_building(plan, config=config)
        return Built(building, building, 0.0)
    whole = make_storeys(plan.building, config=StoreysConfig(building=config))
    own = whole.storeys[plan.number]
    return Built(replace(own.building, plan=plan.plan), whole, own.floor_m)


class RadioScene:
    """The building of a plan, or of a storey, in which receivers are, ready for tracing.

    Raises:
        MapError: If the plan has no free area.
        ValueError: If a material is unknown at this frequency.
    """

    def __init__(self, plan: FloorPlan | OneStorey, config: RadioConfig):
        self.config = config
        self.building, self.whole, self.floor_m = built(plan, config.building)
        self.face_material = self.whole.face_material.astype(np.int64)
        self.tracer = Tracer(self.whole, frequency_hz=config.frequency_hz, config=config.tracer)

    @property
    def engine(self) -> str:
        """Engine of the tracer: `plan` or `storeys`, which are fast, or `space`."""
        return self.tracer.scene.engine

    @property
    def digest(self) -> str:
        """A text that changes with any vertex, face or material of the building."""
        return self.whole.digest

    def grid(self, step_m: float) -> ReceiverGrid:
        """Receivers on a grid over the plan, or the storey, at the configured height above its floor."""
        grid = receiver_grid(self.building, step_m, self.config.height_m)
        return replace(grid, position=grid.position + np.array([0.0, 0.0, self.floor_m]))

    def places(self, points: tuple[tuple[float, ...], ...], name: str) -> Float[np.ndarray, "n 3"]:
        """Points (x, y) or (x, y, z) [m] as positions; heights count from the lowest floor.

        Without z a point is at the configured height above the floor of the scene's storey.

        Raises:
            ValueError: If one is not in free space; the message says where the nearest free point is.
        """
        height = self.floor_m + self.config.height_m
        at = np.array([[*point, height][:3] for point in points], float).reshape(-1, 3)
        for x, y, z in at:
            for value in (x, y):
                check_number(name, float(value), -FARTHEST, FARTHEST, "m")
            building, where, floor_m = self._building_at(float(z), f"height of {name} ({x:g}, {y:g})")
            point = shapely.Point(x, y)
            free = building.free_at(float(z) - floor_m)
            if free.distance(point) > ON_EDGE_M:
                # Rounded to centimetres it must not be in a wall again.
                inside = free.buffer(-0.01)
                room = free if inside.is_empty else inside
                near = shapely.shortest_line(room, point).coords[0]
                within = " at this height" if building.furnishings else ""
                raise ValueError(
                    f"{name} is ({x:g}, {y:g}) m, outside of the free space of {where}{within}; the "
                    f"nearest free point is ({near[0]:.2f}, {near[1]:.2f}) m."
                )
        return at

    def _building_at(self, z_m: float, name: str) -> tuple[Building, str, float]:
        """The storey of a height, its name, and the height of its floor [m]."""
        if not isinstance(self.whole, Storeys):
            check_height(self.building, z_m, name)
            return self.building, self.building.plan.name, 0.0
        number = self.whole.storey_at(z_m)
        if number is None:
            spans = ", ".join(f"{one.floor_m:g} to {one.ceiling_m:g}" for one in self.whole.storeys)
            raise ValueError(
                f"{name} is {z_m:g} m, expected one within a storey: {spans} m above the lowest floor."
            )
        own = self.whole.storeys[number]
        return own.building, self.whole.plan.one(number).name, own.floor_m

    def cut_off(self, at: Float[np.ndarray, "3"]) -> str | None:
        """A warning of a transmitter that is not in the largest part of free space."""
        if isinstance(self.whole, Storeys):  # stairs may lead on
            return None
        parts = shapely.get_parts(self.building.free)
        own = int(np.argmin(shapely.distance(parts, shapely.Point(*at[:2]))))
        areas = shapely.area(parts)
        if areas[own] == areas.max() or self.config.tracer.walls_passed(self.config.frequency_hz):
            return None
        return (
            f"tx ({at[0]:g}, {at[1]:g}) is in a part of {areas[own]:.1f} m2 without a passage to the largest one, of "
            f"{areas.max():.1f} m2: only receivers in its own part have paths."
        )
