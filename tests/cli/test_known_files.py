"""Other files of this project that are given to `robosim slam`: each message names the command that reads them."""

from pathlib import Path

import numpy as np
import pytest

from robosim.commands.known_files import naming_other_files
from robosim.plans.files import write_ros
from robosim.support.reading import FileError
from tests.fuzz import seeds
from tests.fuzz.small_files import FILES
from tests.plans import two_rooms


@pytest.fixture(scope="module")
def home(tmp_path_factory) -> Path:
    """A folder with a file of each kind."""
    folder = tmp_path_factory.mktemp("home")
    for make in (seeds.episode, seeds.evaluation, seeds.shards, seeds.links, seeds.storeys, seeds.scenes):
        make(folder)
    np.savez(folder / "coverage.npz", best_server=np.zeros(3), sinr_db=np.zeros(3))
    (folder / "robot.yaml").write_text("radius_m: 0.25\n")
    write_ros(two_rooms(0.8), folder / "map.yaml")
    return folder


@pytest.mark.parametrize(
    ("name", "kind", "command"),
    [
        ("episode/episode.npz", "a recorded episode", "robosim replay {home}/episode."),
        ("episode", "an episode", "robosim replay {home}/episode."),
        (
            "evaluation/episodes/pair/000-oracle-0.npz",
            "a recorded episode",
            "robosim live {home}/evaluation.",
        ),
        ("evaluation", "an evaluation", "robosim live {home}/evaluation."),
        ("evaluation/suite.yaml", "a suite", "robosim evaluate {home}/evaluation/suite.yaml."),
        ("shards/home-00000.npz", "frames of robosim collect", "robosim train mapper --data {home}/shards."),
        ("dataset/links/pair_Tx_1.parquet", "links of a data set", "train link-state --data {home}/dataset."),
        ("dataset/manifest.json", "the manifest of a data set", "train link-state --data {home}/dataset."),
        ("dataset", "a data set of links", "robosim train link-state --data {home}/dataset."),
        ("paths/paths.parquet", "traced paths", "wireless.Paths.read_parquet in Python."),
        ("coverage.npz", "coverage of robosim trace", "numpy.load in Python."),
        (
            "map.yaml",
            "a floor plan",
            "robosim plan {home}/map.yaml, or robosim slam LOG --map {home}/map.yaml",
        ),
        ("map.pgm", "a floor plan", "robosim plan {home}/map.pgm"),
        ("storeys/building.yaml", "a building of storeys", "robosim trace {home}/storeys/building.yaml."),
        ("scenes/scene.xml", "a Mitsuba scene", "robosim trace {home}/scenes/scene.xml."),
        ("robot.yaml", "a robot", "robosim robot {home}/robot.yaml."),
    ],
)
def test_slam_names_the_command_of_another_file(name, kind, command, home, fails):
    said = fails("slam", home / name, "--inspect")
    assert f"{home / name}: holds {kind}, expected a robot's log. Read it by" in said
    assert command.format(home=home) in said


def test_slam_and_locate_say_the_same_without_inspection(home, tmp_path, fails):
    said = fails("slam", home / "episode" / "episode.npz", "--out", tmp_path / "out")
    assert f"robosim replay {home}/episode" in said and not (tmp_path / "out").exists()
    (route := tmp_path / "route.csv").write_text(FILES["route.csv"])
    assert "robosim replay" in fails("locate", route, "--map-from", home / "episode" / "episode.npz")


@pytest.mark.parametrize("name", ["notes.yaml", "absent.yaml", "damaged.npz", "empty"])
def test_naming_other_files_leaves_errors_on_unknown_files(name, tmp_path):
    """A text that is none of these, no file, a damaged archive, and a folder."""
    (tmp_path / "notes.yaml").write_text("a: 1\n")
    (tmp_path / "damaged.npz").write_bytes(b"PK\x03\x04")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="as it was"), naming_other_files(tmp_path / name):
        raise ValueError("as it was")


def test_naming_other_files_leaves_errors_of_a_given_reader(home):
    """A reader of a user may read logs from files of any ending."""
    with pytest.raises(ValueError, match="as it was"), naming_other_files(home / "map.yaml", "module:Mine"):
        raise ValueError("as it was")
    with pytest.raises(FileError, match="a floor plan"), naming_other_files(home / "map.yaml"):
        raise ValueError("as it was")
