"""Places by received power: the density is that of a Gaussian computed directly, and known transmitters are found."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from wireless.positioning.received_power import PowerLawConfig, PowerReadings, log_evidence


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def route(n, rng, spread_m=6.0):
    return PowerReadings(
        xy=rng.uniform(0, spread_m, (n, 2)),
        heading_rad=rng.uniform(-np.pi, np.pi, n),
        power_dbm=rng.normal(-60, 5, n),
        count=rng.integers(1, 6, n).astype(float),
    )


def mean_and_covariance(readings, place, walls, c):
    """Of the powers given a place, written out with all pairs of readings."""
    n = len(readings.xy)
    apart = readings.xy - place
    level = np.maximum(np.hypot(*apart.T), 0.2)
    distance = np.hypot(level, c.above_m[0])
    columns = np.column_stack([np.ones(n), -10 * np.log10(distance), -walls])
    elevation = 10 * np.log10((level / distance) ** 2 + 0.05)
    known = np.array([c.power_dbm, c.exponent, c.wall_db])
    bearing = np.arctan2(-apart[:, 1], -apart[:, 0]) - readings.heading_rad
    pattern = np.column_stack([np.cos(bearing), np.sin(bearing)]) * (level / distance)[:, None]
    between = np.hypot(*(readings.xy[:, None] - readings.xy).transpose(2, 0, 1))
    covariance = (
        columns @ np.diag(known[:, 1] ** 2) @ columns.T
        + c.pattern_db**2 * pattern @ pattern.T
        + c.shadowing_db**2 * np.exp(-between / c.correlation_m)
        + np.diag(c.reading_db**2 / np.minimum(readings.count, c.averaged) + 1 / 12)
    )
    return columns @ known[:, 0] + elevation, covariance


def test_the_evidence_is_the_density_of_a_normal_distribution(rng):
    c = PowerLawConfig(above_m=(0.9,))
    readings, places = route(12, rng), rng.uniform(-2, 8, (7, 2))
    walls = rng.integers(0, 4, (12, 7))
    direct = []
    for place, passed in zip(places, walls.T, strict=True):
        mean, covariance = mean_and_covariance(readings, place, passed, c)
        direct.append(multivariate_normal(mean, covariance).logpdf(readings.power_dbm))
    found = log_evidence(readings, places, walls, c)
    assert found - found[0] == pytest.approx(np.array(direct) - direct[0], abs=1e-8)


def test_several_heights_are_averaged(rng):
    readings, places = route(9, rng), rng.uniform(0, 6, (4, 2))
    walls = np.zeros((9, 4))
    one, two = (log_evidence(readings, places, walls, PowerLawConfig(above_m=(h,))) for h in (0.5, 1.5))
    both = log_evidence(readings, places, walls, PowerLawConfig(above_m=(0.5, 1.5)))
    assert both == pytest.approx(np.logaddexp(one, two))


def test_without_headings_the_pattern_does_not_count(rng):
    readings, places = route(9, rng), rng.uniform(0, 6, (4, 2))
    blind = PowerReadings(**{**vars(readings), "heading_rad": np.full(9, np.nan)})
    flat = log_evidence(readings, places, np.zeros((9, 4)), PowerLawConfig(pattern_db=0.0))
    assert log_evidence(blind, places, np.zeros((9, 4))) == pytest.approx(flat)


def test_many_readings_in_one_place_count_as_few(rng):
    c = PowerLawConfig()
    places = np.array([[1.0, 0.0], [8.0, 0.0]])

    def preference(n):
        one = PowerReadings(
            xy=np.zeros((n, 2)), heading_rad=np.full(n, np.nan), power_dbm=np.full(n, -30.0), count=np.ones(n)
        )
        return float(np.subtract(*log_evidence(one, places, np.zeros((n, 2)), c)))

    assert 0 < preference(1) < preference(100) < 3 * preference(1)


def test_places_of_transmitters_with_correlated_shadowing_are_calibrated():
    """Powers drawn by the model itself: squared errors over the covariance are 2 on average, as of two dimensions."""
    rng = np.random.default_rng(5)
    c = PowerLawConfig(above_m=(0.8,))
    grid = np.arange(0.25, 10, 0.5)
    places = np.column_stack([axis.ravel() for axis in np.meshgrid(grid, grid)])
    squares = []
    for _ in range(60):
        readings = route(40, rng, spread_m=10.0)
        walls = np.zeros((40, len(places)))
        mean, covariance = mean_and_covariance(readings, truth := rng.uniform(0, 10, 2), walls[:, 0], c)
        drawn = PowerReadings(**{**vars(readings), "power_dbm": rng.multivariate_normal(mean, covariance)})
        log = log_evidence(drawn, places, walls, c)
        p = np.exp(log - log.max())
        p /= p.sum()
        off = places - p @ places
        squares.append((truth - p @ places) @ np.linalg.solve((p[:, None] * off).T @ off, truth - p @ places))
    assert 1.3 < np.mean(squares) < 2.8


def test_thinned_readings_are_means_of_successive_ones():
    x = np.array([0.0, 0.1, 0.2, 1.0, 1.1, 0.0])
    readings = PowerReadings(
        xy=np.column_stack([x, 0 * x]),
        heading_rad=np.array([np.pi - 0.1, -np.pi + 0.1, np.pi, 0.0, 2.0, 2.0]),
        power_dbm=np.array([-50.0, -60, -70, -40, -42, -44]),
        count=np.array([1.0, 1, 2, 1, 1, 1]),
    )
    thin = readings.thinned(0.5, 0.6, 100)
    assert thin.power_dbm == pytest.approx([-62.5, -40, -42, -44])
    assert thin.xy[:, 0] == pytest.approx([0.125, 1.0, 1.1, 0.0])
    assert thin.count.tolist() == [4, 1, 1, 1]
    assert abs(thin.heading_rad[0]) == pytest.approx(np.pi)
    assert len(readings.thinned(0.5, 0.6, 3).xy) <= 3
    none = PowerReadings(
        xy=np.zeros((0, 2)), heading_rad=np.zeros(0), power_dbm=np.zeros(0), count=np.zeros(0)
    )
    assert len(none.thinned(0.5, 0.6, 3).xy) == 0
    assert log_evidence(none, x[:2].reshape(1, 2), np.zeros((0, 1))) == pytest.approx([0])
