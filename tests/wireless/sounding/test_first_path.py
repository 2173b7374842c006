"""First paths as receivers detect them: against places of peaks that are known."""

from dataclasses import replace

import numpy as np
import pytest

from wireless.channel import Channel
from wireless.sounding.first_path import detect_first_path
from wireless.tracing.tracer import Tracer, TracerConfig

BANDWIDTH_HZ = 500e6


@pytest.fixture(scope="module")
def direct(extruded):
    """The direct path of 5 m next to a far wall."""
    mesh = extruded(np.array([[(50.0, -1.0), (50.0, 1.0)]]))
    config = TracerConfig(max_reflections=0, diffraction=False)
    return Tracer(mesh, frequency_hz=4e9, config=config).trace([[0, 0, 1]], [[5, 0, 1]])


def with_paths(direct, delays_s, gains):
    """Paths of some delays and gains."""
    paths = direct.select(np.zeros(len(delays_s), int))
    gain = np.zeros((len(gains), 2, 2), complex)
    gain[:, 0, 0] = gains
    return Channel.from_paths(replace(paths, delay_s=np.array(delays_s), gain=gain))


def test_the_peak_of_one_path_is_at_its_delay(direct):
    delay, gain = detect_first_path(Channel.from_paths(direct), BANDWIDTH_HZ, -200)
    assert delay[0, 0] == pytest.approx(direct.delay_s[0], abs=0.002e-9)
    assert gain[0, 0] == pytest.approx(direct.power_db[0], abs=0.01)


@pytest.mark.parametrize(("weak_db", "expected_ns"), [(-20, 20.0), (-40, 40.0)])
def test_paths_below_noise_or_side_lobes_are_missed(direct, weak_db, expected_ns):
    """A path 20 dB below one 20 ns later counts, one 40 dB below does not."""
    channel = with_paths(direct, [20e-9, 40e-9], [10 ** (weak_db / 20), 1.0])
    assert detect_first_path(channel, BANDWIDTH_HZ, -200)[0][0, 0] == pytest.approx(
        expected_ns * 1e-9, abs=2e-11
    )
    noisy = with_paths(direct, [20e-9, 40e-9], [0.1, 1.0])
    assert detect_first_path(noisy, BANDWIDTH_HZ, -10)[0][0, 0] == pytest.approx(40e-9, abs=5e-12)
    assert np.isnan(detect_first_path(noisy, BANDWIDTH_HZ, 10)[0][0, 0])


def test_side_lobes_before_a_strong_path_are_not_detected(direct):
    channel = with_paths(direct, [40e-9], [1.0])
    assert detect_first_path(channel, BANDWIDTH_HZ, -200)[0][0, 0] == pytest.approx(40e-9, abs=5e-12)


def test_bandwidth_must_be_positive(direct):
    with pytest.raises(ValueError, match="bandwidth_hz is 0"):
        detect_first_path(Channel.from_paths(direct), 0.0, -100)
