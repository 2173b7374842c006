"""Every command on small input: what it prints, what it writes, and how it fails."""

import errno
import inspect
import os
import re
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from robosim.cli import main
from robosim.commands.command_table import COMMANDS, GROUPS, command_summary, load_command
from robosim.commands.episode import episode
from robosim.episode_config import EpisodeConfig
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE
from tests.plans import two_rooms

WORDS = ["", *COMMANDS, *GROUPS]


@pytest.mark.parametrize("command", WORDS)
def test_every_command_explains_itself(command, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*command.split(), "--help"])
    assert stop.value.code == 0
    assert f"usage: robosim {command}".strip() in capsys.readouterr().out


def test_an_episode_with_every_option(plan_file, tmp_path, capsys):
    out = tmp_path / "run"
    main(
        f"episode {plan_file} --start 1,0.6,90 --target 5,2.4 --goal explore --seed 3 --physics kinematic "
        f"--camera embree --robot locobot --noise.level 0 --image.width 64 --max-steps 8 "
        f"--building.tolerance-m 0.05 --no-video "
        f"--out {out}".split()
    )
    printed = capsys.readouterr().out
    assert "out of steps after 8 steps" in printed
    assert "evo_ape tum" in printed
    assert not (out / "episode.mp4").exists()
    first = (out / "trajectory.tum").read_text().splitlines()[0].split()
    assert [float(value) for value in first[1:3]] == [1.0, 0.6]


def test_a_command_and_the_library_have_the_same_defaults():
    """`robosim episode PLAN` runs what `EpisodeConfig()` says, the goal policy included."""
    assert inspect.signature(episode).parameters["settings"].default == EpisodeConfig()
    assert inspect.signature(episode).parameters["goal"].default == EpisodeConfig().goal


def test_the_list_of_commands_says_what_they_say():
    """Read from their files, so that a list imports none."""
    for name in COMMANDS:
        assert " ".join(load_command(name).__doc__.split("\n\n")[0].split()) == command_summary(name)


def test_negative_coordinates_are_no_options(plan_file, fails):
    message = fails("episode", plan_file, "--target", "-3,-4", "--no-video")
    assert "the target (-3, -4) m is in a wall, or outside of the building" in message


def test_a_plan_is_shown_and_exported(plan_file, tmp_path, capsys):
    main(["plan", str(plan_file), "--out", str(tmp_path / "shown")])
    assert "18.2 m2 free" in re.sub(r"\s+", " ", capsys.readouterr().out)
    names = {path.name for path in (tmp_path / "shown").iterdir()}
    assert {"building.glb", "building.ply", "mitsuba", "mujoco.xml", "reach.png"} <= names
    again = read_plan(next((tmp_path / "shown").glob("*.yaml")))
    assert (again.occupancy == two_rooms(0.8).occupancy).all()


def test_plan_counts_parts_too_small_for_a_room(tmp_path, capsys):
    """A room, and a nook of half a metre without a door."""
    cells = np.ones((80, 100), np.uint8)
    cells[5:75, 5:75] = cells[5:15, 85:95] = 0
    np.save(tmp_path / "nook.npy", cells)
    main(f"plan {tmp_path}/nook.npy --resolution 0.05 --out {tmp_path}/out".split())
    assert "can drive in 2 separate parts of it (1 of less than 1 m2)" in capsys.readouterr().out


def test_a_mesh_in_another_unit_with_another_axis_up(tmp_path, capsys):
    """A room of 4 m x 3 m in millimetres, y up, as an OBJ: the options of both reach the reader."""
    room = trimesh.creation.box(bounds=[[0, 0, -3000], [4000, 2500, 0]])
    room.invert()
    room.export(tmp_path / "room.obj")
    main(f"plan {tmp_path}/room.obj --unit 0.001 --up y --out {tmp_path}/out".split())
    printed = re.sub(r"\s+", " ", capsys.readouterr().out)
    assert "12.0 m2 free" in printed
    assert f"Next: robosim episode {tmp_path}/out/room.yaml" in printed


@pytest.mark.parametrize(
    ("command", "word"),
    [
        ("generate --count 0", "count is 0"),
        ("generate --seed -1", "seed is -1"),
        ("episode flat --seed -1", "seed is -1"),
    ],
)
def test_senseless_numbers_are_named(command, word, tmp_path, fails):
    assert word in fails(*command.split(), "--out", tmp_path)


def test_out_may_not_be_a_file(plan_file, fails):
    assert "is no folder. Choose another" in fails("plan", plan_file, "--out", plan_file)


def test_an_episode_that_ends_at_once_says_what_it_wrote(plan_file, tmp_path, capsys):
    """Start at the target: no decision, so no film, and none of an earlier episode is left next to the result."""
    earlier = ("episode.mp4", "episode_bag/a.mcap", "foxglove.json")
    (tmp_path / "episode_bag").mkdir()
    for name in earlier:
        (tmp_path / name).write_text("of an earlier episode")
    main(f"episode {plan_file} --start 1,0.6,0 --target 1,0.6 --physics kinematic --out {tmp_path}".split())
    printed = capsys.readouterr().out
    assert "arrived after 0 steps" in printed
    assert "episode.mp4" not in printed
    assert not any((tmp_path / name).exists() for name in earlier)


def test_plans_are_generated(tmp_path, capsys):
    main(["generate", "--seed", "5", "--count", "2", "--out", str(tmp_path)])
    plans = [read_plan(path) for path in sorted(tmp_path.glob("*.yaml"))]
    assert len(plans) == 2
    assert "Wrote 2 plans" in capsys.readouterr().out


def test_offices_of_a_given_size_are_generated(tmp_path):
    """800 m2 of rooms, of which furniture takes a part."""
    main(f"generate --style office --area-m2 800 --rooms 20 --out {tmp_path}".split())
    plan = read_plan(tmp_path / "office-0.yaml")
    free_m2 = (plan.occupancy == FREE).sum() * plan.resolution_m**2
    assert 500 < free_m2 < 850


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["episode", "nowhere.yaml"], "nowhere.yaml"),
        (["plan", "flatt"], "flat"),
        (["episode", "flat", "--target", "1"], "X,Y"),
        (["episode", "flat", "--target", "1,nan"], "X,Y"),
        (["episode", "flat", "--noise.level", "-1"], "noise"),
        (["episode", "flat", "--max-steps", "0"], "max_steps"),
        (["episode", "flat", "--image.width", "0"], "width"),
        (["episode", "flat", "--building.tolerance-m", "-0.1"], "tolerance"),
        (["epsiode", "flat"], "episode"),
    ],
)
def test_mistakes_end_in_one_sentence(arguments, message, fails):
    assert message in fails(*arguments)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS])
def test_a_disk_that_takes_no_more_is_failed_work(number, monkeypatch, capsys):
    """Full, limited or read-only: status 1, and a line that names the file and the remedy."""

    def write(words):
        raise OSError(number, os.strerror(number), "out/map.png")

    monkeypatch.setattr("robosim.cli._run", write)
    with pytest.raises(SystemExit) as stop:
        main(["plan", "flat"])
    assert stop.value.code == 1
    message = " ".join(capsys.readouterr().err.split())
    assert "cannot write (out/map.png)" in message and "choose another --out" in message


def test_the_doctor_finds_this_machine_fit():
    """In a process of its own, as a user runs it: both exit status and text say that all is well."""
    done = subprocess.run(
        [sys.executable, "-m", "robosim", "doctor"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "All that the main job needs is here" in re.sub(r"\s+", " ", done.stdout)
    for part in ("mujoco", "embree", "OSMesa", "onnxruntime", "torch"):
        assert part in done.stdout
