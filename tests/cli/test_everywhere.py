"""What works with every command, wherever it stands: --version, --quiet, --json; and completion in a shell."""

import ast
import inspect
import json
import re
import subprocess
import sys
import textwrap
from importlib.metadata import version
from pathlib import Path

import matplotlib
import pytest
import trimesh

from robosim import doctor
from robosim.cli import main
from robosim.commands.command_table import COMMANDS, load_command
from robosim.commands.output import console

FUNCTIONS = {name: load_command(name) for name in COMMANDS}


@pytest.mark.parametrize("line", ["--version", "plan --version", "plan flat --quiet --version --radius 0.2"])
def test_the_version_is_reported_and_nothing_done(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    main(line.split())
    assert capsys.readouterr().out == f"robosim {version('robosim-wireless')}\n"
    assert not list(tmp_path.iterdir())


def test_the_help_of_all_names_what_works_everywhere(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    printed = capsys.readouterr().out
    assert all(word in printed for word in ("--quiet", "--json", "--debug", "--version"))


def help_of(line: str, capsys) -> str:
    with pytest.raises(SystemExit) as stop:
        main(line.split())
    assert stop.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_each_command_names_what_all_have(name, capsys):
    printed = help_of(f"{name} --help", capsys)
    assert all(f" {word} " in printed for word in ("--quiet", "--json", "--debug", "--figures"))


@pytest.mark.parametrize("group", ["", "train "])
def test_help_all_of_groups_lists_their_commands(group, capsys):
    assert help_of(f"{group}--help-all", capsys) == help_of(f"{group}--help", capsys)


#: Most options in the brief help of commands with many, those of every command included.
BRIEF = {"episode": 26, "evaluate": 26, "calibrate": 20, "trace": 26}


def options_in(text: str) -> list[str]:
    return re.findall(r"^\W+ (--[a-z][a-z0-9.-]*)", text, re.MULTILINE)


@pytest.mark.parametrize("name", BRIEF)
def test_help_is_brief_and_help_all_shows_every_option(name, capsys):
    """What the brief help leaves out is counted or named in it; names of materials stand nowhere twice."""
    brief, whole = (help_of(f"{name} {option}", capsys) for option in ("--help", "--help-all"))
    shown, every = options_in(brief), options_in(whole)
    assert len(shown) <= BRIEF[name] and set(shown) < set(every)
    counts = re.findall(r"^--\S.* \((\d+) options\): ", brief, re.MULTILINE)
    singles = re.findall(r"^(--[a-z-]+)$", brief, re.MULTILINE)
    assert sum(map(int, counts)) + len(singles) == len(set(every) - set(shown))
    assert set(singles) < set(every) and "--help-all" in brief
    assert whole.count("very_dry_ground") == 1


def test_help_shows_ranges_and_units(capsys):
    whole = " ".join(help_of("episode --robot locobot --help-all", capsys).replace("│", "").split())
    assert "(default: 0.18; range: 0.001 to 5 m)" in whole
    assert "--radio.tracer.max-transmissions INT" in whole and "(range: 0 to 12 walls)" in whole


def test_figures_of_a_command_in_another_format(plan_file, tmp_path, capsys):
    answer(f"plan {plan_file} --figures svg --out {tmp_path}", capsys)
    assert {"reach.png", "reach.svg"} <= {path.name for path in tmp_path.iterdir()}
    assert matplotlib.rcParams["savefig.format"] == "png"


@pytest.mark.parametrize("place", [0, 1, 2, 4])
def test_quiet_says_nothing_but_does_the_same(place, plan_file, tmp_path, capsys):
    words = ["plan", str(plan_file), "--out", str(tmp_path / "out")]
    words.insert(place, "--quiet")
    main(words)
    assert capsys.readouterr() == ("", "")
    assert (tmp_path / "out" / "building.glb").is_file()
    assert not console.quiet


def test_quiet_prints_errors(fails):
    assert "radius is 9" in fails("plan", "--quiet", "flat", "--radius", "9")


def test_quiet_keeps_warnings_to_itself(tmp_path, caplog):
    """A box with its faces to the outside is treated as a room turned inside out, which is a warning."""
    trimesh.creation.box((4, 3, 2.5)).export(tmp_path / "room.stl")
    main(f"plan {tmp_path}/room.stl --out {tmp_path}/out".split())
    assert "inside out" in caplog.text
    caplog.clear()
    main(f"plan {tmp_path}/room.stl --quiet --out {tmp_path}/out".split())
    assert not caplog.text


def answer(line: str, capsys) -> dict:
    """What a command prints with --json, which must be all that it prints to standard output."""
    main([*line.split(), "--json"])
    printed = capsys.readouterr().out
    assert printed.count("\n") == 1
    return json.loads(printed)


def test_plan_as_json(plan_file, tmp_path, capsys):
    printed = answer(f"plan {plan_file} --out {tmp_path}", capsys)
    assert printed["plan"] == "two rooms" and printed["out"] == str(tmp_path)
    assert printed["free_m2"] == pytest.approx(18.2, abs=0.05)
    assert printed["parts"] == 1 and printed["cut_off"] == []


def test_generated_plans_as_json(tmp_path, capsys):
    printed = answer(f"generate --count 2 --seed 4 --out {tmp_path}", capsys)
    assert len(printed["plans"]) == 2 and all((tmp_path / name).is_file() for name in printed["plans"])


def test_traced_links_as_json(plan_file, tmp_path, capsys):
    """The same as in trace.json; of one link, paths and the state of each transmitter."""
    grid = answer(f"trace {plan_file} --tx 1,1 --grid 1 --no-plots --workers 1 --out {tmp_path}/grid", capsys)
    stored = json.loads((tmp_path / "grid" / "trace.json").read_text())
    assert {**stored, "out": f"{tmp_path}/grid"} == grid
    link = answer(f"trace {plan_file} --tx 1,1 --rx 2,1 --out {tmp_path}/link", capsys)
    assert link["paths"] > 1 and link["states"] == ["los"] and link["rx_m"] == [2.0, 1.0, 1.5]


@pytest.mark.usefixtures("in_process")
def test_a_data_set_as_json(plan_file, tmp_path, capsys):
    """Entries of manifest.json, with the number of units in their place, and the time that the run took."""
    printed = answer(f"dataset {plan_file} --tx-per-plan 1 --grid 1 --workers 1 --out {tmp_path}", capsys)
    stored = json.loads((tmp_path / "manifest.json").read_text())
    assert printed["units"] == len(stored.pop("units"))
    assert stored.items() <= printed.items() and printed["timing"]["links"] == stored["rows"]


@pytest.mark.parametrize("works", [True, False])
def test_the_machine_as_json(works, monkeypatch, capsys):
    """Findings one by one, and whether all is well; the exit status says so too."""
    finding = doctor.Finding("camera", works, "draws on [red]OSMesa", "" if works else "install it")
    monkeypatch.setattr(doctor, "examine", lambda: [finding])
    if works:
        printed = answer("doctor", capsys)
    else:
        with pytest.raises(SystemExit) as stop:
            main(["doctor", "--json"])
        assert stop.value.code == 1
        printed = json.loads(capsys.readouterr().out)
    assert printed["works"] == works and printed["robosim"] == version("robosim-wireless")
    assert printed["findings"][0]["detail"] == "draws on [red]OSMesa"


def test_an_episode_as_json(plan_file, tmp_path, capsys):
    """The same as in result.json."""
    options = "--goal oracle --physics kinematic --camera embree --image.height 32 --max-steps 3 --no-video"
    printed = answer(f"episode {plan_file} {options} --mapper classical --out {tmp_path}", capsys)
    assert {**json.loads((tmp_path / "result.json").read_text()), "out": str(tmp_path)} == printed


@pytest.mark.usefixtures("in_process")
def test_an_evaluation_as_json(plan_file, tmp_path, capsys):
    """The same as in summary.json, and what to know before trusting it."""
    options = (
        "--targets 1 --policies explore --physics kinematic --camera embree --image.height 32 --max-steps 3"
    )
    printed = answer(
        f"evaluate {plan_file} {options} --workers 1 --mapper classical --out {tmp_path}", capsys
    )
    assert {row["policy"] for row in printed["summary"]} == {"oracle", "explore"}
    assert printed["summary"] == json.loads((tmp_path / "summary.json").read_text())["summary"]
    assert printed["warnings"] == [] and printed["out"] == str(tmp_path)


def test_errors_leave_standard_output_to_results(capsys):
    """With --json an error is one line on standard error, and the status says so."""
    with pytest.raises(SystemExit) as stop:
        main(["plan", "no_such_plan", "--json"])
    captured = capsys.readouterr()
    assert stop.value.code == 2 and captured.out == ""
    assert "no such file, and no shipped plan of that name" in " ".join(captured.err.split())


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_hands_over_its_result(name):
    """Each calls `emit_result` or `emit_result_file`, so that none is silent with --json."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(FUNCTIONS[name])))
    called = {
        node.func.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    assert called & {"emit_result", "emit_result_file"}


def test_a_reader_that_has_seen_enough_is_no_error(plan_file, tmp_path):
    """As of `robosim plan office --json | true`: no message, and the status of a broken pipe."""
    words = [
        sys.executable,
        "-m",
        "robosim",
        "plan",
        str(plan_file),
        "--json",
        "--out",
        str(tmp_path / "out"),
    ]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 141


@pytest.fixture(scope="module")
def completion(tmp_path_factory) -> Path:
    """What a shell reads to complete commands."""
    path = tmp_path_factory.mktemp("shell") / "robosim.bash"
    run = subprocess.run(
        [sys.executable, "-m", "robosim", "--tyro-print-completion", "bash"], capture_output=True, check=True
    )
    path.write_bytes(run.stdout)
    return path


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("robosim ep", {"episode"}),
        ("robosim train link", {"link-state"}),
        ("robosim train mapper --smo", {"--smoke"}),
        ("robosim episode flat --goal lo", {"los", "los-or-first"}),
    ],
)
def test_bash_completes_commands_of_groups_options_and_choices(typed, offered, completion):
    """As bash does it: words so far in COMP_WORDS, what may follow in COMPREPLY."""
    words = typed.split(" ")
    script = (
        f"source {completion}; COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; _tyro_robosim; "
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    run = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert set(run.stdout.split()) == offered
