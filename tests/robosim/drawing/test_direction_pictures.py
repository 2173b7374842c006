"""Power over directions: where the paths are, by the link budget."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from robosim.building.building import make_building
from robosim.drawing.direction_pictures import draw_directions, power_over_directions
from robosim.radio.receivers import receiver_grid
from tests.plans import two_rooms
from wireless import LinkState, PathEstimates, Rays, Sounder, Tracer, terminal_named


@pytest.fixture(scope="module")
def sounder():
    return Sounder(terminal_named("gnb"), terminal_named("ue"))


@pytest.fixture(scope="module")
def paths():
    building = make_building(two_rooms(0.8))
    grid = receiver_grid(building, 0.3, 1.5)
    return Tracer(building.mesh).trace(np.array([[0.7, 1.5, 1.5]]), grid.position)


def lone(gain_db, aoa_deg, aod_deg):
    """One path of one link."""
    column = np.zeros((1, 1))
    return Rays(
        gain=column + 10 ** (gain_db / 20) + 0j,
        delay_s=column,
        aoa_az=column + np.deg2rad(aoa_deg),
        aoa_el=column,
        aod_az=column + np.deg2rad(aod_deg),
        aod_el=column,
    )


@pytest.mark.parametrize(("aoa_deg", "beam"), [(0.5, 2), (100.5, 16), (-150.5, 40)])
def test_power_peaks_at_the_path_by_the_link_budget(sounder, aoa_deg, beam):
    """A path along a beam: the peak lies there, at power sent + gain + both directivities, within 0.1 dB."""
    aod = sounder.tx.beam_rad[beam]
    rays, rng = lone(-70.0, aoa_deg, np.rad2deg(aod)), np.random.default_rng(1)
    clocks = replace(sounder.clocks(rays, rng), offset=np.array([40.0]))
    azimuth, power = power_over_directions(sounder, sounder.measure(rays, rng, clocks=clocks)[0])
    look, best = np.unravel_index(power.argmax(), power.shape)
    assert best == beam
    assert abs(np.rad2deg(azimuth[look]) - aoa_deg) < 3
    rx = sounder.rx.platform.directivity(azimuth[[look]]).max()
    tx = np.abs(sounder.tx.beam_response(np.array([aod]))[0, beam]) ** 2
    assert power.max() == pytest.approx(23.0 - 70.0 + 10 * np.log10(rx * tx), abs=0.1)


def test_silence_shows_the_noise(sounder):
    """Without a path the mean power is that of noise, -174 dBm/Hz in 400 MHz / 2048 and 6 dB, at its strongest delay.

    Of 11 independent exponentials the largest is 3.02 times the mean (the 11th harmonic number): 4.8 dB.
    """
    tensor = sounder.measure(lone(-400.0, 0.0, 0.0), np.random.default_rng(2))[0]
    _, power = power_over_directions(sounder, tensor)
    floor = -174 + 10 * np.log10(400e6 / 2048) + 6
    assert 10 * np.log10(np.mean(10 ** (power / 10))) == pytest.approx(floor + 4.8, abs=0.5)


def test_picture_marks_true_and_estimated_paths(sounder, paths):
    """A circle for each true path within 30 dB of the strongest, a cross for each estimate, in degrees."""
    in_sight = np.flatnonzero(paths.link_state().ravel() == LinkState.LOS)
    mine = paths.select(paths.link == in_sight[0])
    found = PathEstimates(
        aoa_rad=np.array([[0.5, -2.0, 0.0]]),
        aod_rad=np.array([[1.0, 3.0, 0.0]]),
        snr_db=np.array([[40.0, 20.0, -np.inf]]),
        delay_s=np.zeros((1, 3)),
        count=np.array([2]),
    )
    tensor = sounder.measure(lone(-70.0, 0.0, 0.0), np.random.default_rng(0))[0]
    axes = Figure().subplots()
    draw_directions(axes, mine, sounder, tensor, found)
    circles = next(c for c in axes.collections if c.get_label().startswith("true path"))
    shown = mine.power_db >= mine.power_db.max() - 30
    np.testing.assert_allclose(
        np.asarray(circles.get_offsets())[0], np.rad2deg([mine.aoa_az[0], mine.aod_az[0]]), atol=1e-9
    )
    assert len(circles.get_offsets()) == shown.sum()
    np.testing.assert_allclose(axes.lines[0].get_xydata(), np.rad2deg([[0.5, 1.0], [-2.0, 3.0]]))
    assert [text.get_text() for text in axes.texts] == ["1", "2"]
