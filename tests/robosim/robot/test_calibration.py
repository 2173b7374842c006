"""Calibration of odometry: a simulated robot's own runs, a real one's table, and the robot's file between them."""

import json

import numpy as np
import pytest

from robosim.cli import main
from robosim.navigation import CALIBRATION_RUNS, _shipped_odometry, calibrate_odometry, odometry_of
from robosim.robot.calibration import COLUMNS, open_floor, read_runs, run_actions
from robosim.robot.kinematic import KinematicWorld
from robosim.robot.odometry import NoiseModel
from robosim.robot.robot_files import read_robot
from robosim.robot.robots import LOCOBOT
from robosim.support.reading import FileError
from slam.actions import MOVES, Action
from slam.odometry import calibrated
from tests.robosim.robot.test_odometry import PUBLISHED_SENSOR


def test_a_simulated_robot_finds_the_published_errors():
    """1,000 runs: means of the published table within 4 standard errors, deviations within 10 %."""
    runs = run_actions(KinematicWorld(open_floor()), NoiseModel(), range(1000), np.random.default_rng(0))
    sensed = {**PUBLISHED_SENSOR, Action.BACKWARD: np.array(PUBLISHED_SENSOR[Action.FORWARD]) * [[-1], [1]]}
    for action, error in zip(MOVES, calibrated(*runs).of_actions, strict=True):
        mean, deviation = (np.array(one) * [0.01, 0.01, np.radians(1)] for one in sensed[action])
        assert (np.abs(np.array(error.mean) - mean) < 4 * deviation / np.sqrt(1000)).all()
        np.testing.assert_allclose(np.sqrt(np.diag(error.covariance)), deviation, rtol=0.1)


@pytest.mark.parametrize("noise", _shipped_odometry())
def test_shipped_odometry_is_what_a_calibration_finds(noise, monkeypatch):
    """For each shipped noise model, to rounding errors of the machine; another model is calibrated at its first use."""
    computed = calibrate_odometry(noise)
    for ours, theirs in zip(odometry_of(noise).of_actions, computed.of_actions, strict=True):
        np.testing.assert_allclose(ours.mean, theirs.mean, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(ours.covariance, theirs.covariance, rtol=1e-9, atol=1e-18)
        np.testing.assert_allclose(ours.motion, theirs.motion, rtol=1e-9, atol=1e-15)
    assert odometry_of(noise).runs == computed.runs == CALIBRATION_RUNS


def test_odometry_of_another_noise_model_is_computed():
    noise = NoiseModel(level=2.0)
    assert noise not in _shipped_odometry()
    assert odometry_of(noise) == calibrate_odometry(noise)


def written(path, rows):
    path.write_text("\n".join([",".join(COLUMNS), *(",".join(str(value) for value in row) for row in rows)]))
    return path


def test_a_table_of_a_real_robot_is_read(tmp_path):
    """Turns that pass half a circle differ by little."""
    rows = [
        ("forward", 0.26, 0.01, 0.002, 0.25, 0.0, 0.0),
        ("left", 0.0, 0.02, -3.1, 0.0, 0.0, 3.1),
        ("right", 0.0, 0.0, 0.0, 0.0, 0.0, 0.1),
    ]
    runs = read_runs(written(tmp_path / "runs.csv", 10 * rows))
    np.testing.assert_allclose(runs.errors[Action.FORWARD], 10 * [[0.01, 0.01, 0.002]], atol=1e-12)
    np.testing.assert_allclose(runs.errors[Action.LEFT], 10 * [[0.0, 0.02, 2 * np.pi - 6.2]], atol=1e-12)


def test_a_table_that_is_too_short_is_an_error_with_its_name(tmp_path):
    with pytest.raises(FileError, match=r"runs\.csv: .*forward was run 9 times"):
        read_runs(written(tmp_path / "runs.csv", 9 * [("forward", 0.26, 0, 0, 0.25, 0, 0)]))


@pytest.mark.parametrize(
    ("row", "wrong"),
    [
        (("ahead", 0, 0, 0, 0, 0, 0), "action in line 2 is 'ahead'"),
        (("forward", "x", 0, 0, 0, 0, 0), "line 2: measured_x_m is 'x'"),
        (("left", 0, 0, 0, 0, "nan", 0), "line 2: true_y_m is 'nan'"),
        (("left", 0, 0), "line 2: measured_yaw_rad is ''"),
        (
            ("left", 0, 0, 10.2, 0, 0, 10),
            "line 2: measured_yaw_rad is '10.2', expected a number from -7 to 7",
        ),
    ],
)
def test_what_is_wrong_with_a_table_is_said(tmp_path, row, wrong):
    with pytest.raises(FileError, match=wrong):
        read_runs(written(tmp_path / "runs.csv", [row]))


def test_the_command_writes_a_robot_that_others_take(tmp_path, capsys):
    """The file holds the robot and what was found; an episode and its result keep it."""
    main(
        [
            "calibrate",
            "--robot",
            "locobot",
            "--runs",
            "20",
            "--physics",
            "kinematic",
            "--out",
            str(tmp_path / "c"),
        ]
    )
    robot = read_robot(tmp_path / "c" / "robot.json")
    assert robot.hull.radius_m == LOCOBOT.radius_m
    assert robot.odometry is not None and robot.odometry.runs == 20
    assert (tmp_path / "c" / "odometry.png").stat().st_size > 10_000
    words = "--goal explore --mapper classical --physics kinematic --camera embree --max-steps 3 --no-video"
    main(f"episode flat --robot {tmp_path}/c/robot.json {words} --out {tmp_path}/e".split())
    result = json.loads((tmp_path / "e" / "result.json").read_text())
    stored = result["config"]["simulator"]["robot"]["odometry"]
    assert tuple(stored["left"]["mean"]) == robot.odometry.left.mean
    main(f"episode flat --config {tmp_path}/e/result.json --no-video --out {tmp_path}/f".split())
    assert (tmp_path / "e" / "estimate.tum").read_bytes() == (tmp_path / "f" / "estimate.tum").read_bytes()


def test_a_real_robot_is_calibrated_by_its_table(tmp_path):
    rng = np.random.default_rng(0)
    rows = [(action.name.lower(), *rng.normal(0, 0.01, 3), 0, 0, 0) for action in MOVES for _ in range(30)]
    path = written(tmp_path / "runs.csv", rows)
    main(["calibrate", str(path), "--out", str(tmp_path / "c")])
    robot = read_robot(tmp_path / "c" / "robot.json")
    assert robot.odometry == calibrated(*read_runs(path))
