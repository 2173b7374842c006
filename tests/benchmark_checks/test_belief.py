"""Scores of beliefs, on claims whose score is known."""

import math

import numpy as np
import pytest

from robosim.policies.belief import BeliefConfig, TargetBelief
from tests.benchmarks.belief import RADII_M, calibration_error, judge, perfect_error


def test_who_claims_what_happens_has_no_calibration_error():
    """Claims of 0.25 that hold in a quarter, of 0.75 in three: 0. With the two swapped: half off, each."""
    claimed = np.repeat([0.25, 0.75], 4)
    held = np.array([1, 0, 0, 0, 1, 1, 1, 0.0])
    assert calibration_error(claimed, held) == pytest.approx(0.0)
    assert calibration_error(claimed, 1 - held) == pytest.approx(0.5)


def test_each_class_of_claims_weighs_as_many_as_fall_in_it():
    """Three claims of 0.05 that never hold, and one of 0.95 that does: 0.05 throughout."""
    assert calibration_error(np.array([0.05, 0.05, 0.05, 0.95]), np.array([0, 0, 0, 1.0])) == pytest.approx(
        0.05
    )


@pytest.mark.parametrize("length", [1, 30])
def test_chance_is_of_searches_rather_than_of_claims(length):
    """Claims of one half in n searches: the mean of |held - n / 2| / n, of a binomial law, however many claims."""
    n = 25
    searches = [np.full(length, 0.5) for _ in range(n)]
    held = np.arange(n + 1)
    chance = np.array([math.comb(n, int(k)) for k in held]) / 2.0**n
    expected = float(chance @ np.abs(held / n - 0.5))
    assert perfect_error(searches, draws=4000) == pytest.approx(expected, rel=0.02)


def test_a_belief_that_knows_nothing_has_the_density_of_its_area():
    """A grid of n cells of 0.2 m: log(1 / (n 0.04 m2)) wherever the target is, and each radius claims its disk."""
    belief = TargetBelief(np.zeros(2), BeliefConfig(half_side_m=5.0))
    score, *rest = judge(belief, np.array([1.0, 2.0]))
    cells = belief.probability().size
    assert score == pytest.approx(-np.log(cells * 0.04), abs=1e-5)
    held = rest[len(RADII_M) :]
    assert set(held) <= {0.0, 1.0}


def test_a_target_beyond_the_grid_is_scored_as_impossible():
    assert judge(TargetBelief(np.zeros(2), BeliefConfig(half_side_m=5.0)), np.array([50.0, 0.0]))[0] < -25
