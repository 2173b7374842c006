"""Whether rough walls scatter the measured paths that no reflection explains.

The paths that direct paths and reflections leave over are compared with the power that all walls scatter within the
same delay and directions. How rough walls would have to be is fitted on every other place, and tried on the rest,
next to a guess that knows nothing: all these paths equally strong. A coefficient above 1 is more than walls reflect
at all: then it is not the walls of the plan that scatter.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.constants import speed_of_light

from robosim.plans.floorplan import FloorPlan
from robosim.published.material_fit import SPECULAR, tracer_of
from robosim.published.measured_match import MatchConfig, Matched, match, trace_hall
from robosim.published.measured_paths import MeasuredHall
from slam.poses import wrap
from wireless.paths import Interaction, Paths

#: Walls as rough as can be, in small pieces, and nothing but what they scatter.
ROUGH = replace(
    SPECULAR, max_reflections=0, max_paths=5000, scattering=1.0, scattering_lobe=4, scattering_tile_m=0.25
)
#: Strengths that are off by less are right [dB].
NEAR_DB = 5.0


@dataclass(frozen=True, kw_only=True)
class ScatteringFit:
    """What scattering explains of the paths that direct paths and reflections leave over."""

    paths: int
    """Paths that are left over."""
    power: float
    """Their share of the measured power."""
    explained: float
    """Share of them that walls scatter from, by delay and both directions."""
    by_chance: float
    """The same with what is scattered to other places."""
    coefficient: float
    """S that makes them as strong as measured, in the median of every other place."""
    off_db: dict[str, float]
    """Measured over traced strength, median, with S of this: 0.2, 0.4 and 1."""
    near: float
    """Share of the explained paths at the other places that S brings within 5 dB."""
    near_constant: float
    """The same of one strength for all."""
    correlation: float
    """Of measured and scattered strengths in decibels."""


def fit_scattering(
    hall: MeasuredHall, plan: FloorPlan, wall: str, frequency_hz: float, config: MatchConfig
) -> ScatteringFit:
    """Compare the paths that reflections leave over with the power that walls scatter.

    Raises:
        ValueError: If powers were not measured, or no direct path is explained, or nothing left over is scattered.
    """
    if hall.power_db is None:
        raise ValueError("the table has no column power_db, which the fit needs.")
    smooth = match(hall, trace_hall(hall, tracer_of(plan, wall, frequency_hz), config.height_m), config)
    measured_db = hall.power_db - _direct_db(hall, smooth)
    traced = trace_hall(hall, tracer_of(plan, wall, frequency_hz, ROUGH), config.height_m)
    traced = traced.select(traced.interaction[:, 0] == Interaction.SCATTERING)
    place = np.unique(hall.table[:, 0], return_inverse=True)[1]
    power, chance = _in_cells(hall, place, traced, config)
    left = ~smooth.explained
    found = left & (power > 0)
    with np.errstate(divide="ignore"):
        off = measured_db - 10 * np.log10(power)
    even = found & (place % 2 == 0)
    odd = found & ~even
    if not even.any() or not odd.any():
        raise ValueError("nothing that reflections leave over is scattered by the plan's walls.")
    more_db = float(np.median(off[even]))
    constant = measured_db[odd] - np.median(measured_db[even])
    watts = 10 ** (measured_db / 10)
    return ScatteringFit(
        paths=int(left.sum()),
        power=float(watts[left].sum() / watts.sum()),
        explained=float(found.sum() / left.sum()),
        by_chance=float(chance[left].mean()),
        coefficient=float(10 ** (more_db / 20)),
        off_db={str(s): float(np.median(off[found]) - 20 * np.log10(s)) for s in (0.2, 0.4, 1)},
        near=float(np.mean(np.abs(off[odd] - more_db) < NEAR_DB)),
        near_constant=float(np.mean(np.abs(constant) < NEAR_DB)),
        correlation=float(np.corrcoef(measured_db[found], 10 * np.log10(power[found]))[0, 1]),
    )


def _direct_db(hall: MeasuredHall, matched: Matched) -> float:
    """What measured powers are above gains, by the direct paths [dB]."""
    direct = matched.order == 0
    if not direct.any():
        raise ValueError("no direct path is explained: are plan and table in one frame, and the turn right?")
    assert hall.power_db is not None
    return float(np.median((hall.power_db - matched.traced_db)[direct]))


def _in_cells(
    hall: MeasuredHall, place: np.ndarray, traced: Paths, config: MatchConfig
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Scattered power that looks like each measured path, and at which share of the other places something would."""
    table, length = hall.table, traced.delay_s * speed_of_light
    power, chance = np.zeros(len(table)), np.zeros(len(table))
    others = max(1, len(np.unique(place)) - 1)
    for i, row in enumerate(table):
        alike = np.abs(length - row[7]) <= config.delay_ns * 1e-9 * speed_of_light
        for azimuth, measured in ((traced.aod_az, row[3] + row[8]), (traced.aoa_az, row[6] + row[9])):
            alike &= np.abs(wrap(azimuth - measured)) <= np.radians(config.angle_deg)
        here = traced.rx == place[i]
        power[i] = traced.power[alike & here].sum()
        chance[i] = len(np.unique(traced.rx[alike & ~here])) / others
    return power, chance
