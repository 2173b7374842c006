"""Scores and trajectory files of an episode, on trajectories with known answers."""

import json

import numpy as np
import pytest
from evo.core import metrics, sync
from evo.tools import file_interface

from robosim.episode_log import EpisodeLog
from robosim.robot.dynamic import Motion
from robosim.support.files import whole_file, write_json
from robosim.task.tasks import Task


def _motion(pose, **kwargs) -> Motion:
    given = {"collided": False, "duration_s": 0.5, "penetration_m": 0.0, "physics_steps": 100}
    return Motion(pose=pose, **{**given, **kwargs})


def _log(xy, target, shortest_m, estimate_offset=(0.0, 0.0, 0.0)) -> EpisodeLog:
    poses = np.column_stack([np.array(xy, float), np.linspace(0, 1, len(xy))])
    log = EpisodeLog(Task(poses[0], np.array(target, float), float(shortest_m)))
    for pose in poses:
        log.add_pose(None, pose, pose + estimate_offset, 0.5)
    log.motions += [_motion(pose) for pose in poses[1:]]
    return log


def test_spl_of_a_detour():
    """4 m driven where 2.7 m would do: SPL = 2.7 / 4 (Anderson et al. 2018)."""
    log = _log([(0, 0), (0, 1), (3, 1)], (3.2, 1), 2.7)
    result = log.result()
    assert result["arrived"]
    assert result["arrived_at_step"] == 2
    assert result["path_length_m"] == pytest.approx(4.0)
    assert result["spl"] == pytest.approx(2.7 / 4)


def test_the_path_counts_up_to_the_arrival():
    """An explorer that passes the target and goes on is scored for the path to it."""
    result = _log([(0, 0), (2, 0), (5, 0)], (2.1, 0), 1.8).result()
    assert result["arrived_at_step"] == 1
    assert result["path_length_m"] == pytest.approx(2.0)
    assert result["steps"] == 2


def test_half_the_route_is_half_a_soft_success():
    """2 m from a target that was 4 m away: SPL 0, soft SPL 1 - 2/4 (Datta et al. 2020)."""
    result = _log([(0, 0), (2, 0)], (4, 0), 3.7).result()
    assert not result["arrived"]
    assert result["spl"] == 0
    assert result["soft_spl"] == pytest.approx(0.5)


def test_soft_spl_of_a_robot_that_stays_is_zero():
    """A wall makes the drive to a target 4 m away 9 m long."""
    assert _log([(0, 0), (0, 0)], (4, 0), 9.0).result()["soft_spl"] == 0


def test_arrival_is_by_distance_not_by_cells():
    """0.3 m in a straight line; the L1 rule of the published code would reject (0.2, 0.2), 0.28 m away."""
    assert _log([(0, 0), (1.0, 0.0)], (1.2, 0.2), 1).arrived
    assert not _log([(0, 0), (1.0, 0.0)], (1.22, 0.22), 1).arrived


def test_a_start_on_the_target_is_a_whole_success():
    assert _log([(0, 0)], (0, 0), 0.0).result()["spl"] == 1.0


def test_evo_reads_the_trajectories_and_agrees_on_the_error(tmp_path):
    """A constant offset of (0.3, 0.4) m is an absolute trajectory error of 0.5 m RMS for evo as for us."""
    log = _log([(0, 0), (1, 0), (1, 1), (2, 1)], (9, 9), 12, (0.3, 0.4, 0.0))
    log.save_trajectories(tmp_path)
    truth, estimate = (
        file_interface.read_tum_trajectory_file(str(tmp_path / f"{name}.tum"))
        for name in ("trajectory", "estimate")
    )
    truth, estimate = sync.associate_trajectories(truth, estimate)
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((truth, estimate))
    assert error.get_statistic(metrics.StatisticsType.rmse) == pytest.approx(0.5)
    assert log.result()["position_error_rms_m"] == pytest.approx(0.5)
    assert truth.timestamps.tolist() == [0, 0.5, 1.0, 1.5]
    yaw = truth.get_orientations_euler("sxyz")[:, 2]
    assert yaw == pytest.approx(np.linspace(0, 1, 4), abs=1e-6)


def test_json_takes_arrays_and_has_no_nan(tmp_path):
    write_json(
        tmp_path / "a.json", {"x": np.arange(2), "nan": float("nan"), "deep": [{"y": np.float32(0.5)}]}
    )
    assert json.loads((tmp_path / "a.json").read_text()) == {"x": [0, 1], "nan": None, "deep": [{"y": 0.5}]}


def test_a_file_that_fails_halfway_is_not_there(tmp_path):
    (tmp_path / "stored.txt").write_text("old")
    with pytest.raises(RuntimeError), whole_file(tmp_path / "stored.txt") as partial:
        partial.write_text("half")
        raise RuntimeError
    assert (tmp_path / "stored.txt").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["stored.txt"]
