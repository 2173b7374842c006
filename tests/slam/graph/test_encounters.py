"""Relative poses of robots from directions and distances at both ends."""

import math

import numpy as np
import pytest

from slam.graph.encounters import Encounter, relative_pose
from slam.poses import between, compose, wrap

_TRUE = np.array([1.5, -2.0, 2.2])


def _encounters(rng: np.random.Generator, n: int, *, sigma_rad: float, sigma_m: float) -> list[Encounter]:
    """Two robots on random walks, which measure each other with noise; the second frame is at `_TRUE`."""
    encounters, first, second = [], np.zeros(3), np.zeros(3)
    for _ in range(n):
        first = compose(first, np.array([0.5, 0.0, rng.uniform(-1, 1)]))
        second = compose(second, np.array([0.5, 0.0, rng.uniform(-1, 1)]))
        at = compose(_TRUE, second)
        there, back = between(first, at), between(at, first)
        draws = rng.normal(size=3)
        encounters.append(
            Encounter(
                first=first,
                second=second,
                bearing_rad=(
                    wrap(math.atan2(there[1], there[0]) + sigma_rad * draws[0]),
                    wrap(math.atan2(back[1], back[0]) + sigma_rad * draws[1]),
                ),
                sigma_rad=(max(sigma_rad, 1e-6), max(sigma_rad, 1e-6)),
                range_m=math.hypot(*there[:2]) + sigma_m * draws[2],
                sigma_m=max(sigma_m, 1e-6),
            )
        )
    return encounters


def _away(pose: np.ndarray) -> np.ndarray:
    away = pose - _TRUE
    away[2] = wrap(away[2])
    return away


def test_one_exact_encounter_gives_the_pose() -> None:
    (encounter,) = _encounters(np.random.default_rng(0), 1, sigma_rad=0.0, sigma_m=0.0)
    assert np.abs(_away(encounter.relative())).max() < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_exact_measurements_give_the_exact_pose(seed: int) -> None:
    known = relative_pose(_encounters(np.random.default_rng(seed), 6, sigma_rad=0.0, sigma_m=0.0))
    assert known is not None
    assert np.abs(_away(known.pose)).max() < 1e-6


def test_reflections_among_encounters_are_left_out() -> None:
    rng = np.random.default_rng(1)
    encounters = _encounters(rng, 12, sigma_rad=0.01, sigma_m=0.05)
    wrong = _encounters(np.random.default_rng(2), 4, sigma_rad=1.0, sigma_m=2.0)
    known = relative_pose([*encounters, *wrong])
    clean = relative_pose(encounters)
    assert known is not None and clean is not None
    assert np.allclose(known.pose, clean.pose, atol=1e-3)


def test_covariance_holds() -> None:
    squared = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        known = relative_pose(_encounters(rng, 10, sigma_rad=0.03, sigma_m=0.3))
        if known is not None:
            away = _away(known.pose)
            squared.append(away @ np.linalg.solve(known.covariance, away))
    assert len(squared) > 40
    # Chi square of three degrees of freedom; deviations of poses on the maps make it smaller.
    assert 1.0 < np.mean(squared) < 3.8


def test_random_directions_never_give_a_pose() -> None:
    for seed in range(30):
        rng = np.random.default_rng(seed)
        assert relative_pose(_encounters(rng, 12, sigma_rad=0.03, sigma_m=0.3)[:3]) is None
        random = [
            Encounter(
                first=encounter.first,
                second=encounter.second,
                bearing_rad=(rng.uniform(-math.pi, math.pi), rng.uniform(-math.pi, math.pi)),
                sigma_rad=(0.03, 0.03),
                range_m=rng.uniform(1, 8),
                sigma_m=0.3,
            )
            for encounter in _encounters(rng, 12, sigma_rad=0.03, sigma_m=0.3)
        ]
        assert relative_pose(random) is None
