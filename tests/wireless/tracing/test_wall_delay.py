"""Delay of walls that paths pass, against transfer matrices over frequency that share no code with the tracer."""

import numpy as np
import pytest
from scipy.constants import speed_of_light

from tests.wireless.em.test_fresnel import transfer_matrices
from wireless.channel import Channel
from wireless.em.materials import WALLS
from wireless.tracing.tracer import Tracer, TracerConfig

WALL_NAMES, BANDS_HZ = ("concrete_wall", "partition", "glazing"), (2.44e9, 5.2e9, 28e9)


@pytest.fixture(scope="module")
def one_wall(extruded):
    """A long wall along y, without floor or ceiling in reach."""
    return extruded(np.array([[(0.0, -40.0), (0.0, 40.0)]]))


def trace_through(one_wall, name, frequency_hz, angle, **options):
    """The direct path of 6 m through a wall, at an angle from its normal."""
    step = 3 * np.array([np.cos(angle), np.sin(angle), 0])
    config = TracerConfig(max_reflections=0, diffraction=False, max_transmissions=1, **options)
    tracer = Tracer(one_wall, materials=(name,), frequency_hz=frequency_hz, config=config)
    height = np.array([0, 0, 1.5])
    return tracer.trace((height - step)[None], (height + step)[None])


def expected_response(name, frequency_hz, angle, polarisation):
    """Field behind a wall over that of 1 m of air, 6 m away, at each frequency, with its permittivities there."""
    response = []
    for f in np.atleast_1d(frequency_hz):
        layers = []
        for layer in WALLS[name].layers:
            eps_r, sigma = layer.properties(f)
            layers.append((eps_r - 1j * sigma / (2 * np.pi * f * 8.8541878128e-12), layer.thickness_m))
        _, through = transfer_matrices(angle, layers, f, polarisation)
        outside_m = 6 - sum(d for _, d in layers) * np.cos(angle)
        response.append(through * np.exp(-2j * np.pi * f * outside_m / speed_of_light))
    return np.array(response)


@pytest.mark.parametrize("polarisation", ["te", "tm"])
@pytest.mark.parametrize("frequency_hz", BANDS_HZ)
@pytest.mark.parametrize("name", WALL_NAMES)
@pytest.mark.parametrize("degrees", [0, 45, 60])
def test_delay_of_a_wall_is_the_slope_of_its_phase(one_wall, name, frequency_hz, degrees, polarisation):
    """Group delay within 1 % of what the wall adds, or 1 ps: permittivities change little over the slope's band."""
    angle, option = np.radians(degrees), {"te": "vertical", "tm": "horizontal"}[polarisation]
    paths = trace_through(one_wall, name, frequency_hz, angle, polarisation=option)
    step_hz = 1e5
    response = expected_response(name, frequency_hz + step_hz * np.array([-1, 1]), angle, polarisation)
    slope_s = -np.angle(
        response[1] * np.conj(response[0]) * np.exp(4j * np.pi * step_hz * 6 / speed_of_light)
    )
    added_s = slope_s / (4 * np.pi * step_hz)
    assert len(paths) == 1 and added_s != 0
    np.testing.assert_allclose(paths.delay_s[0] - 6 / speed_of_light, added_s, rtol=0.01, atol=1e-12)


@pytest.mark.parametrize("degrees", [0, 45, 60])
@pytest.mark.parametrize("name", WALL_NAMES)
def test_response_over_frequency_is_that_of_the_wall(one_wall, name, degrees):
    """Over 20 MHz at 5.2 GHz, phases within 1 degree; without the wall's delay concrete is 3 degrees off."""
    angle, carrier_hz = np.radians(degrees), 5.2e9
    offset_hz = np.linspace(-10e6, 10e6, 21)
    paths = trace_through(one_wall, name, carrier_hz, angle, polarisation="vertical")
    got = Channel.from_paths(paths).cfr(offset_hz)[0, 0, 0, 0]
    want = expected_response(name, carrier_hz + offset_hz, angle, "te")
    off = np.angle(got / want)
    assert np.abs(off - off[10]).max() < np.radians(1.0)
    assert np.abs(off[10]) < 1e-6 and np.abs(got[10]) == pytest.approx(
        np.abs(want[10]) * speed_of_light / carrier_hz / (4 * np.pi * 6), rel=1e-6
    )


def test_two_faces_of_a_wall_delay_a_path_once(extruded, ring):
    """A wall drawn with two faces delays a path as one drawn as a line does."""
    outer = ring((-4, -4), (4, -4), (4, 4), (-4, 4))
    line = extruded(np.concatenate([outer, [[(0.0, -4.0), (0.0, 4.0)]]]))
    faces = extruded(np.concatenate([outer, ring((-0.1, -4), (0.1, -4), (0.1, 4), (-0.1, 4))]))
    delay = []
    for mesh in (line, faces):
        config = TracerConfig(max_reflections=0, diffraction=False, max_transmissions=1)
        tracer = Tracer(mesh, materials=("concrete_wall",), frequency_hz=5.2e9, config=config)
        paths = tracer.trace([[-2, 0.1, 1.5]], [[2, 1.3, 1.5]])
        delay.append(paths.delay_s[0])
    assert delay[0] == pytest.approx(delay[1], abs=1e-15)
    assert delay[0] - np.hypot(4, 1.2) / speed_of_light > 0.5e-9


def test_paths_that_pass_no_wall_have_the_delay_of_their_length(one_wall):
    """A reflected path takes its unfolded length over the speed of light, exactly as before walls."""
    tracer = Tracer(one_wall, materials=("concrete_wall",), frequency_hz=5.2e9)
    paths = tracer.trace([[-2, 0, 1.5]], [[-2, 3, 1.5]])
    once = np.flatnonzero((paths.order == 1) & (paths.interaction[:, 0] == 1))
    np.testing.assert_allclose(paths.delay_s[once], 5 / speed_of_light, rtol=1e-15)
    assert len(once) == 1
