"""Ranges by round-trip time: what is measured, and what the belief makes of it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.constants import speed_of_light
from scipy.stats import exponnorm, norm

from robosim.building.building import make_building
from robosim.policies.belief import BeliefConfig
from robosim.policies.likelihood import range_density
from robosim.policies.received_power import PowerBelief
from robosim.radio.link import RadioLink, RadioLinkConfig, first_path_m
from robosim.radio.measurement import Interpreter, Measurement, bearings_of
from tests.plans import two_rooms
from tests.robosim.policies.test_belief import estimate, wall
from wireless.paths import LinkState

HERE, TARGET = np.array([1.0, 1.0, 0.4]), np.array([5.0, 2.2])


@pytest.fixture(scope="module")
def building():
    return make_building(two_rooms(0.8))


def measured(building, sigma_m, seed=1, pose=HERE):
    config = RadioLinkConfig(range_sigma_m=sigma_m)
    link = RadioLink(building, config)
    link.place(TARGET)
    paths = link.measure(pose, np.random.default_rng(seed))
    return link, paths


def test_a_range_is_the_length_of_the_first_path_with_noise(building):
    link, _ = measured(building, 0.001)
    assert link.paths is not None
    length_m = first_path_m(link.paths, link.config.sounding)
    assert link.range_m == pytest.approx(length_m, abs=0.005)
    assert length_m == pytest.approx(speed_of_light * link.paths.delay_s.min(), abs=0.3)
    errors = [measured(building, 0.5, seed)[0].range_m - length_m for seed in range(40)]
    assert 0.3 < np.std(errors) < 0.7


def test_a_first_path_that_is_much_weaker_is_missed(building):
    link, _ = measured(building, 0.1)
    paths = link.paths
    assert paths is not None
    first = int(paths.delay_s.argmin())
    faint = replace(paths, gain=np.where(np.arange(len(paths))[:, None, None] == first, 1e-12, paths.gain))
    sounding = link.config.sounding
    assert first_path_m(faint, sounding) > first_path_m(paths, sounding) + 0.05


def test_a_narrow_band_merges_paths(building):
    """At 5 MHz, whose pulse is 60 m wide, the detected peak lies between the paths."""
    link, _ = measured(building, 0.1)
    narrow = first_path_m(link.paths, replace(link.config.sounding, bandwidth_mhz=5.0))
    lengths = speed_of_light * link.paths.delay_s
    assert lengths.min() < narrow < lengths.max()


@pytest.mark.parametrize("estimator", ["sage", "pca"])
def test_a_range_in_outage_is_unknown(estimator):
    """Behind a wall without a door, whatever the estimator takes noise for."""
    link = RadioLink(make_building(two_rooms(0.0)), RadioLinkConfig(range_sigma_m=0.1, estimator=estimator))
    link.place(TARGET)
    counts = []
    for seed in range(3):
        counts.append(link.measure(HERE, np.random.default_rng(seed)).count[0])
        assert len(link.paths) == 0 and math.isnan(link.range_m)
    assert estimator == "sage" or any(counts)
    assert math.isnan(first_path_m(link.paths, link.config.sounding))


def test_without_ranging_nothing_changes(building):
    link, without = measured(building, None)
    assert math.isnan(link.range_m)
    _, with_range = measured(building, 0.2)
    assert np.array_equal(without.aoa_rad, with_range.aoa_rad)
    assert np.array_equal(without.snr_db, with_range.snr_db)


def ranged(range_m, state, merged_m=0.0):
    nothing = [np.zeros(0)] * 5
    return Measurement(np.zeros(3), *nothing, np.eye(4)[state], range_m, range_merged_m=merged_m)


@pytest.mark.parametrize(
    ("state", "route_m", "merged_m", "law"),
    [
        (LinkState.LOS, None, 0.0, norm(4.0, 0.3)),
        (LinkState.LOS, 4.5, 0.0, norm(4.0, 0.3)),
        (LinkState.FIRST_ORDER, None, 0.0, exponnorm(0.35 / 0.3, 4.0, 0.3)),
        (LinkState.FIRST_ORDER, None, 0.5, exponnorm(0.85 / 0.3, 4.0, 0.3)),
        (LinkState.FIRST_ORDER, 4.5, 0.0, exponnorm(0.9 / 0.3, 4.5, 0.3)),
        (LinkState.HIGHER_ORDER, None, 0.0, exponnorm(0.75 / 0.3, 4.0, 0.3)),
        (LinkState.HIGHER_ORDER, 4.5, 0.1, exponnorm(2.1 / 0.3, 4.5, 0.3)),
    ],
)
def test_the_density_of_a_range_is_normal_and_exponential(state, route_m, merged_m, law):
    route = None if route_m is None else np.array([route_m])
    for range_m in (2.0, 3.5, 4.0, 4.4, 6.0, 20.0):
        density = range_density(ranged(range_m, state, merged_m), 0.3, np.array([4.0]), route)
        assert density == pytest.approx([0.05 / 50 + 0.95 * law.pdf(range_m)], rel=1e-6)


def test_in_outage_a_range_carries_no_information():
    density = range_density(ranged(3.0, LinkState.OUTAGE), 0.2, np.array([0.1, 3.0, 40.0]))
    assert density == pytest.approx(np.full(3, 1 / 50))


def test_the_belief_lies_on_a_ring_around_the_robot(building):
    link, paths = measured(building, 0.1)
    one = Interpreter(link, "true").interpret(paths, HERE).power_only()
    beliefs = []
    for range_m in (3.0, math.nan):
        belief = PowerBelief(HERE[:2], BeliefConfig(look_m=0.0, weight=1.0))
        belief.add(replace(one, probability=np.eye(4)[LinkState.LOS], range_m=range_m), estimate())
        beliefs.append(belief)
    distance = np.hypot(*(beliefs[0].centres - HERE[:2]).transpose(2, 0, 1))
    ranged, without = (belief.probability()[np.abs(distance - 3.0) < 0.4].sum() for belief in beliefs)
    assert ranged > 0.8 > 0.5 > without


def test_the_mapper_gets_the_length_of_the_strongest_path(building):
    link, paths = measured(building, 0.05)
    assert link.paths is not None
    one = Interpreter(link, "true").interpret(paths, HERE)
    bearing = bearings_of({"target": one}, link.config, {})[0]
    assert bearing.range_m == pytest.approx(speed_of_light * link.paths.delay_s[0], abs=0.3)
    assert one.range_sigma_m == pytest.approx(math.hypot(0.05, one.range_merged_m))
    assert bearing.sigma_log_range == pytest.approx(one.range_sigma_m / bearing.range_m)


def test_around_an_opaque_wall_a_range_is_that_of_the_route():
    """Behind a wall of 8 m, 2 m away, a place has a route of 8.3 m: a range of 9 m is likely there at 28 GHz only."""
    behind, mass = estimate(wall(0.9, 1.1, -4.0, 4.0)), []
    measured = replace(ranged(9.0, LinkState.FIRST_ORDER), range_sigma_m=0.2)
    for frequency_hz in (5e9, 28e9):
        belief = PowerBelief(np.zeros(2), BeliefConfig(frequency_hz=frequency_hz, look_m=0.0, weight=1.0))
        belief.add(measured, behind)
        near = np.hypot(*(belief.centres - [2.0, 0.0]).transpose(2, 0, 1)) < 0.5
        mass.append(belief.probability()[near].sum())
    assert mass[1] > 5 * mass[0]
