"""Path estimators against the Cramér-Rao bound, and where there is little, much or nothing to find."""

import copy

import numpy as np
import pytest

from tests.wireless.sounding.arrival_bounds import arrival_bound_rad, departure_bound_rad, window_share
from wireless.antennas.codebook import terminal_named
from wireless.estimates import PathEstimates, wrapped
from wireless.estimation.estimators import ESTIMATORS, estimator_named
from wireless.estimation.sage import SageEstimator
from wireless.sounding.sounder import Rays, Sounder


@pytest.fixture(scope="module")
def sounder():
    """The reference's base station sends, its robot listens."""
    return Sounder(terminal_named("gnb"), terminal_named("ue"))


@pytest.fixture(scope="module")
def sage(sounder):
    return SageEstimator(sounder, workers=1)


def links(sounder, n, snr_db, aoa, aod, delay=0.0):
    """The same paths n times: energies in the whole measurement [dB], azimuths [rad], delays [samples]."""
    snr_db, aoa, aod, delay = np.broadcast_arrays(*map(np.atleast_1d, (snr_db, aoa, aod, delay)))
    aoa, aod = aoa.astype(float), aod.astype(float)
    energy = np.sum(np.abs(sounder.rx_response(aoa)) ** 2, axis=1)
    energy *= np.sum(np.abs(sounder.tx_response(aod)) ** 2, axis=1)
    gain = 10 ** ((snr_db - sounder.config.snr_per_gain_db) / 20) / np.sqrt(energy)
    columns = {
        "gain": gain + 0j,
        "delay_s": delay * sounder.config.sample_s + 1e-8,
        "aoa_az": aoa,
        "aoa_el": 0 * aoa,
        "aod_az": aod,
        "aod_el": 0 * aod,
    }
    return Rays(**{name: np.tile(value, (n, 1)) for name, value in columns.items()})


def bounds_rad(sounder, snr_db, aoa, aod):
    """Cramér-Rao bounds on arrival and departure, for energies over all delays."""
    in_window_db = snr_db + 10 * np.log10(window_share(sounder))
    return [
        float(bound(sounder, np.array([azimuth]), in_window_db)[0])
        for bound, azimuth in ((arrival_bound_rad, aoa), (departure_bound_rad, aod))
    ]


def budget_db(sounder, energy_db, aoa, aod):
    """SNR of a path by the link budget, arrays looking straight at it: beam 0 and array 0 face 0."""
    aoa, aod, straight = np.array([aoa]), np.array([aod]), np.zeros(1)
    spread = sounder.rx.platform.directivity(aoa).sum() * np.sum(np.abs(sounder.tx.beam_response(aod)) ** 2)
    facing = (
        sounder.rx.platform.directivity(straight)[0, 0]
        * np.abs(sounder.tx.beam_response(straight)[0, 0]) ** 2
    )
    return energy_db + 10 * np.log10(facing / spread / sounder.config.n_samples)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("snr_db", [30.0, 40.0, 80.0])
@pytest.mark.parametrize("aoa_deg", [0.0, 37.0, 60.0, -180.0, -93.0])
def test_single_paths_are_as_sharp_as_the_bound(sounder, sage, snr_db, aoa_deg):
    """Root mean square error of arrival and departure within 1.5 dB (a factor 1.19) of the Cramér-Rao bound."""
    aoa, aod = np.deg2rad(aoa_deg), np.deg2rad(25.0)
    true = links(sounder, 300, snr_db, aoa, aod)
    got = sage.estimate(sounder.measure(true, np.random.default_rng(11)))
    assert np.all(got.count >= 1)
    bound = bounds_rad(sounder, snr_db, aoa, aod)
    assert rms(wrapped(got.aoa_rad[:, 0] - aoa)) < 1.19 * bound[0]
    assert rms(wrapped(got.aod_rad[:, 0] - aod)) < 1.19 * bound[1]
    assert rms(wrapped(got.aoa_rad[:, 0] - aoa)) > 0.8 * bound[0]
    np.testing.assert_allclose(got.snr_db[:, 0].mean(), budget_db(sounder, snr_db, aoa, aod), atol=0.5)


def test_there_is_no_bias_at_seams(sounder, sage):
    """Mean error over azimuths around where two arrays take turns: below a fifth of the bound's spread.

    At 40 dB, 25 azimuths from 48 to 72 degrees, 100 links each.
    """
    azimuths = np.deg2rad(np.linspace(48, 72, 25))
    worst = []
    for i, aoa in enumerate(azimuths):
        true = links(sounder, 100, 40.0, aoa, 0.3)
        got = sage.estimate(sounder.measure(true, np.random.default_rng(i)))
        spread = bounds_rad(sounder, 40.0, aoa, 0.3)[0]
        worst.append(np.mean(wrapped(got.aoa_rad[:, 0] - aoa)) / spread)
    assert abs(np.mean(worst)) < 0.2
    assert np.abs(worst).max() < 0.6  # 4.5 standard deviations and a little bias


