"""Radio bands in episodes: what a band sets, and what policies and classifiers are not given in it."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from robosim.agent import check_weights
from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.datasets.link_units import LinkSetConfig, plain_config
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.radio.link import RadioLinkConfig
from robosim.radio.measurement import check_classifier
from robosim.radio.scene import RadioConfig
from robosim.simulator import SimulatorConfig
from robosim.step import Step
from robosim.task.tasks import make_task
from tests.plans import two_rooms
from wireless.bands import BANDS
from wireless.sounding.sounder import SoundingConfig


def test_the_default_is_28_ghz():
    """Nothing of a configuration differs, so that files and results stay those without bands."""
    assert RadioLinkConfig().in_band("28ghz") == RadioLinkConfig()
    assert EpisodeConfig().in_band("28ghz") == EpisodeConfig()


@pytest.mark.parametrize("name", BANDS)
@pytest.mark.parametrize("engine", ["live", "table"])
def test_an_episode_in_each_band(name, engine, caplog):
    """A few steps with the band's classifier: paths are found, the belief uses the carrier.

    The only warning is that of tables, whose errors are those of `ue`.
    """
    simulator = SimulatorConfig(physics="kinematic", camera="plan", radio=RadioLinkConfig(engine=engine))
    config = EpisodeConfig(goal="fused", mapper="classical", max_steps=3, simulator=simulator).in_band(name)
    building = make_building(two_rooms(0.8))
    task = make_task(reach(building, 0.1), np.random.default_rng(0))
    steps: list[Step] = []
    with caplog.at_level(logging.WARNING, "robosim.radio"):
        check_weights(config)
        run_episode(building, reach(building, 0.1), task, config, lambda log, step: steps.append(step))
    warnings = [one.message for one in caplog.records if one.name.startswith("robosim.radio")]
    assert [text.split(",")[0] for text in warnings] == (
        ["engine is 'table'"] if engine == "table" and BANDS[name].receiver == "ring-8" else []
    )
    for step in steps:
        measured = step.estimated.require_measurement()
        assert len(measured.aoa_rad) and measured.probability.sum() == pytest.approx(1.0, abs=1e-6)
        assert np.isnan(measured.aod_rad).any() == (BANDS[name].transmitter == "tag")
        belief = step.decided.belief
        assert belief.config.frequency_hz == BANDS[name].frequency_hz
        assert np.isfinite(belief.probability()).all()


@pytest.mark.parametrize(
    ("classifier", "name", "missing"),
    [
        ("generated", "wifi-6", "a single beam (tag)"),
        ("generated-no-aod", "ble", "a bandwidth of 2 MHz"),
        ("generated-no-sync", "uwb-6.5", None),
    ],
)
def test_classifiers_are_given_only_what_is_measured(classifier, name, missing, caplog):
    """One that needs more is an error at the start; one of another carrier gives a warning."""
    radio = RadioLinkConfig().in_band(name)
    if missing is None:
        check_classifier(classifier, radio)
        assert "trained at 28 GHz, and the radio works at 6.4896 GHz" in caplog.text
        return
    with pytest.raises(ValueError, match=missing.replace("(", r"\(").replace(")", r"\)")):
        check_classifier(classifier, radio)


def test_the_power_of_a_data_set_is_that_of_its_radio():
    """Also in its manifest, whose other values stay."""
    config = LinkSetConfig(radio=RadioConfig(tx_power_dbm=10.0), sounding=SoundingConfig(bandwidth_mhz=80.0))
    assert plain_config(config)["sounding"] == {
        "tx_power_dbm": 10.0,
        "bandwidth_mhz": 80.0,
        "n_samples": 2048,
        "loss_db": 6.0,
        "half_window": 5,
    }


def test_a_bandwidth_in_khz_is_rejected():
    """80 MHz of Wi-Fi as 80000, whose noise would be 30 dB too high."""
    radio = RadioLinkConfig().in_band("wifi-5")
    with pytest.raises(ValueError, match=r"bandwidth_mhz is 80000 at a carrier of 5.21 GHz.* not in kHz"):
        replace(radio, sounding=replace(radio.sounding, bandwidth_mhz=80_000.0))
