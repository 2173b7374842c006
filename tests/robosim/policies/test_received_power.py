"""The policy `rss`: its belief gathers around a target that is received without directions."""

from dataclasses import replace

import numpy as np
import pytest

from robosim.episode_config import EpisodeConfig
from robosim.policies.belief import BeliefConfig
from robosim.policies.received_power import PowerBelief, PowerSearch
from robosim.radio.link import RadioLinkConfig
from robosim.radio.measurement import Measurement
from robosim.recording.episode_file import read_episode
from robosim.run import record_episode
from robosim.simulator import SimulatorConfig
from tests.plans import two_rooms
from tests.robosim.policies.test_belief import FRIIS_1M_DB, estimate, measurement, to
from wireless.paths import LinkState

TARGET = np.array([3.0, 2.0])
EVERYWHERE = estimate()


def power_at(place) -> Measurement:
    """The direct path to the target, received as power alone."""
    toward = to(np.asarray(place, float), TARGET)
    distance = np.hypot(*(TARGET - place))
    return measurement(
        np.asarray(place, float), toward, toward + np.pi, distance, LinkState.LOS, 0.0
    ).power_only()


def test_power_alone_has_no_direction_and_no_link_state():
    one = power_at((0.0, 0.0))
    assert np.isnan([one.aoa_rad[0], one.aod_rad[0]]).all()
    assert one.state is LinkState.HIGHER_ORDER
    assert one.gain_db == pytest.approx([FRIIS_1M_DB - 20 * np.log10(np.hypot(*TARGET))])


def test_powers_of_all_paths_add_up():
    one = power_at((0.0, 0.0))
    two = {name: np.repeat(getattr(one, name), 2) for name in ("aoa_rad", "aod_rad", "snr_db", "delay_s")}
    double = replace(one, **two, gain_db=np.full(2, -60.0))
    assert double.power_only().gain_db == pytest.approx([-60 + 10 * np.log10(2)])


def test_the_belief_gathers_around_the_target():
    belief = PowerBelief(np.zeros(2), BeliefConfig(look_m=0.0))
    near = np.hypot(*(belief.centres - TARGET).transpose(2, 0, 1)) < 2.5
    masses = []
    for angle in np.linspace(0, 4 * np.pi, 40):
        radius = 0.5 + 0.3 * angle
        belief.add(power_at((1.5 + radius * np.cos(angle), 1.0 + radius * np.sin(angle))), EVERYWHERE)
        masses.append(belief.probability()[near].sum())
    assert masses[-1] > 3 * masses[0]


def test_a_place_that_is_empty_stays_so_as_powers_come_in():
    belief = PowerBelief(np.zeros(2))
    belief.add(power_at((0.0, 0.0)), EVERYWHERE)
    belief.rule_out(TARGET, 0.6, strength=8.0)
    for k in range(1, 8):
        belief.add(power_at((0.5 * k, 0.3)), EVERYWHERE)
    row, column = belief.frame.index(TARGET)
    assert belief.probability()[row, column] < 1e-3 * belief.probability().max()


def test_it_uses_no_directions():
    assert not PowerSearch.uses_directions


def test_an_episode_without_directions_is_recorded_and_drawn(tmp_path):
    simulator = SimulatorConfig(physics="kinematic", camera="plan", radio=RadioLinkConfig().in_band("ble"))
    config = EpisodeConfig(
        goal="rss", simulator=simulator, mapper="classical", link_states="true", seed=3, max_steps=12
    )
    start, target = np.array([1.0, 1.0, 0.0]), np.array([5.5, 2.4])
    result = record_episode(two_rooms(0.8), config, tmp_path, start=start, target=target)
    assert result["steps"] == 12
    for step in read_episode(tmp_path).steps():
        assert step.estimated.measurement is not None
        assert not len(step.estimated.measurement.directed)
