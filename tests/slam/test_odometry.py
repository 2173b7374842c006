"""What is known of odometry's errors: found by a calibration, and followed while driving."""

import numpy as np
import pytest

from slam.actions import MOVES, Action, Velocity
from slam.odometry import ActionError, OdometryConfig, OdometryCorrector, calibrated

F, L, R = Action.FORWARD, Action.LEFT, Action.RIGHT
MEAN = np.array([0.002, 0.02, 0.0035])
COVARIANCE = np.array([[4e-6, 1e-6, 1e-6], [1e-6, 9e-6, 0], [1e-6, 0, 2.25e-6]])


def samples(rng, n, mean=MEAN):
    return rng.multivariate_normal(mean, COVARIANCE, n)


def test_a_calibration_finds_mean_and_covariance():
    """2,000 runs: means within 4 standard errors, standard deviations and correlations within 10 %."""
    rng = np.random.default_rng(0)
    found = calibrated({action: samples(rng, 2000) for action in MOVES})
    assert found.runs == 2000
    deviation = np.sqrt(np.diag(COVARIANCE))
    for error in found.of_actions:
        assert (np.abs(np.array(error.mean) - MEAN) < 4 * deviation / np.sqrt(2000)).all()
        np.testing.assert_allclose(np.sqrt(np.diag(error.covariance)), deviation, rtol=0.1)
        scaled = np.array(error.covariance) / np.outer(deviation, deviation)
        np.testing.assert_allclose(scaled, COVARIANCE / np.outer(deviation, deviation), atol=0.1)


def test_the_covariance_of_the_mean_is_correct():
    """Over many calibrations of 25 runs, errors of the mean are as large as the stored covariance."""
    rng = np.random.default_rng(1)
    errors, covariances = [], []
    for _ in range(400):
        corrector = OdometryCorrector(calibrated({action: samples(rng, 25) for action in MOVES}))
        errors.append(corrector.bias[L] - MEAN)
        covariances.append(corrector.bias_covariance[L])
    spread = np.mean([e @ np.linalg.solve(c, e) for e, c in zip(errors, covariances, strict=True)])
    # Hotelling's T^2 of 25 samples: 3 * 24 / 21.
    assert spread == pytest.approx(3 * 24 / (25 - 3 - 1), rel=0.15)


def test_too_few_runs_are_rejected():
    runs = {action: np.zeros((9, 3)) for action in MOVES}
    with pytest.raises(ValueError, match="forward was run 9 times"):
        calibrated(runs)


def test_odometry_without_errors_is_believed():
    """To a micrometre and a microradian, with no number that is none."""
    corrector = OdometryCorrector(calibrated({action: np.zeros((20, 3)) for action in MOVES}))
    displacement, covariance = corrector.correct(F, np.array([0.25, 0, 0]))
    assert (displacement == [0.25, 0, 0]).all()
    assert 0 < np.linalg.eigvalsh(covariance).min() <= np.linalg.eigvalsh(covariance).max() < 4e-12


def test_a_velocity_counts_as_parts_of_a_step_and_of_a_turn():
    """Half a step while turning by 15 degrees to the right, sampled by its definition: no mean, and the covariance."""
    rng = np.random.default_rng(7)
    runs = {action: samples(rng, 100_000, MEAN * (1 + action)) for action in MOVES}
    corrector = OdometryCorrector(calibrated(runs))
    true = np.array([0.125, 0.01, -np.radians(15)])
    pieces = rng.multivariate_normal(MEAN, 0.5 * COVARIANCE, 20_000) - 0.5 * MEAN  # of means 0.5 and 1.5 * 3
    pieces += rng.multivariate_normal(4.5 * MEAN, 1.5 * COVARIANCE, 20_000)
    found = [corrector.correct(Velocity(0.25, -0.5, 0.5), true + error) for error in pieces]
    errors, covariance = np.array([one for one, _ in found]) - true, found[0][1]
    deviation = np.sqrt(np.diag(covariance))
    assert (np.abs(errors.mean(axis=0)) < 0.2 * deviation).all()  # parts are counted by what was measured
    np.testing.assert_allclose(errors.std(axis=0), deviation, rtol=0.1)
    still, tiny = corrector.correct(Velocity(0.0, 0.0, 0.5), np.zeros(3))
    assert (still == 0).all() and 0 < np.trace(tiny) < 1e-11


