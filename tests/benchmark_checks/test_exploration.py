"""The scores of explorers, on curves and episodes whose scores are known."""

import numpy as np
import pytest

from tests.benchmarks.exploration import DECISIONS, area_under, gain_over, held


def test_the_area_under_a_ramp_that_ends_at_half_is_three_quarters():
    """From 0 to 1 over 500 decisions, then held: 0.25 + 0.5, exactly; left at zero after the end it were 0.25."""
    curve = held(np.arange(501) / 500)
    assert len(curve) == DECISIONS + 1
    assert area_under(curve) == pytest.approx(0.75, abs=1e-12)


def test_a_curve_longer_than_the_score_is_cut():
    """What is seen after decision 1000 does not count."""
    assert held(np.append(np.zeros(DECISIONS + 1), np.ones(50))).max() == 0.0


def test_the_gain_is_paired_by_plan():
    """Twice the other's score on every plan: +100 % with no width at all, though the plans differ by a factor of 9."""
    other = np.array([0.1, 0.5, 0.9])
    assert gain_over(2 * other, other) == pytest.approx((1.0, 1.0, 1.0))
    more, low, high = gain_over(np.array([0.5, 0.7, 0.3]), np.array([0.5, 0.4, 0.6]))
    assert more == pytest.approx(0.0)
    assert low < -0.2 and high > 0.2
