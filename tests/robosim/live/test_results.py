"""What is looked back on: the folder of an episode, and that of an evaluation."""

import json
import os
import shutil

import numpy as np
import pytest

from robosim.live.results import check_results, read_recording, read_searches, recording_of
from robosim.recording.decision_log import read_decisions
from robosim.support.reading import FileError


def test_a_recording_is_the_episode_from_its_log_alone(recorded, tmp_path):
    """Every decision as the log has it, when nothing but the log is there."""
    alone = tmp_path / "alone"
    alone.mkdir()
    shutil.copy(recorded / "decisions.npz", alone)
    recording, log = read_recording(alone), read_decisions(alone)
    assert len(recording) == len(log) == 12
    for i, snapshot in enumerate(log.snapshots()):
        shown = recording[i].snapshot
        assert np.array_equal(shown.pose, snapshot.pose)
        assert np.array_equal(shown.rgb, snapshot.rgb)
        assert np.array_equal(shown.built.values, snapshot.built.values)
    true, estimated = recording.ways(12)
    assert np.array_equal(true, log.columns["pose"][:, :2])
    assert np.array_equal(estimated, log.columns["estimate"][:, :2])
    assert recording.title == "alone" and recording.ended == "recorded"


def test_the_result_beside_it_gives_the_title(recorded):
    recording = read_recording(recorded)
    assert recording.title == "explore, two rooms"
    assert recording.ended == json.loads((recorded / "result.json").read_text())["ended"]


@pytest.mark.parametrize("kind", ["pipe", "device", "damaged", "number"])
def test_a_result_that_is_no_result_is_ignored(recorded, tmp_path, kind):
    """The log suffices; a named pipe is not waited for, and a device without end is not read."""
    shutil.copy(recorded / "decisions.npz", tmp_path)
    result = tmp_path / "result.json"
    if kind == "pipe":
        os.mkfifo(result)
    elif kind == "device":
        result.symlink_to("/dev/zero")
    else:
        result.write_text({"damaged": '{"goal": ', "number": "3"}[kind])
    assert read_recording(tmp_path).ended == "recorded"


def test_a_damaged_log_is_one_line_with_its_name(recorded, tmp_path):
    (tmp_path / "decisions.npz").write_bytes((recorded / "decisions.npz").read_bytes()[:-500])
    with pytest.raises(FileError) as refused:
        read_recording(tmp_path)
    assert "decisions.npz" in str(refused.value) and "\n" not in str(refused.value)


def test_a_folder_of_something_else_is_refused(tmp_path):
    with pytest.raises(ValueError, match="neither an episode"):
        check_results(tmp_path)


def test_episodes_of_an_evaluation_begin_with_failures_and_the_slowest(evaluated):
    searches = read_searches(evaluated)
    assert len(searches) == 4
    arrived = [one.row["arrived"] for one in searches]
    assert arrived == sorted(arrived)
    slower = [one.slower for one in searches if one.row["arrived"]]
    assert slower == sorted(slower, reverse=True) and slower[-1] == 1.0
    # The oracle arrives at every task, so that who does not takes for ever beside it.
    assert all(np.isinf(one.slower) for one in searches if not one.row["arrived"])


def test_an_episode_of_an_evaluation_opens(evaluated):
    one = next(one for one in read_searches(evaluated) if one.row["policy"] == "oracle")
    recording = recording_of(one)
    assert len(recording) == one.row["steps"]
    first = recording[0]
    assert first.snapshot.pose == pytest.approx([0.7, 0.7, 0.0], abs=1e-6)
    assert recording.title.startswith("oracle, pair, task")
    # The walls are those that it has mapped: within a few cells of the true ones.
    corners = np.concatenate(list(recording.rings))
    assert (corners.min(axis=0) > -0.3).all() and (corners.max(axis=0) < [6.5, 3.3]).all()
