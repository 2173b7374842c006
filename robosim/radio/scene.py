"""A floor plan made ready for radio: its building, the tracer of it, and what places in it are fit."""

import hashlib
from dataclasses import dataclass, field

import numpy as np
import shapely
from jaxtyping import Float

from robosim.building.building import BuildingConfig, make_building
from robosim.plans.floorplan import FloorPlan
from robosim.radio.receivers import check_height
from robosim.support.checks import FARTHEST, FREQUENCY_HZ, check_number, check_numbers
from wireless.tracing.scenes import PlanScene
from wireless.tracing.tracer import Tracer, TracerConfig

#: A place this far from free space still counts as on its edge [m].
ON_EDGE_M = 1e-6


@dataclass(frozen=True, kw_only=True)
class RadioConfig:
    """What is traced and how."""

    frequency_hz: float = 28e9
    """Carrier frequency."""
    height_m: float = 1.5
    """Height of receivers, and of transmitters that do not say theirs [m]."""
    tx_power_dbm: float = 23.0
    """Power sent, which received powers count from."""
    threshold_dbm: float | None = None
    """Paths received with less do not count for link states; None counts all."""
    tracer: TracerConfig = field(default_factory=TracerConfig)
    """Which paths are looked for."""
    building: BuildingConfig = field(default_factory=BuildingConfig)
    """How the plan becomes walls."""

    def __post_init__(self) -> None:
        check_numbers(
            self,
            frequency_hz=FREQUENCY_HZ,
            height_m=(0, 100, "m"),
            tx_power_dbm=(-200, 200, "dBm, such as 23"),
            threshold_dbm=(-400, 200, "dBm, such as -100"),
        )

    @property
    def threshold_db(self) -> float:
        """Least power gain of paths that count for link states."""
        return -np.inf if self.threshold_dbm is None else self.threshold_dbm - self.tx_power_dbm


class RadioScene:
    """The building of a plan, ready for tracing.

    Args:
        plan: The floor plan.
        config: How it is built and traced.

    Raises:
        MapError: If the plan has no free area.
        ValueError: If a material is unknown at this frequency.
    """

    def __init__(self, plan: FloorPlan, config: RadioConfig):
        self.config = config
        self.building = make_building(plan, config=config.building)
        self.face_material = self.building.face_material.astype(np.int64)
        self.tracer = Tracer(self.building, frequency_hz=config.frequency_hz, config=config.tracer)

    @property
    def in_plan(self) -> bool:
        """Whether it is traced as a floor plan, which is fast, rather than in space."""
        return isinstance(self.tracer.scene, PlanScene)

    @property
    def digest(self) -> str:
        """A text that changes with any vertex, face or material of the building."""
        seen = hashlib.sha256()
        for array in (self.building.mesh.vertices, self.building.mesh.faces, self.face_material):
            seen.update(np.ascontiguousarray(array, float).tobytes())
        seen.update(
            "|".join(one if isinstance(one, str) else repr(one) for one in self.building.materials).encode()
        )
        return seen.hexdigest()[:16]

    def places(self, points: tuple[tuple[float, ...], ...], name: str) -> Float[np.ndarray, "n 3"]:
        """Points (x, y) or (x, y, z) [m] as positions.

        Args:
            points: The points; without z they are at the configured height.
            name: What the message calls them.

        Raises:
            ValueError: If one is not in free space; the message says where the nearest free point is.
        """
        at = np.array([[*point, self.config.height_m][:3] for point in points], float).reshape(-1, 3)
        for x, y, z in at:
            for value in (x, y):
                check_number(name, float(value), -FARTHEST, FARTHEST, "m")
            check_height(self.building, float(z), f"height of {name} ({x:g}, {y:g})")
            point = shapely.Point(x, y)
            free = self.building.free_at(float(z))
            if free.distance(point) > ON_EDGE_M:
                # Rounded to centimetres it must not be in a wall again.
                inside = free.buffer(-0.01)
                room = free if inside.is_empty else inside
                near = shapely.shortest_line(room, point).coords[0]
                within = " at this height" if self.building.furnishings else ""
                raise ValueError(
                    f"{name} is ({x:g}, {y:g}) m, outside of the free space of {self.building.plan.name}{within}; the "
                    f"nearest free point is ({near[0]:.2f}, {near[1]:.2f}) m."
                )
        return at

    def cut_off(self, at: Float[np.ndarray, "3"]) -> str | None:
        """What to tell of a transmitter that is not in the largest part of free space, if it is not."""
        parts = shapely.get_parts(self.building.free)
        own = int(np.argmin(shapely.distance(parts, shapely.Point(*at[:2]))))
        areas = shapely.area(parts)
        if areas[own] == areas.max() or self.config.tracer.max_transmissions > 1:  # a wall has two sides
            return None
        return (
            f"tx ({at[0]:g}, {at[1]:g}) is in a part of {areas[own]:.1f} m2 with no way to the largest one, of "
            f"{areas.max():.1f} m2: only receivers in its own part have paths."
        )
