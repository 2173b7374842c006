"""Shipped classifiers of link states: they load by name and know the plain cases."""

import numpy as np
import pytest

from robosim.parts import CLASSIFIER
from robosim.radio.link import RadioLinkConfig
from robosim.radio.measurement import check_classifier
from robosim.support.installation import shipped_weights


def test_what_is_shipped():
    assert {"generated", "generated-no-aod", "public"} <= set(shipped_weights())


def test_plain_cases():
    """Sharp peaks with a strong path along one line: LOS. Estimates of noise: higher order. Both over 0.9."""
    aoa = np.radians([[20.0, 95, -60, 140, -100]] * 3)
    aod = np.radians([[-157.5, 90, -120, 45, -82.5]] * 3)
    snr = np.array([[52.0, 35, 28, 22, 18], [1.5, 1.2, 1.0, 0.7, 0.5], [-np.inf] * 5])
    peak = np.array([[22.0, 18, 17, 16, 15], [3.5, 3.4, 3.3, 3.3, 3.2], [0.0] * 5])
    found = CLASSIFIER.make("public").predict(aoa, snr, aod_rad=aod, peak=peak)
    assert found.shape == (3, 4)
    assert found[0, 1] > 0.9
    assert found[1, 3] > 0.9
    assert found[2].tolist() == [1, 0, 0, 0]


@pytest.mark.parametrize("name", ["generated", "generated-no-aod"])
def test_plain_cases_of_our_own_sounding(name):
    """A path 70 dB over the noise straight from the target: LOS. No path: outage. Both over 0.9."""
    aoa = np.radians([[20.0, 95, -60, 140, -100], [0, 0, 0, 0, 0]])
    aod = np.radians([[-160.0, 85, -120, 40, -80], [0, 0, 0, 0, 0]])
    snr = np.array([[70.0, 52, 45, 40, 38], [-np.inf] * 5])
    delay = 1e-9 * np.array([[0.0, 6, 9, 14, 21], [0, 0, 0, 0, 0]])
    found = CLASSIFIER.make(name).predict(aoa, snr, aod_rad=aod, delay_s=delay)
    assert found[0, 1] > 0.9
    assert found[1].tolist() == [1, 0, 0, 0]


@pytest.mark.parametrize(
    ("name", "least"), [("generated", 0.93), ("generated-no-aod", 0.9), ("public", 0.885)]
)
def test_the_card_says_how_it_was_made(name, least):
    """The accuracy on held-out buildings is as required, its calibration error below 0.02."""
    card = CLASSIFIER.make(name).card
    assert card["command"].startswith("robosim train link-state")
    fold = card["validation"]["fold0"]
    assert len(fold["accuracy_by_building"]) in (6, 80)
    assert fold["accuracy"] > least
    assert fold["calibration_error"] < 0.02


def test_a_name_that_is_not_there():
    with pytest.raises(
        ValueError, match=r"classifier is 'best'\. Known: .*true, a \.safetensors file, or module:Name"
    ):
        CLASSIFIER.make("best", field="classifier")


@pytest.mark.parametrize(
    ("frequency_hz", "warns"), [(28e9, False), (24.2e9, False), (60e9, True), (2.4e9, True)]
)
def test_another_band_warns(frequency_hz, warns, caplog):
    """All shipped classifiers are trained at 28 GHz."""
    check_classifier("generated", RadioLinkConfig(frequency_hz=frequency_hz))
    assert ("trained at 28 GHz" in caplog.text) == warns
