"""Replays are drawn from the file of an episode alone."""

from shutil import rmtree

import cv2
import numpy as np
import pytest
from PIL import Image

from robosim.drawing.picture import LEGEND
from robosim.drawing.plan_view import HEIGHT
from robosim.episode_config import EpisodeConfig
from robosim.live.recordings import read_recording
from robosim.movers.movers import MoversConfig
from robosim.recording import replay as replaying
from robosim.recording.bag_export import export_bag
from robosim.recording.episode_file import EPISODE, EpisodeWriter, Head, read_episode, read_team
from robosim.recording.replay import replay
from robosim.run import record_episode
from robosim.simulator import SimulatorConfig
from robosim.support.installation import is_installed
from robosim.support.reading import FileError
from robosim.team.team_config import TeamConfig
from tests import stored_episodes
from tests.plans import two_rooms
from tests.steps import unknown_map, write_episode


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


def write_robot(folder, seed=7, **identity):
    """An episode of two steps of a robot of a team of three."""
    row = {**stored_episodes.row("pair", 0, "fused", (5.0, 2.0), seed=seed), "robots": 3}
    row |= {"run": "a", "robot": folder.name, **identity}
    write_episode(folder / EPISODE, row, np.array([(1.0, 0.6, 0.1 * k) for k in range(3)]))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda folder: rmtree(folder / "robot3"), "robot1, robot2, expected those of 3 robots"),
        (
            lambda folder: (folder / "robot2").rename(folder / "robot7"),
            "robot1, robot3, robot7, expected those of 3",
        ),
        (
            lambda folder: write_robot(folder / "robot2", seed=8),
            "robot2/episode.npz: .*another run than robot1: seed is 8",
        ),
        (
            lambda folder: write_robot(folder / "robot2", run="b"),
            "robot2/episode.npz: .*another run than robot1: run is 'b'",
        ),
        (
            lambda folder: write_robot(folder / "robot2", robot="robot1"),
            "robot2/episode.npz: the episode of 'robot1'",
        ),
    ],
)
def test_a_team_that_is_not_whole_is_rejected_by_all_that_read_it(tmp_path, damage, message):
    """Rather than drawn without the robot, or with one of another run."""
    names = ["robot1", "robot2", "robot3"]
    for name in names:
        write_robot(tmp_path / name)
    assert list(read_team(tmp_path)) == names
    damage(tmp_path)
    readers = [read_team, read_recording, lambda folder: replay(folder, tmp_path)]
    for read in [*readers, export_bag] if is_installed("rosbags") else readers:
        with pytest.raises(FileError, match=message):
            read(tmp_path)


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
