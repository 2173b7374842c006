"""A stranger's parts, from a module of their own that knows no more of the package than its documentation says."""

import json
import os
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import robosim
from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.camera.rendering.embree_camera import EmbreeCamera
from robosim.cli import main
from robosim.commands.episode_config import command_options, read_config
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.parts import GOAL, LOG_READER
from robosim.radio.link import RadioLinkConfig
from robosim.robot.kinematic import KinematicWorld
from robosim.simulator import SimulatorConfig
from robosim.support.from_dict import from_dict
from robosim.support.parts import code_allowed, to_dict
from robosim.task.tasks import make_task
from slam.control.controller import Controller
from slam.exploration.explorer import FrontierExplorer
from slam.mapping.classical import ClassicalMapper
from tests.plans import two_rooms
from wireless.estimation.pca import PcaEstimator
from wireless.paths import LinkState

MINE = '''
import numpy as np
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.policies.goals import GoalPolicy
from slam.mapping.classical import ClassicalMapper
from wireless import Layer, Material, terminal_named
from wireless.antennas.arrays import Platform, uniform_array
from wireless.antennas.codebook import Terminal


class Straight(GoalPolicy):
    """Goes two metres towards the strongest arrival, whatever the link state; explores where there is none."""

    uses_radio = True

    def __init__(self, context):
        self.explorer = context.explorer

    def goal(self, sensed, estimated):
        measurement = estimated.measurement
        if len(measurement.aoa_rad) == 0:
            return self.explorer.goal(estimated.map)
        angle = measurement.aoa_rad[0]
        return estimated.pose[:2] + 2.0 * np.array([np.cos(angle), np.sin(angle)])


class Mapper(ClassicalMapper):
    """A mapper of another name."""


def panel():
    """A robot with three arrays of 4 x 2."""
    return Terminal(platform=Platform(array=uniform_array(4, 2)), n_beams=18)


BOARD, WOOL = Layer(thickness_m=0.013, material="plasterboard"), Layer(thickness_m=0.05, relative_permittivity=1.2)
WALL = Material("insulated", (BOARD, WOOL, BOARD))


def read(path, options):
    """Plans drawn with letters, a quarter of a metre each, north on top."""
    rows = [[letter == "." for letter in line] for line in path.read_text().split()]
    cells = np.kron(np.array(rows[::-1]), np.ones((5, 5), bool))
    return FloorPlan(occupancy=np.where(cells, FREE, OCCUPIED).astype(np.uint8), resolution_m=0.05, name=path.stem)
'''
DRAWN = """
##################
#......#.........#
#......#.........#
#......#.........#
#................#
#................#
#......#.........#
#......#.........#
#......#.........#
##################
"""
ROBOT = """
# A vacuum cleaner
radius_m: 0.17
mass_kg: 3.4
wheel_radius_m: 0.036
track_m: 0.23
rotor_inertia_kgm2: 0.001
mast_m: 0.4
camera: {height_m: 0.4}
max_speed_mps: 0.3
max_accel_mps2: 1.0
"""


def run(line: str) -> None:
    """Run a command as it is typed."""
    main(line.split())


@pytest.fixture
def strangers_folder(tmp_path, monkeypatch, own_modules) -> Path:
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "studio.txt").write_text(DRAWN)
    (tmp_path / "vacuum.yaml").write_text(ROBOT)
    monkeypatch.chdir(tmp_path)
    # Processes of their own run the same checkout as this one.
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(robosim.__file__).parents[1])]))
    return tmp_path


def test_one_of_each_from_outside_is_evaluated_with_ours(strangers_folder, capsys):
    """A policy, a mapper, an array, a three-layered material, a robot and a plan format, on the command line."""
    run(
        "evaluate studio.txt --reader mine:read --policies fused mine:Straight --targets 1 --mapper "
        "mine:Mapper --robot vacuum.yaml --radio.receiver mine:panel --building.wall-material "
        "mine:WALL --physics kinematic --camera embree --image.height 64 --image.hfov-deg 80 "
        "--max-steps 80 --workers 1 --out found"
    )
    rows = pq.read_table("found/episodes.parquet").to_pylist()
    assert [row["policy"] for row in rows] == ["oracle", "fused", "mine:Straight"]
    assert all(row["arrived"] for row in rows if row["policy"] == "oracle")
    assert all(row["steps"] > 5 for row in rows)
    assert "mine:Straight" in capsys.readouterr().out

    stored = json.loads(Path("found/settings.json").read_text())["settings"]["episode"]
    assert stored["mapper"] == "mine:Mapper"
    assert stored["simulator"]["robot"]["radius_m"] == 0.17
    assert stored["simulator"]["robot"]["camera"]["hfov_deg"] == 80.0

    # The suite names the reader, and a result's configuration can be given back.
    assert "reader: mine:read" in Path("found/suite.yaml").read_text()
    run(
        "evaluate found/suite.yaml --config found/settings.json --policies mine:Straight --out again "
        "--workers 1 --allow-code"
    )
    again = pq.read_table("again/episodes.parquet").to_pylist()
    assert again == [row for row in rows if row["policy"] != "fused"]