def test_exact_constants_stay_though_scans_are_noisy():
    """1,000 runs, then 500 matched motions that are 5 mm and 0.3 degrees off: moved by less than 1 mm."""
    rng = np.random.default_rng(2)
    corrector = OdometryCorrector(calibrated({action: samples(rng, 1000) for action in MOVES}))
    match = np.diag([25e-6, 25e-6, 27e-6])
    for measured in samples(rng, 500):
        corrector.learn(L, measured, rng.multivariate_normal(np.zeros(3), match), match)
    assert np.abs(corrector.bias[L, :2] - MEAN[:2]).max() < 1e-3
    assert abs(corrector.bias[L, 2] - MEAN[2]) < np.radians(0.02)


def test_a_constant_that_drifts_is_followed():
    """Turns that read 2 mm less from one day on: after 2,000 well matched ones most of it is known."""
    rng = np.random.default_rng(3)
    corrector = OdometryCorrector(calibrated({action: samples(rng, 200) for action in MOVES}))
    worn, match = MEAN - [0, 0.002, 0], np.diag([1e-6, 1e-6, 1e-7])
    for measured in samples(rng, 2000, worn):
        corrector.learn(L, measured, rng.multivariate_normal(np.zeros(3), match), match)
    assert abs(corrector.bias[L, 1] - worn[1]) < 0.5e-3


def test_a_slip_teaches_nothing():
    """Wheels that turned on the spot: 10 cm without motion leave the constants unchanged."""
    rng = np.random.default_rng(4)
    corrector = OdometryCorrector(calibrated({action: samples(rng, 30) for action in MOVES}))
    before = corrector.bias[F].copy()
    corrector.learn(F, np.array([0.25, 0, 0]), np.array([0.15, 0, 0]), 1e-6 * np.eye(3))
    assert (corrector.bias[F] == before).all()


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (((1.0, 2.0, 0), (0, 1.0, 0), (0, 0, 1.0)), "not symmetric"),
        (((1.0, 2.0, 0), (2.0, 1.0, 0), (0, 0, 1.0)), "not symmetric and positive"),
        (((float("nan"), 0, 0), (0, 1.0, 0), (0, 0, 1.0)), "three rows of three numbers"),
    ],
)
def test_invalid_covariances_are_rejected(covariance, message):
    with pytest.raises(ValueError, match=message):
        ActionError(covariance=covariance)


def test_guesses_are_learned_fast():
    """Without a calibration, 20 well matched motions find a constant of 2 cm to 2 mm."""
    rng = np.random.default_rng(5)
    corrector = OdometryCorrector(OdometryConfig())
    for measured in samples(rng, 20):
        corrector.learn(R, measured, np.zeros(3), 1e-6 * np.eye(3))
    assert np.abs(corrector.bias[R, :2] - MEAN[:2]).max() < 2e-3


def test_an_unmeasured_step_back_reverses_a_step_forward():
    """Constant parts and motion negated, the random part the same; measured, it is taken as it was found."""
    rng = np.random.default_rng(3)
    errors = {action: samples(rng, 50) for action in (F, L, R)}
    motions = {action: samples(rng, 50) for action in (F, L, R)}
    forward, _, _, back = calibrated(errors, motions).of_actions
    assert np.array_equal(back.mean, -np.array(forward.mean))
    assert np.array_equal(back.motion, -np.array(forward.motion))
    assert back.covariance == forward.covariance
    measured = {**errors, Action.BACKWARD: samples(rng, 12, -MEAN)}
    found = calibrated(measured)
    assert found.runs == 12
    assert np.allclose(found.of_actions[Action.BACKWARD].mean, measured[Action.BACKWARD].mean(axis=0))
