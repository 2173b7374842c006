"""Methods to estimate the pose: errors are those of evo, and odometry without noise is the truth."""

import numpy as np
import pytest
from evo.core import metrics
from evo.core.trajectory import PosePath3D

from slam.poses import compose
from tests.benchmarks.pose_tracks import (
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
