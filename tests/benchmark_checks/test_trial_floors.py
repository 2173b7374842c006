"""Floors with little to match, and plans turned against their grid."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, UNKNOWN, FloorPlan
from tests.benchmarks.trial_floors import TRIAL_FLOORS, turned


@pytest.mark.parametrize("name", TRIAL_FLOORS)
def test_a_robot_gets_everywhere(name: str) -> None:
    """At least 200 m2 of floor, in one piece but for corners, closed all around, and the same each time."""
    plan = TRIAL_FLOORS[name]()
    assert plan.name == name
    assert np.array_equal(plan.occupancy, TRIAL_FLOORS[name]().occupancy)
    rim = np.concatenate([plan.occupancy[0], plan.occupancy[-1], plan.occupancy[:, 0], plan.occupancy[:, -1]])
    assert (rim != FREE).all()
    assert make_building(plan).free.area > 200
    parts = reach(make_building(plan), 0.1).parts
    assert np.bincount(parts[parts > 0]).max() > 0.95 * (parts > 0).sum()


def test_a_turn_keeps_sizes_and_goes_counterclockwise() -> None:
    """An L by 90 degrees is numpy's; by 30 the area is the same within 2 %, and its long side turns by as much."""
    cells = np.full((70, 90), UNKNOWN, np.uint8)
    cells[10:50, 10:70] = FREE
    cells[50:60, 10:30] = FREE
    plan = FloorPlan(occupancy=cells, resolution_m=0.05, name="l")
    assert turned(plan, 0) is plan
    quarter = turned(plan, 90)
    inner = quarter.occupancy[
        np.ix_(*(np.flatnonzero((quarter.occupancy == FREE).any(axis=k)) for k in (1, 0)))
    ]
    # Rows grow upwards here, downwards in numpy's words.
    expected = np.rot90(cells[::-1])[::-1]
    expected = expected[np.ix_(*(np.flatnonzero((expected == FREE).any(axis=k)) for k in (1, 0)))]
    assert np.array_equal(inner, expected)
    askew = turned(plan, 30)
    assert askew.free.sum() == pytest.approx(plan.free.sum(), rel=0.02)
    assert _slope_deg(askew) - _slope_deg(plan) == pytest.approx(30, abs=1)
    assert askew.name == "l@30"


def _slope_deg(plan: FloorPlan) -> float:
    """Direction in which the floor is longest."""
    iy, ix = np.nonzero(plan.free)
    _, vectors = np.linalg.eigh(np.cov(np.array([ix, iy])))
    return float(np.degrees(np.arctan(vectors[1, 1] / vectors[0, 1])))


def test_a_shipped_plan_is_as_large_when_turned() -> None:
    """What the hull can reach of a flat changes by less than 3 % at 45 degrees."""
    plan = read_plan("flat")
    areas = [(reach(make_building(turned(plan, angle)), 0.1).parts > 0).sum() for angle in (0, 45)]
    assert areas[1] == pytest.approx(areas[0], rel=0.03)
