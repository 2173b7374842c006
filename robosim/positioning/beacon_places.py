"""Positions of beacons from powers received along a route: in a plan, in the robot's map, or without either.

Candidate places lie on a grid around the free floor of the plan or map, or around the route. A law of distance with
walls and correlated shadowing (`wireless.positioning.received_power`) gives the probability of each. Furniture and
reflections move the place by some amount that more readings do not reduce, which is added to the covariance: it is
estimated from one real flat (`tests.benchmarks.warsaw_places`), where powers traced in the plan do not locate better.
The priors of walls, exponent, shadowing and fading are those that make the readings of other runs in that flat most
probable, given the true places; power at 1 m, which depends on the beacon, has a wide one.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from robosim.plans.floorplan import OCCUPIED, FloorPlan
from robosim.policies.sightlines import count_walls
from robosim.support.checks import Range, checked
from robosim.support.reading import FileError
from wireless.positioning.received_power import PowerLawConfig, PowerReadings, log_evidence

#: Shares of the route after which places are reported.
SHARES = (0.25, 0.5, 1.0)
#: Successive readings within this distance and turn count as one [m, rad]; most of them, by time.
_STEP_M, _TURN_RAD, _MOST = 0.5, 0.6, 400
#: Least side of a cell of candidates [m], and most of them.
_CELL_M, _CANDIDATES = 0.25, 4000
#: Half of the positions are no farther away from the free floor [m].
_OFF_M = 0.5
#: Priors that fit readings of a real flat.
_LAW = PowerLawConfig(
    exponent=(2.0, 0.2), wall_db=(3.0, 1.5), pattern_db=1.0, shadowing_db=4.5, reading_db=4.0, averaged=2.5
)
#: Candidates are no farther from the floor than so many times the distance at which their prior decreases by e.
_FARTHEST = 3.0


@dataclass(frozen=True, kw_only=True)
@checked
class BeaconConfig:
    """Prior knowledge of a beacon, and the resolution of its place."""

    law: PowerLawConfig = _LAW
    """Powers."""
    unresolved_m: Annotated[float, Range(0, 100, "m")] = 1.0
    """Standard deviation along each axis that remains with any number of readings [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BeaconPlace:
    """Position of a beacon after a part of the route."""

    xy: Float[np.ndarray, "2"]
    """Mean [m]."""
    covariance: Float[np.ndarray, "2 2"]
    """Covariance [m2]."""
    candidates: Float[np.ndarray, "m 2"]
    """Candidate places [m]."""
    probability: Float[np.ndarray, " m"]
    """Probability of each, without `BeaconConfig.unresolved_m`."""


@lru_cache(maxsize=1)
def _floor_of(plan: FloorPlan) -> cKDTree:
    """Middles of the free cells of a plan, in which several beacons are located."""
    return cKDTree(plan.centres(plan.free))


def locate_beacon(
    readings: PowerReadings, plan: FloorPlan | None, beyond_m: float, config: BeaconConfig | None = None
) -> BeaconPlace:
    """Locate a beacon.

    Args:
        readings: Its powers along the route.
        plan: Walls between places; None for none.
        beyond_m: Distance from the free floor of the plan, or from the route without one, at which the prior is less
            by a factor of e [m].
        config: What is known before.

    Raises:
        FileError: If positions do not lie on the floor of the plan.
    """
    c = config or BeaconConfig()
    tree = cKDTree(readings.xy) if plan is None else _floor_of(plan)
    floor, readings = tree.data, readings.thinned(_STEP_M, _TURN_RAD, _MOST)
    if (off := np.median(tree.query(readings.xy)[0])) > _OFF_M:
        raise FileError(
            f"half of the positions are more than {off:.1f} m away from the free floor, expected on it. Give plan and "
            "table in one frame."
        )
    low, high = floor.min(axis=0) - _FARTHEST * beyond_m, floor.max(axis=0) + _FARTHEST * beyond_m
    cell_m = max(_CELL_M, float(np.sqrt(np.prod(high - low) / _CANDIDATES)))
    x, y = np.meshgrid(*(np.arange(low[i], high[i] + cell_m, cell_m) for i in range(2)))
    candidates = np.column_stack([x.ravel(), y.ravel()])
    away_m = tree.query(candidates)[0]
    candidates, away_m = candidates[near := away_m <= _FARTHEST * beyond_m], away_m[near]
    if plan is None:
        walls = np.zeros((len(readings.xy), len(candidates)), np.uint8)
    else:
        cells = plan.to_cells(readings.xy), plan.to_cells(candidates)
        walls = count_walls(plan.occupancy == OCCUPIED, *cells)
    log = log_evidence(readings, candidates, walls, c.law) - away_m / beyond_m
    probability = np.exp(log - log.max())
    probability /= probability.sum()
    mean = probability @ candidates
    off = candidates - mean
    covariance = (probability[:, None] * off).T @ off + c.unresolved_m**2 * np.eye(2)
    return BeaconPlace(xy=mean, covariance=covariance, candidates=candidates, probability=probability)