@pytest.mark.parametrize(("rate", "names"), [(0.1, ("gnb", "ue")), (0.01, ("ue", "gnb"))])
def test_false_alarms_come_at_the_rate_set(names, rate):
    """Links without a path: the share in which one is found is the rate, within 4 standard deviations + 20 %."""
    sounder = Sounder(*map(terminal_named, names))
    estimator = SageEstimator(sounder, false_alarm_rate=rate)
    n = 4000
    got = estimator.estimate(sounder.measure(links(sounder, n, -300.0, 0.0, 0.0), np.random.default_rng(1)))
    share = np.mean(got.count > 0)
    assert abs(share - rate) < 4 * np.sqrt(rate / n) + 0.2 * rate


@pytest.mark.parametrize("snr_db", [40.0, 80.0])
@pytest.mark.parametrize("apart", [(0.0, 30.0), (3.0, 0.0), (1.5, 15.0)])
def test_two_paths_come_apart_in_angle_or_delay(sounder, sage, snr_db, apart):
    """Two coherent paths of equal power, apart by samples or degrees: both found, no third, errors small.

    Departures differ by 4 degrees. Errors of arrival: 90 % of links within 4 bounds of a lone path, which
    the overlap of the paths widens.
    """
    delay, angle = apart
    aoa, aod = np.deg2rad([10.0, 10.0 + angle]), np.deg2rad([20.0, 24.0])
    true = links(sounder, 100, snr_db, aoa, aod, np.array([0.0, delay]))
    got = sage.estimate(sounder.measure(true, np.random.default_rng(3)))
    assert np.mean(got.count == 2) > 0.95
    spread = bounds_rad(sounder, snr_db, aoa[0], aod[0])[0]
    both = wrapped(got.aoa_rad[:, :2, None] - aoa)
    nearest = np.abs(both).min(axis=1)
    assert np.quantile(nearest, 0.9) < 4 * spread if angle else np.quantile(np.abs(both), 0.9) < 4 * spread


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("snr_db", [-300.0, -20.0, 10.0, 80.0, 120.0])
def test_every_estimate_is_a_number(sounder, sage, name, snr_db):
    """From silence to 120 dB, one path, on a beam or off, or four at one place: finite, no more paths than are."""
    rng = np.random.default_rng(2)
    estimator = sage if name == "sage" else estimator_named(name, sounder)
    for angles in ([np.pi / 12], [0.3, 0.3, 0.3, 0.3], np.deg2rad([15.0, 30.0])):
        true = links(sounder, 40, snr_db, np.asarray(angles), 0.2)
        got = estimator.estimate(sounder.measure(true, rng))
        for column in (got.aoa_rad, got.aod_rad, got.delay_s):
            assert np.all(np.isfinite(column))
        assert not np.any(np.isnan(got.snr_db))
        assert np.all(np.abs(got.aoa_rad) <= np.pi)
        if name == "sage":
            found = np.arange(5) < got.count[:, None]
            assert np.all(np.isneginf(got.snr_db[~found]))
            assert np.all(np.diff(np.where(found, got.snr_db, -1e3), axis=1) <= 0)
            expected = 0 if snr_db < -10 else len(np.unique(angles))
            assert np.mean(got.count > expected) < (0.35 if expected == 2 else 0.06)
        else:
            assert np.all(got.count == 5)


def test_nothing_at_all_is_no_path(sounder, sage):
    """A tensor of zeros, as before any signal: no path from ours, numbers from the reference's."""
    silence = np.zeros((3, 11, sounder.n_rx, 48), np.complex64)
    assert np.all(sage.estimate(silence).count == 0)
    assert np.all(np.isfinite(estimator_named("pca", sounder).estimate(silence).snr_db))


def test_reference_reads_grids_as_published(sounder, sage):
    """A lone strong path: arrivals within 1.5 degrees, departures on the nearest beam or its neighbour.

    SNR is that of the link budget, within 0.2 dB, and the one ours reads within 0.3 dB.
    """
    rng = np.random.default_rng(4)
    aoa, aod = rng.uniform(-3, 3, 2)
    tensor = sounder.measure(links(sounder, 50, 70.0, aoa, aod), rng)
    got = estimator_named("pca", sounder).estimate(tensor)
    assert np.abs(np.rad2deg(wrapped(got.aoa_rad[:, 0] - aoa))).max() < 1.5
    assert np.abs(np.rad2deg(wrapped(got.aod_rad[:, 0] - aod))).max() < 7.5
    np.testing.assert_allclose(got.snr_db[:, 0], budget_db(sounder, 70.0, aoa, aod), atol=0.2)
    np.testing.assert_allclose(got.snr_db[:, 0], sage.estimate(tensor).snr_db[:, 0], atol=0.3)


