"""Files that are read run no code: a module next to them, which would leave a mark, is neither imported nor called."""

import json
import shutil
import sys

import numpy as np
import pytest
from PIL import Image

from robosim.cli import main
from robosim.episode_config import EpisodeConfig
from robosim.plans.files import write_ros
from robosim.support.parts import to_dict
from tests.plans import two_rooms

CANARY = "from pathlib import Path\n\n\ndef sing(*given):\n    Path('sung').touch()\n\n\nsing()\n"
SUITE = (
    "reader: canary:sing\nplans: {pair: pair.yaml}\ntasks: [{plan: pair, start: [1, 1, 0], target: [4, 1]}]\n"
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a plan, and a module that leaves a mark."""
    (tmp_path / "canary.py").write_text(CANARY)
    write_ros(two_rooms(0.8), tmp_path / "pair.yaml")
    picture = np.full((40, 60, 3), 254, np.uint8)
    picture[[0, -1]] = picture[:, [0, -1]] = 0
    picture[:, 30] = (0, 0, 255)
    Image.fromarray(picture).save(tmp_path / "blue.png")
    (tmp_path / "blue.yaml").write_text(
        "image: blue.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
        'materials: {"#0000ff": "canary:sing"}\n'
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield tmp_path
    sys.modules.pop("canary", None)


def config(**changes):
    values = to_dict(EpisodeConfig())
    return json.dumps({"config": {**values, **changes}})


@pytest.mark.parametrize(
    ("name", "content", "command"),
    [
        ("blue.yaml", None, "plan blue.yaml"),
        (
            "things.yaml",
            "- {piece: table, at: [1, 1], material: 'canary:sing'}",
            "plan pair.yaml --furnishings things.yaml",
        ),
        ("things.yaml", "- {piece: 'canary:sing', at: [1, 1]}", "plan pair.yaml --furnishings things.yaml"),
        (
            "house.yaml",
            "storeys:\n- {plan: pair.yaml, material: 'canary:sing'}\n",
            "trace house.yaml --tx 1,1",
        ),
        ("house.yaml", "storeys:\n- {plan: 'canary:sing'}\n", "trace house.yaml --tx 1,1"),
        (
            "wall.yaml",
            "layers: [{material: 'canary:sing', thickness_m: 0.1}]",
            "trace pair.yaml --tx 1,1 --material wall.yaml",
        ),
        ("suite.yaml", SUITE, "evaluate suite.yaml"),
        ("result.json", config(mapper="canary:sing"), "episode pair.yaml --config result.json"),
        ("result.json", config(goal={"part": "canary:sing"}), "episode pair.yaml --config result.json"),
        (
            "result.json",
            config(team={"robots": "turtlebot,canary:sing"}),
            "episode pair.yaml --config result.json",
        ),
        ("robot.yaml", "odometry: canary:sing", "episode pair.yaml --robot robot.yaml"),
    ],
)
def test_no_file_runs_code(folder, fails, name, content, command):
    """One line with the file's name, and no mark; files that may name code say so by --allow-code."""
    if content is not None:
        (folder / name).write_text(content)
    message = fails(*command.split())
    assert name in message
    assert not (folder / "sung").exists()
    assert "canary" not in sys.modules


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    """A folder of one collected search, and the words that collect another into it."""
    pytest.importorskip("minari")
    folder = tmp_path_factory.mktemp("collected")
    write_ros(two_rooms(0.8), folder / "pair.yaml")
    words = ["collect-searches", "--plan", str(folder / "pair.yaml"), "--observe", "pose", "--targets", "1"]
    words += ["--most-steps", "5", "--episodes"]
    main([*words, "1", "--out", str(folder / "run")])
    return folder / "run", [*words, "2"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"action_space": None}, "'action_space' is missing"),
        ({"observation_space": "{}"}, "observation_space is '{}', expected '{"),
        ({"data_format": "hdf5"}, "data_format is 'hdf5', expected 'arrow'"),
        ({"jpeg_encoding": 0}, "jpeg_encoding is 0, expected False"),
        ({"total_episodes": 10**9}, "total_episodes is 1000000000, expected 0 to 1."),
        ({"total_episodes": True}, "total_episodes is True"),
        ({"total_steps": "5"}, "total_steps is '5', expected 0 to 5."),
        ({"author": 5}, "not readable as searches"),
    ],
)
def test_metadata_of_collected_searches_run_no_code(
    collected, tmp_path, monkeypatch, fails, changes, message
):
    """Minari makes the environment that `env_spec` names if a space is missing; here that touches a file."""
    source, words = collected
    shutil.copytree(source, tmp_path / "run")
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "run" / "data" / "metadata.json"
    values = json.loads(path.read_text())
    spec = {**json.loads(values["env_spec"]), "entry_point": "os:system", "kwargs": {"command": "touch sung"}}
    values = {**values, "env_spec": json.dumps(spec), **changes}
    path.write_text(json.dumps({key: value for key, value in values.items() if value is not None}))
    said = fails(*words, "--out", "run")
    assert "metadata.json" in said and message in said and "Choose another --out" in said
    assert not (tmp_path / "sung").exists()


def test_code_of_a_suite_runs_where_it_is_allowed(folder, capsys):
    """The option works: what the suite names is imported then."""
    (folder / "suite.yaml").write_text(SUITE)
    with pytest.raises(SystemExit):
        main(["evaluate", "suite.yaml", "--allow-code"])
    assert (folder / "sung").exists()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"simulator": {"robot": {"lidar": 3}}}, "simulator.robot.lidar is 3"),
        ({"building": "x"}, "building is 'x', expected keys and values"),
        ({"building": 5}, "building is 5, expected keys and values"),
        ({"building": {"ceiling": "false"}}, "building.ceiling is 'false', expected true or false"),
        ({"building": {"ceiling": 1}}, "building.ceiling is 1, expected true or false"),
        ({"max_steps": True}, "max_steps is True, expected a whole number"),
        ({"max_steps": 2.5}, "max_steps is 2.5, expected a whole number"),
        ({"building": {"tolerance": 1}}, "a key of building is 'tolerance'. Did you mean 'tolerance_m'?"),
        ({"building": {"height_m": [2.5]}}, "building.height_m is"),
        ({"seed": None}, "seed is None"),
    ],
)
def test_types_of_a_configuration_are_checked(folder, fails, changes, words):
    """As on the command line; groups that were no groups ended in an internal error, and 'false' was true."""
    (folder / "result.json").write_text(config(**changes))
    message = fails("episode", "pair.yaml", "--config", "result.json")
    assert words in message
    assert "result.json" in message and "internal error" not in message


def test_configuration_of_version_0_2_is_rejected(folder, fails):
    """It counted walls by faces, without saying so."""
    values = to_dict(EpisodeConfig())
    del values["simulator"]["radio"]["tracer"]["wall_passage"]
    (folder / "result.json").write_text(json.dumps({"config": values}))
    assert "of version 0.2 of robosim" in fails("episode", "pair.yaml", "--config", "result.json")
