"""Replays are drawn from the file of an episode alone."""

import cv2
import numpy as np
import pytest
from PIL import Image

from robosim.drawing.picture import LEGEND
from robosim.drawing.plan_view import HEIGHT
from robosim.episode_config import EpisodeConfig
from robosim.movers.movers import MoversConfig
from robosim.recording import replay as replaying
from robosim.recording.episode_file import EPISODE, EpisodeWriter, Head, read_episode
from robosim.recording.replay import replay
from robosim.run import record_episode
from robosim.simulator import SimulatorConfig
from robosim.team.team_config import TeamConfig
from tests.plans import two_rooms
from tests.steps import unknown_map


def test_a_replay_is_the_video_of_the_episode(recorded, tmp_path):
    """Byte for byte: the same frames into the same encoder. A pixel that the file does not hold changes it."""
    video, sheet = replay(recorded, tmp_path)
    assert video.read_bytes() == (recorded / "episode.mp4").read_bytes()
    with Image.open(sheet) as picture:
        width, height = picture.size
    assert width <= 2400 and (width - LEGEND) % 2 == 0 and height % 6 == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["replay.mp4", "sheet.png"]


def test_a_replay_of_a_team_is_its_video(tmp_path):
    """Byte for byte, with a frame for each step of the robot that goes on longest."""
    team = TeamConfig(robots="2", exchange="perfect", lose=("1@2",))
    simulator = SimulatorConfig(physics="kinematic", movers=MoversConfig(people=1))
    config = EpisodeConfig(goal="explore", mapper="classical", simulator=simulator, max_steps=4, team=team)
    record_episode(two_rooms(0.8), config, tmp_path, start=np.array([1.0, 0.6, 2.0]))
    video, sheet = replay(tmp_path, tmp_path, frames=3)
    assert video.read_bytes() == (tmp_path / "episode.mp4").read_bytes()
    reader = cv2.VideoCapture(str(video))
    assert reader.get(cv2.CAP_PROP_FRAME_COUNT) == 4
    with Image.open(sheet) as picture:
        assert picture.size[0] <= 2400


def test_an_episode_of_an_evaluation_has_no_camera_pictures(recorded, tmp_path):
    """The camera's half is grey with a line of text; map and trajectory are drawn as usual."""
    whole = read_episode(recorded)
    writer = EpisodeWriter(whole.rings, pictures=False)
    steps = list(whole.steps())
    for step in steps:
        writer.add(step)
    content = writer.content(
        whole.head, steps[-1].true.pose, 0.5, unknown_map(np.zeros(3)), np.arange(len(steps) + 1.0)
    )
    (tmp_path / EPISODE).write_bytes(content)
    _, sheet = replay(tmp_path / EPISODE, tmp_path, frames=1)
    with Image.open(sheet) as picture:
        camera = np.asarray(picture.convert("RGB"))[:HEIGHT, :HEIGHT]
    assert (camera == 200).mean() > 0.95 and (camera < 100).any()


def test_nothing_is_simulated_by_a_replay(recorded, tmp_path, monkeypatch):
    """Neither camera, physics nor radio is made, and no plan is read: only the one file is there."""
    alone = tmp_path / "alone"
    alone.mkdir()
    (alone / EPISODE).write_bytes((recorded / EPISODE).read_bytes())
    for name in ("robosim.simulator.Simulator", "robosim.simulator.make_camera", "robosim.run.make_building"):
        monkeypatch.setattr(name, None)
    assert all(path.is_file() for path in replay(alone, alone, frames=1))


def test_the_sheet_shows_first_and_last(recorded, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(replaying, "_tiled", lambda frames: drawn.extend(frames) or frames[0])
    replay(recorded, tmp_path, frames=2)
    assert len(drawn) == 2
    assert not np.array_equal(drawn[0], drawn[1])


def test_an_episode_without_decisions_has_no_video(tmp_path):
    row = {"plan": "hall", "policy": "fused", "ended": "arrived", "target": [1.0, 1.0]}
    writer = EpisodeWriter([np.array([[0.0, 0], [6, 0], [6, 3]])])
    content = writer.content(
        Head(row=row, seeks_target=True), np.zeros(3), 1.0, unknown_map(np.zeros(3)), np.zeros(1)
    )
    (tmp_path / EPISODE).write_bytes(content)
    with pytest.raises(ValueError, match="without a step to draw"):
        replay(tmp_path, tmp_path)