def test_workers_do_not_change_an_estimate(sounder, sage):
    """One thread or three: the same numbers."""
    rng = np.random.default_rng(5)
    tensor = sounder.measure(links(sounder, 150, 20.0, np.array([0.1, 1.0]), 0.4), rng)
    one = sage.estimate(tensor)
    other = copy.copy(sage)
    other.workers = 3
    three = other.estimate(tensor)
    assert np.array_equal(one.aoa_rad, three.aoa_rad)
    assert np.array_equal(one.snr_db, three.snr_db)


def test_estimates_turn_with_headings():
    """Scene azimuths are those of the terminal plus its heading; places without a path stay 0."""
    angle = np.array([[3.0, 0.0]])
    got = PathEstimates(
        aoa_rad=angle,
        aod_rad=-angle,
        snr_db=np.array([[20.0, -np.inf]]),
        delay_s=np.zeros((1, 2)),
        count=np.array([1]),
    ).turned(rx_heading_rad=1.0, tx_heading_rad=np.array([0.5]))
    np.testing.assert_allclose(got.aoa_rad, [[4.0 - 2 * np.pi, 0.0]])
    np.testing.assert_allclose(got.aod_rad, [[-2.5, 0.0]])


def test_bad_requests_are_named(sounder):
    """Names and rates that do not exist."""
    with pytest.raises(ValueError, match=r"'music'. Known: pca, sage"):
        estimator_named("music", sounder)
    shorter = np.zeros((1, 5, sounder.n_rx, 48), np.complex64)
    for name in ("pca", "sage"):
        with pytest.raises(ValueError, match=r"tensor has shape \(1, 5, .*, expected \(links, 11, "):
            estimator_named(name, sounder).estimate(shorter)
    with pytest.raises(ValueError, match="false_alarm_rate is 1"):
        SageEstimator(sounder, false_alarm_rate=1.0)


def test_named_estimators_take_the_rate_asked_for(sounder, sage):
    """`sage` at 30 % false alarms accepts weaker paths than at 1 %; `pca` knows no rate, and says so."""
    assert estimator_named("sage", sounder, false_alarm_rate=0.3).threshold < sage.threshold
    with pytest.raises(ValueError, match=r"false_alarm_rate is 0\.3, but 'pca' returns"):
        estimator_named("pca", sounder, false_alarm_rate=0.3)


def test_paths_beyond_the_requested_number_do_not_disturb(sounder):
    """One path of six is requested, some 20 degrees apart, at most 4 dB weaker: the strongest comes as it is."""
    aoa = np.deg2rad([0.0, 20.0, -18.0, 40.0, -37.0, 60.0])
    aod = np.deg2rad([0.0, 8.0, -7.0, 15.0, -16.0, 23.0])
    true = links(
        sounder, 40, [70.0, 69.0, 68.0, 67.5, 67.0, 66.0], aoa, aod, [0.0, 0.3, -0.4, 0.8, 1.0, -1.1]
    )
    tensor = sounder.measure(true, np.random.default_rng(3), workers=1)
    got = SageEstimator(sounder, n_paths=1, workers=1).estimate(tensor)
    assert np.all(got.count == 1)
    assert np.rad2deg(rms(wrapped(got.aoa_rad[:, 0] - aoa[0]))) < 0.05


def test_what_arrays_see_of_a_path_is_read_from_its_curves(sounder, sage):
    """SNR as `Sounder.snr_db` gives it from the arrays' own responses at the estimated angles."""
    rng = np.random.default_rng(3)
    aoa, aod = rng.uniform(-np.pi, np.pi, (2, 3))
    tensor = sounder.measure(links(sounder, 40, [60, 50, 40], aoa, aod, [0, 3, -4]), rng, workers=1)
    at, energy, seen, count = sage._find(tensor, sage.threshold, 12)
    found = np.arange(12) < count[:, None]
    assert found.sum() > 100
    turn = at[found][:, 1:] * (2 * np.pi / 360)
    from_responses = sounder.snr_db(energy[found], turn[:, 0], turn[:, 1])
    assert np.abs(sounder.snr_of_seen_db(energy[found], seen[found]) - from_responses).max() < 1e-4
