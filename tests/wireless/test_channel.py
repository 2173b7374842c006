"""Channels against closed forms, a second trace with moved antennas, and the formulas of Sionna RT and DeepMIMO."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.constants import speed_of_light
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from robosim.building.building import make_building
from tests.plans import two_rooms
from wireless import Array, Channel, MountedArray, Paths, Tracer, TracerConfig, subcarriers, uniform_array
from wireless.antennas.elements import IsotropicElement, SectorElement
from wireless.motion.blockage import block
from wireless.motion.bodies import PERSON_HEIGHT_M, PERSON_RADIUS_M, people

FREQUENCY_HZ = 28e9
WAVE_M = speed_of_light / FREQUENCY_HZ


def made_of(gain, delay_s, n_rx=1, rx=None, **angles):
    """Paths of one transmitter with gains from theta to theta, in the order of their links."""
    n = len(gain)
    matrix = np.zeros((n, 2, 2), complex)
    matrix[:, 0, 0] = gain
    names = ("aoa_az", "aoa_el", "aod_az", "aod_el")
    return Paths(
        tx_position=np.zeros((1, 3)),
        rx_position=np.ones((n_rx, 3)),
        frequency_hz=FREQUENCY_HZ,
        tx=np.zeros(n, int),
        rx=np.zeros(n, int) if rx is None else np.array(rx),
        gain=matrix,
        power=np.abs(gain) ** 2,
        delay_s=np.array(delay_s, float),
        **{name: np.array(angles.get(name, np.zeros(n)), float) for name in names},
        order=np.zeros(n, np.uint8),
        interaction=np.zeros((n, 1), np.uint8),
        primitive=np.full((n, 1), -1),
        point=np.zeros((n, 1, 3)),
    )


@pytest.fixture(scope="module")
def tracer(extruded, ring):
    """A room of 6 m x 4 m with floor and ceiling."""
    mesh = extruded(ring((0, 0), (6, 0), (6, 4), (0, 4)), floor=True, ceiling=True)
    return Tracer(mesh, frequency_hz=FREQUENCY_HZ, config=TracerConfig(floor_ceiling=True, max_reflections=2))


@pytest.fixture(scope="module")
def traced(tracer):
    """All paths from two transmitters to three receivers, one of which is outside, without paths."""
    tx = np.array([[1.0, 1.4, 1.5], [4.0, 3.1, 1.2]])
    return tracer.trace(tx, np.array([[5.0, 0.9, 1.5], [20.0, 20.0, 1.0], [2.5, 1.2, 2.0]]))


def test_free_path_is_a_line_in_phase(tracer):
    """One path: |H| = lambda / (4 pi d), phase -2 pi (f_c + f) d / c, to 1e-9 rad, at 1001 frequencies."""
    tx, rx = np.array([[1.0, 1.0, 1.5]]), np.array([[4.0, 3.0, 1.5]])
    paths = tracer.trace(tx, rx).strongest()
    far = np.linalg.norm(rx - tx)
    offset = np.linspace(-2e9, 2e9, 1001)
    got = Channel.from_paths(paths).cfr(offset)[0, 0, 0, 0]
    want = WAVE_M / (4 * np.pi * far) * np.exp(-2j * np.pi * (FREQUENCY_HZ + offset) * far / speed_of_light)
    np.testing.assert_allclose(got, want, rtol=1e-9)


def test_two_rays():
    """|H|^2 = a^2 + b^2 + 2 a b cos(2 pi f d - arg b); spread a b d / (a^2 + b^2); powers with and without phases."""
    a, b, apart = 1e-3, 0.6e-3 * np.exp(0.7j), 23e-9
    channel = Channel.from_paths(made_of(np.array([a, b]), [100e-9, 100e-9 + apart]))
    offset = subcarriers(257, 1e6)
    want = a**2 + abs(b) ** 2 + 2 * a * abs(b) * np.cos(2 * np.pi * offset * apart - np.angle(b))
    np.testing.assert_allclose(np.abs(channel.cfr(offset)[0, 0, 0, 0]) ** 2, want, rtol=1e-10)
    assert channel.power(coherent=True)[0, 0, 0, 0] == pytest.approx(abs(a + b) ** 2, rel=1e-12)
    assert channel.power(coherent=False)[0, 0, 0, 0] == pytest.approx(a**2 + abs(b) ** 2, rel=1e-12)
    spread = a * abs(b) * apart / (a**2 + abs(b) ** 2)
    assert channel.delay_spread_s()[0, 0] == pytest.approx(spread, rel=1e-9)
    np.testing.assert_allclose(channel.synchronised().cir()[1][0, 0], [0, apart], atol=1e-20)


def test_taps_are_the_frequency_response_in_the_band(traced):
    """Parseval: with all taps, energy and spectrum are those of the frequency response between -W/2 and W/2.

    The square sum of a sinc beyond n taps falls as 1 / n: bound 1e-4 with 20,000 taps (measured 1.0e-5).
    """
    channel, bandwidth = Channel.from_paths(traced), 200e6
    number = np.arange(-10_000, 10_001)
    taps = channel.taps(bandwidth, -10_000, 10_000)
    dense, weight = np.polynomial.legendre.leggauss(200)
    response = channel.cfr(dense * bandwidth / 2)
    np.testing.assert_allclose(
        (np.abs(taps) ** 2).sum(axis=-1), (np.abs(response) ** 2 * weight / 2).sum(axis=-1), rtol=1e-4
    )
    inner = subcarriers(16, bandwidth / 20)
    spectrum = taps @ np.exp(-2j * np.pi * np.outer(number, inner / bandwidth))
    np.testing.assert_allclose(spectrum, channel.cfr(inner), atol=1e-4 * np.abs(response).max())


def test_whole_delays_give_whole_taps():
    """A path of 8 samples of delay is tap 8 alone; by default taps go from 6 before to 6 after."""
    channel = Channel.from_paths(made_of(np.array([0.5j]), [0.125]))
    np.testing.assert_allclose(channel.taps(64.0)[0, 0, 0, 0], 0.5j * (np.arange(2, 15) == 8), atol=1e-12)


def test_formulas_of_sionna_and_deepmimo(traced):
    """`cir_to_ofdm_channel`, `cir_to_time_channel` and DeepMIMO's OFDM channel, path by path, to 1e-10 of the largest.

    Sionna RT: sum a exp(-j 2 pi f tau) at centred subcarriers, sum a sinc(l - W tau). DeepMIMO 4, with power and phase
    of each path: sum sqrt(P / N) exp(j phase) exp(-j 2 pi k W tau / N), k from 0 to N - 1. The packages themselves, in
    32 bits, on identical paths: Sionna RT 2.2.0 differs by 8e-7 in the frequency response (also over time, if delays
    stay), by 3e-7 in taps, by 1.4e-6 in coefficients of turned 2 x 2 arrays of slanted 3GPP pairs; DeepMIMO 4.0.5
    differs by 3e-6.
    """
    count, spacing = 52, 312.5e3
    channel = Channel.from_paths(traced)
    got = channel.cfr(subcarriers(count, spacing))[:, :, 0, 0]
    unsigned = channel.cfr(np.arange(count) * spacing)[:, :, 0, 0] / np.sqrt(count)
    taps = channel.taps(200e6, -6, 40)[:, :, 0, 0]
    want, other, sampled = np.zeros_like(got), np.zeros_like(got), np.zeros_like(taps)
    for i in range(len(traced)):
        link, tau, gain = (traced.tx[i], traced.rx[i]), traced.delay_s[i], traced.gain[i, 0, 0]
        for k in range(count):
            want[*link, k] += gain * np.exp(-2j * np.pi * (k - count // 2) * spacing * tau)
            bandwidth = count * spacing
            phasor = np.sqrt(abs(gain) ** 2 / count) * np.exp(1j * np.angle(gain))
            other[*link, k] += phasor * np.exp(-2j * np.pi * k * bandwidth * tau / count)
        for k in range(47):
            x = np.pi * (k - 6 - 200e6 * tau)
            sampled[*link, k] += gain * np.sin(x) / x
    for mine, theirs in ((got, want), (unsigned, other), (taps, sampled)):
        np.testing.assert_allclose(mine, theirs, atol=1e-10 * np.abs(theirs).max())


def test_impulse_response_holds_all_paths(traced):
    """Its response is that of the channel; places beyond the last path are empty, as is the link without paths."""
    channel = Channel.from_paths(traced, rx=MountedArray(array=uniform_array(2, element="3gpp")))
    coefficient, delay = channel.cir()
    assert np.isfinite(delay).sum(axis=-1).tolist() == traced.count().tolist()
    offset = np.array([0.0, 3e7])
    turn = np.exp(-2j * np.pi * offset * np.nan_to_num(delay)[..., None])
    np.testing.assert_allclose(
        np.einsum("abrtm,abmf->abrtf", coefficient, turn), channel.cfr(offset), atol=1e-15
    )
    assert not channel.cfr(offset)[:, 1].any()
    table = channel.to_table()
    assert (
        table.num_rows == 6
        and np.isnan(table["delay_spread_s"].to_numpy()).tolist() == [False, True, False] * 2
    )
    assert np.isneginf(table["gain_coherent_db"].to_numpy()[1])


def test_no_paths_make_an_empty_channel(traced):
    """Zeros of the shapes of any other channel, and spreads that are NaN."""
    empty = Channel.from_paths(traced.select(np.zeros(len(traced), bool)))
    assert empty.cir()[0].shape == (2, 3, 1, 1, 0) and empty.taps(1e8).shape == (2, 3, 1, 1, 13)
    assert not empty.cfr(np.zeros(4)).any() and not empty.power(coherent=True).any()
    assert np.isnan(empty.delay_spread_s()).all() and np.isnan(empty.angular_spread_rad("aod_az")).all()
    assert len(empty.synchronised().at(1.0).paths) == 0


@pytest.mark.parametrize("end", ["tx", "rx"])
def test_ports_are_where_a_second_trace_has_them(tracer, end):
    """Coefficients of ports off the centre are traced gains of antennas moved there, of the five strongest paths.

    An array yawed by 90 degrees and pitched by 30: its x is (0, cos, -sin), its y is -x of the scene. A plane
    wave errs by pi s^2 / (lambda d): bound 0.02 rad for s below a wavelength and d from 3 m on.
    """
    places = {"tx": np.array([[1.0, 1.4, 1.5]]), "rx": np.array([[5.0, 0.9, 1.2]])}
    position_wl = np.array([[0.0, 0.0, 0.0], [0.9, 0.0, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 0.9]])
    array = Array(element=IsotropicElement(), position_wl=position_wl)
    mounted = MountedArray(array=array, yaw_rad=np.pi / 2, pitch_rad=np.pi / 6)
    paths = tracer.trace(**places).strongest(5)
    channel = Channel.from_paths(paths, **{end: mounted})
    low, high = np.sin(np.pi / 6), np.cos(np.pi / 6)
    axes = np.array([[0, high, -low], [-1, 0, 0], [0, low, high]])
    for port, shift in enumerate(WAVE_M * position_wl @ axes):
        second = tracer.trace(**{**places, end: places[end] + shift})
        for i in range(len(paths)):
            same = (second.primitive == paths.primitive[i]).all(axis=1)
            want = second.delay_s[same][0] - paths.delay_s[i]
            coefficient = channel.coefficient[i].ravel()
            phase = np.angle(coefficient[port] / coefficient[0] * np.exp(2j * np.pi * FREQUENCY_HZ * want))
            assert abs(phase) < 0.02


class ShortDipole:
    """Field sqrt(1 - z^2) of a short dipole along z: directivity 3/2 at its side."""

    def amplitude(self, direction):
        return np.sqrt(np.maximum(0, 1 - direction[..., 2] ** 2))


def test_turned_dipoles_see_each_other_by_their_axes(tracer):
    """In free space between short dipoles with axes a and b: 3/2 lambda / (4 pi d) a.(1 - u u^T).b, turned at random.

    Bound 1e-9; a wrong order of turns, or a wrong sign of a polarisation, errs by its own size. Slanted ports: the axis
    turned about the direction straight ahead.
    """
    rng = np.random.default_rng(3)
    array = Array(element=ShortDipole(), position_wl=np.zeros((1, 3)))
    paths = tracer.trace(np.array([[1.0, 1.0, 1.0]]), np.array([[4.5, 3.0, 2.0]])).strongest()
    u = np.array([3.5, 2.0, 1.0])
    far, u = np.linalg.norm(u), u / np.linalg.norm(u)
    for _ in range(20):
        angles = rng.uniform(-np.pi, np.pi, (2, 3))
        ends = [
            MountedArray(array=array, yaw_rad=yaw, pitch_rad=pitch, roll_rad=roll)
            for yaw, pitch, roll in angles.tolist()
        ]
        got = Channel.from_paths(paths, tx=ends[0], rx=ends[1]).coefficient[0, 0, 0]
        a, b = (Rotation.from_euler("ZYX", one).apply([0, 0, 1]) for one in angles)
        want = 1.5 * WAVE_M / (4 * np.pi * far) * (a @ b - (a @ u) * (b @ u))
        assert got == pytest.approx(want * np.exp(-2j * np.pi * far / WAVE_M), abs=1e-9)


def test_turned_dipole_receives_both_polarisations(traced):
    """Along axis a it receives -a.theta of the field along theta and -a.phi of that along phi, also of reflections."""
    array = Array(element=ShortDipole(), position_wl=np.zeros((1, 3)))
    azimuth, elevation = traced.aoa_az, traced.aoa_el
    theta = [np.sin(elevation) * np.cos(azimuth), np.sin(elevation) * np.sin(azimuth), -np.cos(elevation)]
    phi = [-np.sin(azimuth), np.cos(azimuth), np.zeros(len(traced))]
    for angles in np.random.default_rng(4).uniform(-np.pi, np.pi, (5, 3)):
        yaw, pitch, roll = angles.tolist()
        mounted = MountedArray(array=array, yaw_rad=yaw, pitch_rad=pitch, roll_rad=roll)
        axis = Rotation.from_euler("ZYX", angles).apply([0, 0, 1])
        along = -np.sqrt(1.5) * np.stack([axis @ theta, axis @ phi], axis=1)
        want = (along * traced.gain[:, :, 0]).sum(axis=1)
        got = Channel.from_paths(traced, rx=mounted).coefficient[:, 0, 0]
        np.testing.assert_allclose(got, want, atol=1e-9 * np.abs(want).max())


def test_vertical_and_horizontal_ports_have_the_gain_itself(traced):
    """Not turned, they lie along theta and phi; paths that turn the polarisation have matrices without symmetry."""
    pair = Array(element=IsotropicElement(), position_wl=np.zeros((2, 3)))
    ends = MountedArray(array=pair, slant_rad=np.array([0.0, np.pi / 2]))
    got = Channel.from_paths(traced, tx=ends, rx=ends).coefficient
    np.testing.assert_allclose(got, traced.gain, atol=1e-12 * np.abs(traced.gain).max())
    assert np.abs(got[:, 0, 1] - got[:, 1, 0]).max() > 1e-3 * np.abs(got).max()


def test_slanted_ports_share_the_power(tracer):
    """Facing each other, ports of +-45 degrees: the two of one slant do not see each other, for they are mirrored."""
    pair = Array(element=IsotropicElement(), position_wl=np.zeros((2, 3)))
    slant = np.array([np.pi / 4, -np.pi / 4])
    paths = tracer.trace(np.array([[1.0, 2.0, 1.5]]), np.array([[4.0, 2.0, 1.5]])).strongest()
    got = Channel.from_paths(
        paths,
        tx=MountedArray(array=pair, slant_rad=slant),
        rx=MountedArray(array=pair, slant_rad=slant, yaw_rad=np.pi),
    ).power(coherent=True)[0, 0]
    np.testing.assert_allclose(got / paths.power[0], [[0, 1], [1, 0]], atol=1e-12)


def test_each_terminal_has_its_own_heading(traced):
    """Sectors that face the first path receive it with the directivity of their pattern; turned away, 30 dB less."""
    strongest = traced.strongest().select(traced.strongest().rx == 0)
    array = uniform_array(1, element=SectorElement())
    yaw = np.zeros(3)
    facing = replace(strongest, aoa_el=np.zeros(2)).select(np.array([0]))
    yaw[0] = facing.aoa_az[0]
    powers = [
        Channel.from_paths(facing, rx=MountedArray(array=array, yaw_rad=turned)).power(coherent=True)[
            0, 0, 0, 0
        ]
        for turned in (yaw, yaw + np.pi)
    ]
    assert 10 * np.log10(powers[0] / powers[1]) == pytest.approx(30, abs=1e-6)
    given = MountedArray(array=array, yaw_rad=yaw, scaling="given")
    assert Channel.from_paths(facing, rx=given).power(coherent=True)[0, 0, 0, 0] == pytest.approx(
        facing.power[0]
    )
    for count in (2, 4):
        with pytest.raises(ValueError, match=f"turned by {count} angles, expected one for each of 3"):
            Channel.from_paths(traced, rx=MountedArray(yaw_rad=np.zeros(count)))


def test_channel_does_not_depend_on_the_order_of_paths(traced):
    """By delay, links mixed: responses to 1e-12, link states and strongest paths are those of the tracer's order."""
    mixed = traced.select(np.argsort(-traced.delay_s))
    assert (np.diff(mixed.link) < 0).any()
    np.testing.assert_array_equal(mixed.link_state(), traced.link_state())
    np.testing.assert_array_equal(np.sort(mixed.strongest().power), np.sort(traced.strongest().power))
    for got, expected in zip(
        (Channel.from_paths(mixed).cfr([0.0, 1e7]), *Channel.from_paths(mixed).cir()),
        (Channel.from_paths(traced).cfr([0.0, 1e7]), *Channel.from_paths(traced).cir()),
        strict=True,
    ):
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12 * np.nanmax(np.abs(expected)))


