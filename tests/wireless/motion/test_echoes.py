"""Echoes off bodies: the radar equation, sight, and Doppler shifts of moving bodies."""

import numpy as np
import pytest
from scipy.constants import speed_of_light

from wireless.motion.blockage import block
from wireless.motion.bodies import people
from wireless.motion.echoes import PERSON_CROSS_SECTION_M2, SIGHT, add_echoes
from wireless.paths import Interaction
from wireless.tracing.tracer import Tracer


@pytest.fixture(scope="module")
def sight(extruded, ring):
    """A room with a wall from below to its middle."""
    return Tracer(
        extruded(np.concatenate([ring((0, 0), (10, 0), (10, 6), (0, 6)), [[(5, 0), (5, 3)]]])), config=SIGHT
    )


TX, RX = np.array([[1.0, 5.0, 1.5]]), np.array([[9.0, 5.0, 1.0], [9.0, 0.5, 1.0]])


def test_power_is_that_of_the_radar_equation(sight):
    """P = lambda^2 sigma / ((4 pi)^3 d1^2 d2^2), the delay that of both legs, and both directions point to the body."""
    body = people(np.array([[4.0, 4.0]]), height_m=1.8)
    paths = sight.trace(TX, RX[:1])
    echo = add_echoes(paths, body, sight).select(np.array([1]))
    middle = np.array([4.0, 4.0, 0.9])
    d1, d2 = np.linalg.norm(middle - TX[0]), np.linalg.norm(middle - RX[0])
    wavelength_m = speed_of_light / 28e9
    power = wavelength_m**2 * PERSON_CROSS_SECTION_M2 / ((4 * np.pi) ** 3 * d1**2 * d2**2)
    assert echo.power[0] == pytest.approx(power) and abs(echo.gain[0, 0, 0]) ** 2 == pytest.approx(power)
    assert np.angle(echo.gain[0, 0, 0] * np.exp(2j * np.pi / wavelength_m * (d1 + d2))) == pytest.approx(
        0, abs=1e-6
    )
    assert echo.delay_s[0] == pytest.approx((d1 + d2) / speed_of_light)
    assert echo.interaction[0, 0] == Interaction.SCATTERING and echo.order[0] == 1
    np.testing.assert_allclose(echo.point[0, 0], middle)
    for az, el, end in ((echo.aod_az, echo.aod_el, TX[0]), (echo.aoa_az, echo.aoa_el, RX[0])):
        toward = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])[:, 0]
        np.testing.assert_allclose(toward, (middle - end) / np.linalg.norm(middle - end))


def test_bodies_echo_where_both_ends_see_them(sight):
    """Behind the wall the transmitter sees no body, and the second receiver none before it; links stay in order."""
    bodies = people(np.array([[4.0, 1.0], [8.0, 1.0], [5.5, 4.5]]))
    paths = sight.trace(TX, RX)
    both = add_echoes(paths, bodies, sight)
    assert (both.order == 1).sum() == 2 and both.count().tolist() == [[2, 1]]
    assert (np.diff(both.link) >= 0).all() and len(add_echoes(paths, people(np.empty((0, 2))), sight)) == len(
        paths
    )
    echo = both.select(both.order == 1)
    assert (np.hypot(*(echo.point[:, 0, :2] - [5.5, 4.5]).T) < 1e-9).all()


def test_an_echo_is_blocked_by_others_only(sight):
    """The body that reflects does not block its own echo; a second one on the second leg costs more than 5 dB."""
    reflects, blocks = [4.0, 4.0], [6.5, 4.5]
    paths = add_echoes(sight.trace(TX, RX[:1]), people(np.array([reflects])), sight)
    echo = paths.select(paths.order == 1)
    assert block(echo, people(np.array([reflects])))[0] is echo
    found = block(echo, people(np.array([reflects, blocks])))[1]
    assert found.body.tolist() == [1] and found.loss_db[0] > 5


def test_doppler_of_an_echo_is_the_bistatic_sum(sight):
    """A walking body, transmitter and receiver: against central differences of traced delays, 1e-6 relative."""
    start, velocity = np.array([[4.0, 4.0]]), np.array([[1.1, -0.7]])
    v_tx, v_rx, step_s = np.array([0.2, 0.1, 0.0]), np.array([-0.5, 0.3, 0.1]), 1e-3

    def at(t):
        paths = add_echoes(sight.trace(TX + v_tx * t, RX[:1] + v_rx * t), people(start + velocity * t), sight)
        return paths.select(paths.order == 1)

    now, before, after = at(0.0), at(-step_s), at(step_s)
    point_velocity = np.full((1, now.point.shape[1], 3), np.nan)
    point_velocity[0, 0] = [1.1, -0.7, 0.0]
    shift = now.doppler_hz(tx_velocity=v_tx, rx_velocity=v_rx, point_velocity=point_velocity)
    expected = -28e9 * (after.delay_s - before.delay_s) / (2 * step_s)
    np.testing.assert_allclose(shift, expected, rtol=1e-6)
