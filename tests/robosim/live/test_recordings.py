"""Recordings from the folder of an episode and of an evaluation."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from robosim.live.recordings import Recording, check_results, read_evaluation, read_recording
from robosim.recording.episode_file import EPISODE, read_episode
from robosim.run import record_episode
from robosim.support.reading import FileError
from robosim.team.team_config import TeamConfig
from tests.plans import two_rooms
from tests.robosim.live.conftest import START, TARGET


def test_a_recording_is_the_episode_from_its_file_alone(recorded, tmp_path):
    """All steps, title and end, from a folder with only that file."""
    shutil.copy(recorded / EPISODE, tmp_path)
    recording, episode = read_recording(tmp_path), read_episode(tmp_path)
    assert len(recording) == len(episode) == 12
    for i, step in enumerate(episode.steps()):
        shown = recording[i]
        assert np.array_equal(shown.true.pose, step.true.pose)
        assert np.array_equal(shown.sensed.rgb, step.sensed.rgb)
        assert np.array_equal(shown.map_layer.values, step.map_layer.values)
    true, estimated = recording.trajectories(12)
    assert np.array_equal(true, episode.poses[:12, :2])
    assert np.array_equal(estimated, episode.estimates[:12, :2])
    assert recording.title == "explore, two rooms"
    assert recording.ended == json.loads((recorded / "result.json").read_text())["ended"]


def test_bodies_are_drawn_with_their_radii_as_others_come_and_go(recorded, page):
    """A trolley alone, then a person listed before it: the person was drawn as wide as the trolley."""
    from robosim.live.search_view import SearchView

    episode, present = (
        read_recording(recorded),
        [[[1.0, 1.0, 0.0, 0.4]], [[2.0, 1.0, 0.0, 0.17], [1.0, 1.0, 0.0, 0.4]]],
    )
    recording = Recording(episode.title, episode.rings, episode.target)
    for row, bodies in zip(read_episode(recorded).rows(), present, strict=False):
        recording.add({**row, "bodies": np.array(bodies)})
    view = SearchView(page.server, "/bodies", recording, 0.0, brief=True)
    for number, bodies in enumerate(present):
        view.show(number)
        assert [body.radius for body in view._bodies] == [body[3] for body in bodies]


def test_a_recording_of_a_team_has_all_robots(quick, tmp_path):
    config = replace(quick, max_steps=3, team=TeamConfig(robots="2"))
    record_episode(two_rooms(0.8), config, tmp_path, start=START, target=TARGET, video=False)
    check_results(tmp_path)
    robots = read_recording(tmp_path).robots
    assert [robot.robot for robot in robots] == ["robot1", "robot2"]
    for robot in robots:
        episode = read_episode(tmp_path / robot.robot)
        assert np.array_equal(robot.trajectories(3)[0], episode.poses[:3, :2])


@pytest.mark.parametrize(
    ("ends", "outcome"),
    [
        (("lost", "another arrived", "arrived"), "arrived"),
        (("lost", "out of steps"), "out of steps"),
        (("lost", "lost"), "lost"),
        (("", ""), ""),
    ],
)
def test_outcome_of_a_team_is_not_that_of_a_robot_that_was_lost(ends, outcome):
    robots = [Recording("search", [], None, ended=ended) for ended in ends]
    robots[0].mates = robots[1:]
    assert robots[0].outcome == outcome


def test_a_damaged_file_is_one_line_with_its_name(recorded, tmp_path):
    (tmp_path / EPISODE).write_bytes((recorded / EPISODE).read_bytes()[:-500])
    with pytest.raises(FileError) as raised:
        read_recording(tmp_path)
    assert EPISODE in str(raised.value) and "\n" not in str(raised.value)


def test_another_folder_is_rejected(tmp_path):
    with pytest.raises(ValueError, match="neither an episode"):
        check_results(tmp_path)


def test_episodes_of_an_evaluation_begin_with_failures_and_the_slowest(evaluated):
    searches = read_evaluation(evaluated)
    assert len(searches) == 4
    arrived = [one.row["arrived"] for one in searches]
    assert arrived == sorted(arrived)
    slower = [one.relative_steps for one in searches if one.row["arrived"]]
    assert slower == sorted(slower, reverse=True) and slower[-1] == 1.0
    # The oracle arrives in every task, so that failures have infinite relative steps.
    assert all(np.isinf(one.relative_steps) for one in searches if not one.row["arrived"])


def test_an_episode_of_an_evaluation_opens(evaluated):
    one = next(one for one in read_evaluation(evaluated) if one.row["policy"] == "oracle")
    recording = one.read()
    assert len(recording) == one.row["steps"]
    first = recording[0]
    assert first.true.pose == pytest.approx([0.7, 0.7, 0.0], abs=1e-6)
    assert recording.title.startswith("oracle, pair, task")
    # Its walls are the mapped ones, within a few cells of the true ones.
    corners = np.concatenate(list(recording.rings))
    assert (corners.min(axis=0) > -0.3).all() and (corners.max(axis=0) < [6.5, 3.3]).all()