def test_coupled_ports_are_those_of_measurements(traced):
    """The scaling `coupled` is the array's signature; for isotropic ports half a wave apart it changes nothing."""
    line = uniform_array(4, element="isotropic")
    plain, coupled = (
        Channel.from_paths(traced, rx=MountedArray(array=line, scaling=scaling)).coefficient
        for scaling in ("directivity", "coupled")
    )
    np.testing.assert_allclose(plain, coupled, rtol=1e-9)


def test_later_channel_is_that_of_a_moved_receiver(tracer):
    """After 10 ms at 1 m/s, phases of a new trace 1 cm on, of all paths: bound 0.02 rad, out of 5.9 rad."""
    tx, rx, velocity = np.array([[1.0, 1.4, 1.5]]), np.array([[5.0, 0.9, 1.2]]), np.array([-0.6, 0.8, 0.0])
    paths = tracer.trace(tx, rx).strongest(8)
    later = Channel.from_paths(paths, doppler_hz=paths.doppler_hz(rx_velocity=velocity)).at(0.01)
    second = tracer.trace(tx, rx + 0.01 * velocity)
    for i in range(len(paths)):
        same = second.select((second.primitive == paths.primitive[i]).all(axis=1))
        assert abs(np.angle(later.coefficient[i, 0, 0] / same.gain[0, 0, 0])) < 0.02
        assert later.paths.delay_s[i] == pytest.approx(same.delay_s[0], abs=1e-13)


