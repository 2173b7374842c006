"""Methods to estimate the pose: errors are those of evo, and odometry without noise is the truth."""

import numpy as np
import pytest
from evo.core import metrics
from evo.core.trajectory import PosePath3D

from robosim.building.building import BuildingConfig, make_building
from robosim.building.reach import reach
from robosim.camera.model import CameraConfig
from robosim.plans.files import read_plan
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from robosim.simulator import Simulator, SimulatorConfig
from robosim.task.tasks import make_task
from slam.actions import Action
from slam.poses import compose
from tests.benchmarks.pose_tracks import (
    Odometry,
    OpenCVOdometry,
    Track,
    trajectory_errors,
)


def _as_evo(poses: np.ndarray) -> PosePath3D:
    half = poses[:, 2] / 2
    zero = np.zeros(len(poses))
    quaternions = np.column_stack([np.cos(half), zero, zero, np.sin(half)])
    return PosePath3D(np.column_stack([poses[:, :2], zero]), quaternions)


def test_ate_and_rpe_are_those_of_evo():
    """Two random walks of 60 poses that drift apart: ATE, RPE of displacements and of turns agree to 1e-9."""
    rng = np.random.default_rng(0)
    true, estimated = [np.zeros(3)], [np.zeros(3)]
    for _ in range(60):
        step = rng.normal([0.2, 0, 0], [0.1, 0.02, 0.3])
        true.append(compose(true[-1], step))
        estimated.append(compose(estimated[-1], step + rng.normal(0, [0.02, 0.02, 0.02])))
    got = trajectory_errors(np.array(true), np.array(estimated))
    pair = (_as_evo(np.array(true)), _as_evo(np.array(estimated)))
    for metric, name in (
        (metrics.APE(metrics.PoseRelation.translation_part), "ate_m"),
        (metrics.RPE(metrics.PoseRelation.translation_part, 1, metrics.Unit.frames), "rpe_m"),
        (metrics.RPE(metrics.PoseRelation.rotation_angle_deg, 1, metrics.Unit.frames), "rpe_deg"),
    ):
        metric.process_data(pair)
        assert got[name] == pytest.approx(metric.get_statistic(metrics.StatisticsType.rmse), abs=1e-9)


@pytest.fixture(scope="module")
def drive():
    """Frames of a robot that drives without noise, with the true poses."""
    building = make_building(read_plan("flat"), config=BuildingConfig(tolerance_m=0))  # steps are seen well
    places = reach(building, 0.1)
    task = make_task(places, np.random.default_rng(3))
    simulator = Simulator(
        building, SimulatorConfig(physics="kinematic", robot=RobotConfig(noise=NoiseModel(level=0.0)))
    )
    try:
        frames = [(simulator.reset(task, np.random.default_rng(0)), None, task.start)]
        for action in [Action.LEFT] * 12 + [Action.FORWARD] * 4 + [Action.RIGHT] * 8 + [Action.FORWARD] * 4:
            frames.append((simulator.step(action)[0], action, simulator.pose))
    finally:
        simulator.close()
    return frames


def test_odometry_without_noise_is_the_truth(drive):
    """28 actions: raw odometry ends at the true pose to 1e-9; taking a bias off that is not there errs by just that."""
    true = np.array([pose for _, _, pose in drive])
    raw, less = (Track(source, true[0]) for source in (Odometry(), Odometry(less=NoiseModel(level=1.0))))
    for view, action, _ in drive:
        raw.update(view, action)
        less.update(view, action)
    np.testing.assert_allclose(np.array(raw.poses)[:, :2], true[:, :2], atol=1e-9)
    step = trajectory_errors(true[:13], np.array(less.poses)[:13])["rpe_m"]
    assert step == pytest.approx(np.hypot(*NoiseModel(level=1.0).sensor_bias(Action.LEFT)[:2]), rel=0.02)


@pytest.mark.skipif(not OpenCVOdometry.available(), reason="this OpenCV has no RGB-D odometry")
def test_opencv_sees_motion_in_pictures(drive):
    """Without noise it follows 28 motions with 2 cm and 1 degree each, where it is not lost."""
    true = np.array([pose for _, _, pose in drive])
    source = OpenCVOdometry(CameraConfig(), NoiseModel(level=0.0))
    track = Track(source, true[0])
    for view, action, _ in drive:
        track.update(view, action)
    errors = trajectory_errors(true, np.array(track.poses))
    assert errors["rpe_m"] < 0.02
    assert errors["rpe_deg"] < 1.0
    assert source.lost < 14
