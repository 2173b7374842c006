"""Which materials make traced reflections as strong as measured ones: chosen on half of the places, tried on the rest.

Strengths are counted from those of the direct paths, whose gain is known; of the others, paths without an edge count.
Materials are tried one wall colour after the other, first the walls that have none.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from robosim.building.building import BuildingConfig, make_building
from robosim.plans.floorplan import FloorPlan
from robosim.published.measured_match import MatchConfig, Matched, match, trace_hall
from robosim.published.measured_paths import MeasuredHall
from wireless.em.materials import MATERIALS, WALLS, wall_row
from wireless.tracing.tracer import Tracer, TracerConfig

#: Paths of at most so many reflections are compared.
SPECULAR = TracerConfig(max_reflections=2, diffraction=False, max_paths=200)
#: The same with edges.
EDGES = replace(SPECULAR, diffraction=True)
#: What is traced, one kind of path added after the other.
ADDED = {
    "direct paths": replace(SPECULAR, max_reflections=0),
    "and one reflection": replace(SPECULAR, max_reflections=1),
    "and two": SPECULAR,
    "and three": replace(SPECULAR, max_reflections=3),
    "two, and a wall passed": replace(SPECULAR, max_transmissions=1),
    "two, and floor and ceiling": replace(SPECULAR, floor_ceiling=True),
    "two, and an edge with one": EDGES,
}
#: Walls of this let nothing come back: where a plan ends, not a building.
NOTHING = "vacuum"
#: A residual counts for no more than this [dB], as a wrong pair has nothing to do with materials.
MOST_DB = 15.0


@dataclass(frozen=True, kw_only=True)
class MaterialFit:
    """Materials that fit best, and how well."""

    wall: str
    """Of walls without a colour."""
    colours: tuple[str, ...]
    """Of each material of the plan, in its order."""
    before_db: tuple[float, float]
    """Residual at places that materials were chosen on and at the others, root mean square, with those given [dB]."""
    after_db: tuple[float, float]
    """The same with those chosen."""
    tried: dict[str, float]
    """Residual of each material for the walls without a colour, where materials were chosen [dB]."""


@dataclass(frozen=True, kw_only=True)
class Explained:
    """How much of what was measured traced paths explain."""

    paths: float
    """Share of the measured paths."""
    by_chance: float
    """The same with the paths of other places."""
    power: float
    """Share of the measured power."""
    off_db: float
    """Residual of reflections, root mean square [dB]; NaN if none is explained."""


def explained(hall: MeasuredHall, tracer: Tracer, config: MatchConfig) -> Explained:
    """How much a tracer explains; ValueError as in `residuals_db`."""
    matched = match(hall, trace_hall(hall, tracer, config.height_m), config)
    off = residuals_db(hall, matched)
    assert hall.power_db is not None  # or there are no residuals
    power = 10 ** (hall.power_db / 10)
    all_of_them = np.ones(len(off), bool)
    return Explained(
        paths=float(matched.explained.mean()),
        by_chance=matched.by_chance,
        power=float(power[matched.explained].sum() / power.sum()),
        off_db=_rms(off, all_of_them) if not np.isnan(off).all() else np.nan,
    )


def candidates(frequency_hz: float) -> list[str]:
    """Materials by name that were measured at a frequency."""
    found = []
    for name in (*WALLS, *MATERIALS):
        try:
            wall_row(name, frequency_hz)
        except ValueError:
            continue
        if name != NOTHING:
            found.append(name)
    return found


def residuals_db(hall: MeasuredHall, matched: Matched) -> Float[np.ndarray, " n"]:
    """Measured over traced strength of explained paths without an edge, from that of direct paths; NaN for others.

    Raises:
        ValueError: If powers were not measured, or no direct path is explained.
    """
    if hall.power_db is None:
        raise ValueError("the table has no column power_db, which the fit needs.")
    off = hall.power_db - matched.traced_db
    direct = matched.order == 0
    if not direct.any():
        raise ValueError("no direct path is explained: are plan and table in one frame, and the turn right?")
    off -= np.median(off[direct])
    off[matched.diffracted | (matched.order < 1)] = np.nan
    return off


def tracer_of(plan: FloorPlan, wall: str, frequency_hz: float, config: TracerConfig = SPECULAR) -> Tracer:
    """Tracer of a plan whose walls without a colour are of a material."""
    building = make_building(plan, config=BuildingConfig(wall_material=wall, furniture_material=wall))
    return Tracer(building, frequency_hz=frequency_hz, config=config)


def fit_materials(
    hall: MeasuredHall,
    plan: FloorPlan,
    *,
    wall: str,
    frequency_hz: float,
    names: Sequence[str],
    config: MatchConfig,
    on_tried: Callable[[str], None] = lambda name: None,
) -> MaterialFit:
    """Choose materials of a plan's walls by measured strengths, first for walls without a colour.

    ValueError if strengths cannot be compared, see `residuals_db`. `on_tried` is called with each material tried.
    """
    place = np.unique(hall.table[:, 0], return_inverse=True)[1]
    chosen_on = place % 2 == 0

    def residual(wall: str, colours: tuple[str, ...]) -> tuple[float, float]:
        tracer = tracer_of(replace(plan, materials=colours), wall, frequency_hz)
        off = residuals_db(hall, match(hall, trace_hall(hall, tracer, config.height_m), config))
        return _rms(off, chosen_on), _rms(off, ~chosen_on)

    colours = plan.materials
    before = residual(wall, colours)
    tried = {}
    for name in names:
        tried[name] = residual(name, colours)[0]
        on_tried(name)
    wall = min(tried, key=tried.__getitem__)
    for i, given in enumerate(plan.materials):
        if given == NOTHING:
            continue
        of_colour = {}
        for name in names:
            of_colour[name] = residual(wall, (*colours[:i], name, *colours[i + 1 :]))[0]
            on_tried(name)
        colours = (*colours[:i], min(of_colour, key=of_colour.__getitem__), *colours[i + 1 :])
    return MaterialFit(
        wall=wall, colours=colours, before_db=before, after_db=residual(wall, colours), tried=tried
    )


def _rms(off_db: Float[np.ndarray, " n"], some: Bool[np.ndarray, " n"]) -> float:
    """Root mean square of bounded residuals [dB]; infinite for none."""
    valid = off_db[some & ~np.isnan(off_db)]
    return float(np.sqrt(np.mean(np.minimum(np.abs(valid), MOST_DB) ** 2))) if len(valid) else np.inf