def test_angular_spread_of_a_wrapped_normal_distribution():
    """Its mean resultant is exp(-s^2 / 2), so that the circular deviation is s, wherever its centre: to 1e-6 rad."""
    s = 0.35
    angle = np.linspace(-8 * s, 8 * s, 2001)
    gain = np.sqrt(norm.pdf(angle, scale=s)).astype(complex)
    for centre in (0.0, 2.0, np.pi):
        wrapped = (angle + centre + np.pi) % (2 * np.pi) - np.pi
        channel = Channel.from_paths(made_of(gain, np.zeros(len(gain)), aoa_az=wrapped))
        assert channel.angular_spread_rad("aoa_az")[0, 0] == pytest.approx(s, abs=1e-6)
        assert channel.angular_spread_rad("aod_el")[0, 0] < 1e-6


def test_subcarriers_and_bad_arguments():
    """Even numbers of subcarriers begin half of them below the carrier, odd ones lie evenly about it."""
    assert subcarriers(4, 10.0).tolist() == [-20, -10, 0, 10]
    assert subcarriers(5, 10.0).tolist() == [-20, -10, 0, 10, 20]
    channel = Channel.from_paths(made_of(np.ones(1, complex), [0.0]))
    for call, words in (
        (lambda: subcarriers(0, 1.0), "count is 0"),
        (lambda: channel.taps(0.0), "bandwidth_hz is 0"),
        (lambda: channel.taps(np.inf), "bandwidth_hz is inf"),
        (lambda: channel.taps(1e6, 3, 2), "last is 2 and first is 3"),
        (lambda: MountedArray(scaling="best"), "scaling is 'best'"),
        (lambda: MountedArray(slant_rad=np.zeros(2)), r"slant_rad has the shape \(2,\)"),
    ):
        with pytest.raises(ValueError, match=words):
            call()


