"""Which materials make traced reflections as strong as measured ones: chosen on half of the places, tried on the rest.

Strengths are counted from those of the direct paths, whose gain is known; of the others, paths without an edge count.
Materials are tried one wall colour after the other, first the walls that have none.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from robosim.building.building import BuildingConfig, make_building
from robosim.calibration.measured_paths import (
    MatchConfig,
    Matched,
    MeasuredHall,
    match,
    offset_db,
    trace_hall,
)
from robosim.plans.floorplan import FloorPlan
from wireless.em.materials import MATERIALS, WALLS, Material, wall_row
from wireless.tracing.tracer import Tracer, TracerConfig

#: Paths of at most so many reflections are compared.
SPECULAR = TracerConfig(max_reflections=2, diffraction=False, max_paths=200)
#: The same with edges.
EDGES = replace(SPECULAR, diffraction=True)
#: The same with posts and curved walls instead.
CURVED = replace(SPECULAR, curved_walls=True)
#: What is traced, one kind of path added after the other.
ADDED = {
    "direct paths": replace(SPECULAR, max_reflections=0),
    "and one reflection": replace(SPECULAR, max_reflections=1),
    "and two": SPECULAR,
    "and three": replace(SPECULAR, max_reflections=3),
    "two, and a wall passed": replace(SPECULAR, max_transmissions=1),
    "two, and floor and ceiling": replace(SPECULAR, floor_ceiling=True),
    "two, and an edge with one": EDGES,
    "two, and curved walls": CURVED,
}
#: Walls of this let nothing come back: where a plan ends, not a building.
NOTHING = "vacuum"
#: A residual counts for no more than this [dB], as a wrong pair has nothing to do with materials.
MOST_DB = 15.0


@dataclass(frozen=True, kw_only=True)
class MaterialFit:
    """Materials that fit best, and how well."""

    wall: str
    """Material of walls without a colour."""
    colours: tuple[str, ...]
    """Chosen material for each material of the plan, in its order."""
    before_db: tuple[float, float]
    """Residual at places that materials were chosen on and at the others, root mean square, with those given [dB]."""
    after_db: tuple[float, float]
    """Errors with the chosen materials."""
    tried: dict[str, float]
    """Residual of each material for the walls without a colour, where materials were chosen [dB]."""


@dataclass(frozen=True, kw_only=True)
class Explained:
    """Fractions of the measurement that traced paths explain."""

    paths: float
    """Share of the measured paths."""
    by_chance: float
    """Fraction explained by the paths of other places."""
    power: float
    """Share of the measured power."""
    off_db: float
    """Residual of reflections, root mean square [dB]; NaN if none is explained."""


class Fit:
    """Compares measured paths, which need powers, with those traced in a plan at a frequency."""

    def __init__(
        self, hall: MeasuredHall, frequency_hz: float, config: MatchConfig, names: tuple[str, ...] = ()
    ) -> None:
        """Materials of some names are tried; by default all that were measured at the frequency."""
        self._hall, self._frequency_hz, self._config = hall, frequency_hz, config
        self.names = names or candidates(frequency_hz)

    def n_trials(self, plan: FloorPlan) -> int:
        """Number of materials that `choose` tries."""
        return len(self.names) * (1 + sum(stated != NOTHING for stated in plan.materials))

    def match(self, plan: FloorPlan, wall: str, kinds: TracerConfig = SPECULAR) -> Matched:
        """Pair measured paths with those in a plan whose walls without a colour are of a material."""
        tracer = tracer_of(plan, wall, self._frequency_hz, kinds)
        return match(self._hall, trace_hall(self._hall, tracer, self._config.height_m), self._config)

    def explained(self, plan: FloorPlan, wall: str, kinds: TracerConfig) -> Explained:
        """Compute the explained fractions; ValueError as in `residuals_db`."""
        matched = self.match(plan, wall, kinds)
        off = residuals_db(self._hall, matched)
        assert self._hall.power_db is not None  # or there are no residuals
        power = 10 ** (self._hall.power_db / 10)
        return Explained(
            paths=float(matched.explained.mean()),
            by_chance=matched.by_chance,
            power=float(power[matched.explained].sum() / power.sum()),
            off_db=rms_db(off) if not np.isnan(off).all() else np.nan,
        )

    def choose(
        self, plan: FloorPlan, wall: str, on_tried: Callable[[str], None] = lambda name: None
    ) -> MaterialFit:
        """Choose materials of a plan's walls, first of those without a colour, which begin with `wall`.

        ValueError as in `residuals_db`.
        """

        def residual(wall: str, colours: tuple[str, ...]) -> tuple[float, float]:
            off = residuals_db(self._hall, self.match(replace(plan, materials=colours), wall))
            return rms_db(off[chosen_on]), rms_db(off[~chosen_on])

        def try_all(materials: Callable[[str], tuple[str, tuple[str, ...]]]) -> dict[str, float]:
            tried = {}
            for name in self.names:
                tried[name] = residual(*materials(name))[0]
                on_tried(name)
            return tried

        chosen_on = np.unique(self._hall.table[:, 0], return_inverse=True)[1] % 2 == 0
        colours = plan.materials
        before = residual(wall, colours)
        of_walls = try_all(lambda name: (name, colours))
        wall = best = min(of_walls, key=of_walls.__getitem__)
        for i, stated in enumerate(plan.materials):
            if stated != NOTHING:
                others = colours[:i], colours[i + 1 :]
                tried = try_all(lambda name, others=others: (best, (*others[0], name, *others[1])))  # type: ignore[misc]
                colours = (*others[0], min(tried, key=tried.__getitem__), *others[1])
        after = residual(wall, colours)
        return MaterialFit(wall=wall, colours=colours, before_db=before, after_db=after, tried=of_walls)


def candidates(frequency_hz: float) -> tuple[str, ...]:
    """Materials by name that were measured at a frequency."""
    trials = []
    for name in (*WALLS, *MATERIALS):
        try:
            wall_row(name, frequency_hz)
        except ValueError:
            continue
        if name != NOTHING:
            trials.append(name)
    return tuple(trials)


def residuals_db(hall: MeasuredHall, matched: Matched) -> Float[np.ndarray, " n"]:
    """Measured over traced strength of explained paths without an edge, from that of direct paths; NaN for others.

    ValueError as in `offset_db`.
    """
    from_db = offset_db(hall, matched)
    assert hall.power_db is not None  # or there is no offset
    off = hall.power_db - matched.traced_db - from_db
    off[matched.diffracted | (matched.order < 1)] = np.nan
    return off


def tracer_of(
    plan: FloorPlan, wall: str | Material, frequency_hz: float, config: TracerConfig = SPECULAR
) -> Tracer:
    """Tracer of a plan whose walls without a colour are of a material."""
    building = make_building(plan, config=BuildingConfig(wall_material=wall, furniture_material=wall))
    return Tracer(building, frequency_hz=frequency_hz, config=config)


def rms_db(off_db: Float[np.ndarray, " n"]) -> float:
    """Root mean square of bounded residuals [dB]; infinite for none."""
    valid = off_db[~np.isnan(off_db)]
    return float(np.sqrt(np.mean(np.minimum(np.abs(valid), MOST_DB) ** 2))) if len(valid) else np.inf
