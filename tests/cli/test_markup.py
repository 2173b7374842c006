"""Names from outside are printed as they are: brackets, colons and dollars in them mean nothing."""

import re
import subprocess
import sys
from dataclasses import replace

import pytest

from robosim.cli import main
from robosim.commands import output as terminal
from robosim.plans.files import write_ros
from robosim.support.installation import install_command
from tests.plans import room, two_rooms

#: Names that Rich, its emojis or matplotlib's formulas would treat as theirs, or stumble over.
NAMES = ["[red]x[b]", "a[X,Y]", "x[link=file]", ":smile:", "a$_{$b", "[not"]


@pytest.fixture(params=["pipe", "terminal"])
def shown(request, monkeypatch, capsys):
    """What a command prints, into a pipe or to a terminal, where bars are drawn too."""
    if request.param == "terminal":
        monkeypatch.setattr(terminal.console, "_force_terminal", True)

    def run(*arguments: object) -> str:
        main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]|\s+", " ", captured.out + captured.err)

    return run


def plan_of(name: str, folder, plan=None):
    """A floor plan of a name, in a folder of the same name."""
    path = folder / name / f"{name}.yaml"
    path.parent.mkdir(parents=True)
    write_ros(replace(plan or two_rooms(0.8), name=name), path)
    return path


@pytest.mark.parametrize("name", NAMES)
def test_plans_and_folders_of_any_name(name, tmp_path, monkeypatch, shown):
    monkeypatch.chdir(tmp_path)
    plan = plan_of(name, tmp_path)
    out = f"{name} out"
    printed = shown("plan", plan, "--out", out)
    assert f"{name} : 124 x 60 cells" in printed.replace(f"{name}:", f"{name} :")
    assert f"in {out}" in printed
    assert f"'{out}/{name}'.yaml" in printed


def test_an_episode_in_a_plan_of_any_name(tmp_path, monkeypatch, shown):
    monkeypatch.chdir(tmp_path)
    plan = plan_of(NAMES[0], tmp_path)
    options = "--goal oracle --physics kinematic --camera embree --image.height 32 --max-steps 3 --no-video"
    printed = shown("episode", plan, *options.split(), "--mapper", "classical", "--out", f"{NAMES[0]} out")
    assert f"in {NAMES[0]} out" in printed


@pytest.mark.usefixtures("in_process")
def test_an_evaluation_of_plans_of_any_name(tmp_path, monkeypatch, shown):
    monkeypatch.chdir(tmp_path)
    plans = [plan_of(name, tmp_path) for name in (NAMES[0], NAMES[4])]
    options = (
        "--policies explore --physics kinematic --camera embree --image.height 32 --max-steps 3 --targets 1"
    )
    printed = shown("evaluate", *plans, *options.split(), "--mapper", "classical", "--out", f"{NAMES[1]} out")
    assert f"in {NAMES[1]} out" in printed


@pytest.mark.usefixtures("in_process")
def test_tracing_a_plan_of_any_name(tmp_path, monkeypatch, shown):
    monkeypatch.chdir(tmp_path)
    plan = plan_of(NAMES[4], tmp_path)
    printed = shown("trace", plan, "--tx", "1,1", "--grid", "1.5", "--no-diffraction", "--out", NAMES[0])
    assert f"{NAMES[4]}_Tx_*.csv" in printed
    assert f"in {NAMES[0]}" in printed
    assert f"cd '{NAMES[0]}'" in printed
    again = shown("trace", plan, "--tx", "1,1", "--grid", "1.5", "--no-diffraction", "--out", NAMES[0])
    assert f"{NAMES[0]} holds 8 of the 8 links; resuming from there." in again


@pytest.mark.parametrize("path", ["x[/b].yaml", "[/]", ":smile:.png", "[red]x[/red].yaml"])
def test_a_file_that_is_not_there_is_named(path, fails):
    assert f"robosim: {path}: no such file" in fails("plan", path)


def test_what_to_install_is_named_with_its_extra(monkeypatch, fails, tmp_path):
    monkeypatch.setitem(sys.modules, "distributed", None)
    message = fails("collect", "--homes", 1, "--cluster", "tcp://[b]:1", "--out", tmp_path / "o")
    assert f"`{install_command('cluster')}`" in message


@pytest.mark.parametrize("word", ["[/b]", "[red]x", ":smile:"])
def test_what_is_unknown_is_repeated(word, fails):
    assert word in fails("episode", "flat", "--physics", word)
    assert word in fails(word)


def test_warnings_name_plans_as_they_are(tmp_path):
    """In a process of its own, since the tests handle logs differently."""
    plan = plan_of(NAMES[0], tmp_path, room(1.0, 1.0))
    options = "--goal oracle --physics kinematic --camera embree --image.height 32 --max-steps 2 --no-video"
    done = subprocess.run(
        [sys.executable, "-m", "robosim", "episode", plan, *options.split(), "--mapper", "classical"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=True,
    )
    assert f"{NAMES[0]}: no two places 3.0 m of path apart" in re.sub(r"\s+", " ", done.stderr)
