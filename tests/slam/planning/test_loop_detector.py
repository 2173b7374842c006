"""Going round near a place is noticed, named and ended; everything else is left alone."""

import logging
import math

import numpy as np
import pytest

from slam.planning.loop_detector import LoopDetector, Remedy
from slam.planning.planner import Plan, Planner
from tests.slam.floors import floor

A, B, HERE = np.array([2.5, 0.0]), np.array([-2.5, 0.0]), np.zeros(3)


def _plan(goal, length_m) -> Plan:
    plan = Planner().plan(floor(), np.asarray(goal))
    return Plan(**{**vars(plan), "length_m": length_m})


def _detect(places, goals, lengths) -> tuple[LoopDetector, list[int], list[Remedy]]:
    """Decisions at which a remedy was named, and the remedies."""
    detector, plan, when, what = LoopDetector(), _plan(A, 1.0), [], []
    for k, (place, goal, length_m) in enumerate(zip(places, goals, lengths, strict=True)):
        remedy = detector.watch(np.append(place, 0.0), goal, Plan(**{**vars(plan), "length_m": length_m}))
        if remedy is not None:
            when.append(k)
            what.append(remedy)
    return detector, when, what


def _circle(count, radius_m=0.8) -> np.ndarray:
    angle = 0.3 * np.arange(count)
    return radius_m * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("length_m", [5.0, math.inf])
def test_a_path_that_does_not_get_shorter_is_planned_closely(length_m, caplog):
    """Reported at the 60th decision, and again only after 60 more, with place, goal and cause."""
    with caplog.at_level(logging.WARNING):
        _, when, what = _detect(_circle(125), [A] * 125, [length_m] * 125)
    assert when == [59, 119]
    assert set(what) == {Remedy.PLAN_CLOSELY}
    assert "does not get shorter" in caplog.text
    assert "bound for (2.50, 0.00)" in caplog.text


def test_a_goal_is_held_while_goals_alternate():
    """Two goals, ten decisions each: the one of the 60th is held for the next 60, then the requested one follows."""
    goals = [A if k // 10 % 2 else B for k in range(60)]
    detector, when, what = _detect(_circle(60), goals, [3.0] * 60)
    assert (when, what) == ([59], [Remedy.KEEP_GOAL])
    assert all(np.array_equal(detector.goal(B, HERE), A) for _ in range(60))
    assert np.array_equal(detector.goal(B, HERE), B)
    detector, _, _ = _detect(_circle(60), goals, [3.0] * 60)
    assert np.array_equal(detector.goal(B, np.append(A, 0.0)), B), "a goal is held until it is reached"
    assert np.array_equal(detector.goal(B, HERE), B)


def test_what_gets_on_is_left_alone():
    """A path that gets shorter, a robot that leaves or turns on the spot, goals that are always new: no remedy."""
    on = np.column_stack([0.1 * np.arange(120), np.zeros(120)])
    new = [np.array([A[0] + 0.6 * k, 0.0]) for k in range(120)]
    for places, goals, lengths in (
        (_circle(120), [A] * 120, 20 - 0.1 * np.arange(120)),
        (on, [A] * 120, [5.0] * 120),
        (0.0 * on, [A] * 120, [5.0] * 120),
        (_circle(120), new, [5.0] * 120),
        (_circle(120), [A] * 120, [0.3] * 120),
    ):
        detector, when, _ = _detect(places, goals, lengths)
        assert not when
        assert np.array_equal(detector.goal(B, HERE), B)


def test_looking_closely_plans_far_paths_on_the_maps_own_cells():
    """The far field's cells are 10 cm wide, and 5 cm after that, until the goal is another one."""
    estimate, planner = floor((-9.5, 0.0, 0.0), low_xy=(-10.0, -2.0), size_m=(20.0, 4.0)), Planner()

    def cell_m(goal) -> float:
        planner.plan(estimate, np.array(goal))
        return planner._far.field.frame.resolution_m

    assert cell_m((9.0, 0.0)) == pytest.approx(0.1)
    planner.look_closely()
    assert cell_m((9.0, 0.0)) == pytest.approx(0.05)
    assert cell_m((9.0, 1.5)) == pytest.approx(0.1)