def test_a_result_gives_its_configuration_back(strangers_folder):
    run(
        "episode studio.txt --reader mine:read --goal mine:Straight --mapper classical --physics "
        "kinematic --camera embree --image.height 48 --noise.level 0.5 --building.wall-material "
        "mine:WALL --max-steps 3 --no-video --out a"
    )
    with code_allowed():
        config = read_config(Path("a/result.json"))
    assert config.goal == "mine:Straight"
    assert config.simulator.robot.noise.level == 0.5
    assert "--noise.level 0.5" in command_options(config)
    run("episode studio.txt --reader mine:read --config a/result.json --allow-code --no-video --out b")
    first, second = (json.loads((strangers_folder / name / "result.json").read_text()) for name in "ab")
    del first["timing"], second["timing"]
    assert second == first
    # An additional option wins.
    run(
        "episode studio.txt --reader mine:read --config a/result.json --noise.level 0 --no-video "
        "--max-steps 1 --allow-code --out c"
    )
    with code_allowed():
        assert read_config(Path("c/result.json")).simulator.robot.noise.level == 0


class Counted:
    """Lets a part be as it is, and counts its calls."""

    def __init__(self, part):
        self._part, self.calls = part, 0

    def __getattr__(self, name):
        self.calls += 1
        return getattr(self._part, name)


class Certain:
    """A classifier that takes every link for one of first order."""

    def predict(self, aoa_rad, snr_db, *, aod_rad=None, delay_s=None):
        return np.eye(len(LinkState))[[LinkState.FIRST_ORDER]].repeat(len(aoa_rad), axis=0)


class Blind:
    """A recogniser that never finds anything."""

    def __init__(self, camera):
        self.camera = camera

    def find(self, frame, target):
        assert frame.rgb.shape[0] == self.camera.height
        return None


class Forward:
    """A goal policy that derives from nothing: it goes ahead."""

    def __init__(self, context):
        self.context = context

    def goal(self, sensed, estimated):
        return estimated.pose[:2] + np.array([np.cos(estimated.pose[2]), np.sin(estimated.pose[2])])


class Shifted:
    """A reader of logs that derives from nothing."""

    def matches(self, path):
        return path.suffix == ".shifted"

    def read(self, path, scans, topics):
        return path.name


def test_parts_without_a_base_have_the_defaults_of_their_protocol():
    """As the page on policies says; a reader reads one file unless it says that it takes another with scans."""
    policy = GOAL.make(Forward, None)
    assert policy.seeks_target and not policy.uses_radio and policy.belief is None
    assert LOG_READER.make(Shifted).takes_scans is False


def test_objects_stand_in_for_names():
    """Each kind of part as an object, or as what makes one; what is an object is what is used."""
    mapper = Counted(ClassicalMapper())
    config = EpisodeConfig(
        goal="fused",
        mapper=mapper,
        explorer=FrontierExplorer,
        controller=Controller,
        link_states=Certain(),
        max_steps=4,
        simulator=SimulatorConfig(
            physics=KinematicWorld,
            camera=EmbreeCamera,
            recognition=Blind,
            radio=RadioLinkConfig(estimator=PcaEstimator),
        ),
    )
    building = make_building(two_rooms(0.8))
    places = reach(building, 0.1)
    log, _ = run_episode(building, places, make_task(places, np.random.default_rng(1)), config)
    assert mapper.calls >= 5
    assert {link.believed for link in log.links} == {LinkState.FIRST_ORDER}
    values = to_dict(config)
    assert values["link_states"] == {"part": f"{__name__}:Certain"}
    assert values["explorer"] == {"part": "slam.exploration.explorer:FrontierExplorer"}
    with code_allowed():
        assert from_dict(EpisodeConfig, values).explorer is FrontierExplorer


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--goal mine:Strait", "goal is 'mine:Strait', but 'mine' has no 'Strait'. Did you mean 'Straight'?"),
        ("--goal yours:Straight", "goal is 'yours:Straight', but there is no module 'yours'"),
        ("--goal mine:WALL", "a Material without goal. A goal policy has goal"),
        ("--goal broken:Straight", "importing 'broken' fails: ZeroDivisionError"),
        ("--goal mine:panel", "but making it from a robosim.policies.goals.PolicyContext fails: TypeError"),
        ("--mapper mine:read", "mapper is mine:read, but making it from"),
        (
            "--robot unknown.yaml",
            "robot is 'unknown.yaml', but there is no such file. Known without a file: turtlebot",
        ),
        ("--robot broken.yaml", "broken.yaml: not readable as a robot (a key is 'legs'. Known: "),
        ("--building.wall-material mine:BORD", "'mine' has no 'BORD'. Did you mean 'BOARD'?"),
        ("--config mine.py", "mine.py"),
        ("--config broken.yaml", "broken.yaml"),
    ],
)
def test_parts_that_are_none_are_rejected_in_one_line(options, words, strangers_folder, fails):
    (strangers_folder / "broken.py").write_text("1 / 0\n")
    (strangers_folder / "broken.yaml").write_text("legs: 2\n")
    assert words in fails("episode", "cottage", *options.split(), "--out", "out")
    assert not (strangers_folder / "out").exists()