def test_lists_and_numbers_are_taken_like_arrays():
    """Positions, offsets, bodies and velocities as lists give what arrays give, bit for bit."""
    tracer = Tracer(make_building(two_rooms(0.8)))
    tx, rx = [[1.0, 1.0, 1.5]], [[2.0, 2.0, 1.2], [5, 2, 1]]
    paths = tracer.trace(np.array(tx), np.array(rx))
    np.testing.assert_array_equal(tracer.trace(tx, rx).delay_s, paths.delay_s)
    doppler_hz = paths.doppler_hz(rx_velocity=np.array([1.0, 0, 0]))
    np.testing.assert_array_equal(paths.doppler_hz(rx_velocity=[1, 0, 0]), doppler_hz)
    channel = Channel.from_paths(paths, doppler_hz=list(doppler_hz))
    np.testing.assert_array_equal(channel.cfr([0.0, 1e6]), channel.cfr(np.array([0.0, 1e6])))
    np.testing.assert_array_equal(channel.cfr(0), channel.cfr(np.zeros(1)))
    where = np.array([[1.5, 1.5]])
    for bodies in (
        [[1.5, 1.5]],
        people([[1.5, 1.5]]),
        people([(1.5, 1.5, 0)], radius_m=[PERSON_RADIUS_M], height_m=[PERSON_HEIGHT_M]),
    ):
        np.testing.assert_array_equal(block(paths, bodies)[0].power, block(paths, people(where))[0].power)
    assert len(people([])) == 0
    with pytest.raises(ValueError, match=r"tx is .*, expected numbers in an array or lists"):
        tracer.trace([[0, 0], [1]], rx)
    with pytest.raises(ValueError, match=r"position of bodies has shape \(2,\)"):
        people([1.0, 2.0])
