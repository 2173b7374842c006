"""Commands on pages parse, Python on pages runs, and citations are in the bibliography."""

import functools
import importlib
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import robosim.cli as cli
from robosim.commands.command_table import load_command
from robosim.robot.robots import RobotConfig
from tests.docs.conftest import Ended
from tests.docs.run_page import commands_in, run_page, write_named_blocks

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(path for path in DOCS.rglob("*.md") if not {"_build", "examples", "commands"} & set(path.parts)),
]
_FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page: Path, language: str) -> list[str]:
    """Fenced blocks of a page in a language."""
    return [body for name, body in _FENCE.findall(page.read_text("utf-8")) if name == language]


def commands(page: Path) -> list[str]:
    """Calls of robosim on a page: after the prompt in console blocks, or in blocks without a language."""
    plain = "".join(re.findall(r"^```\n(.*?)^```$", page.read_text("utf-8"), re.MULTILINE | re.DOTALL))
    return commands_in("".join(blocks(page, "console")) + plain)


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=lambda page: page.name)
def test_commands_exist(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own_modules: None
) -> None:
    """Commands, options and their values parse; nothing is run.

    Files that a page creates exist with minimal content, configurations are not read, and custom parts are those of the
    page on parts.
    """
    monkeypatch.chdir(tmp_path)
    write_named_blocks(DOCS / "tasks" / "parts.md", tmp_path)
    monkeypatch.syspath_prepend(tmp_path)

    def idle(name: str) -> Callable[..., None]:
        @functools.wraps(load_command(name))
        def nothing(*args: object, **options: object) -> None: ...

        return nothing

    monkeypatch.setattr(cli, "load_command", idle)
    for line in commands(page):
        words = [word for word in shlex.split(line)[1:] if word not in cli._EVERYWHERE]
        if "--config" in words:
            del words[words.index("--config") : words.index("--config") + 2]
        for word in words:
            if word.endswith((".safetensors", ".yaml", ".csv", ".urdf")):
                (tmp_path / word).parent.mkdir(parents=True, exist_ok=True)
                (tmp_path / word).write_text("radius_m: 0.17\n", "utf-8")
        try:
            cli._run(words)
        except SystemExit as end:
            assert end.code in (None, 0), line


#: Pages whose commands run too, shortened, because the page creates their input or reads their output. Other commands
#: need files of the reader, or hours; all of them are parsed above.
WITH_COMMANDS = {
    "dataset.md",
    "environment.md",
    "evaluate.md",
    "furnish.md",
    "look.md",
    "parts.md",
    "policy.md",
}


@pytest.mark.parametrize(
    "page", [page for page in PAGES if blocks(page, "python")], ids=lambda page: page.name
)
def test_python_runs(page: Path, tmp_path: Path, separate_process: Callable[..., Ended]) -> None:
    """Blocks of a page run in order and print what the page shows."""
    trimesh.creation.box((400, 400, 900)).export(
        tmp_path / "chair.stl"
    )  # a mesh of the reader, in millimetres
    tutorial = page.name == "tutorial.md"
    ended = separate_process(
        run_page, page, tutorial or page.name in WITH_COMMANDS, not tutorial, folder=tmp_path
    )
    assert ended.status == 0, ended.output[-3000:]


def test_all_python_blocks_run() -> None:
    """Python blocks have the one language name under which they run."""
    for page in PAGES:
        named = set(re.findall(r"^```(\{?[\w-]+.*)$", page.read_text("utf-8"), re.MULTILINE))
        assert not named & {"py", "Python", "pycon", "{code-block} python"}, page


def test_mapper_on_the_page_of_parts(tmp_path: Path, separate_process: Callable[..., Ended]) -> None:
    """It resets its map at the 100th scan and accepts laser scans, among people too: 130 decisions of exploring."""
    ended = separate_process(_explore, DOCS / "tasks" / "parts.md", folder=tmp_path)
    assert ended.status == 0, ended.output[-3000:]


def _explore(page: Path) -> int:
    from robosim import (
        EpisodeConfig,
        SimulatorConfig,
        make_building,
        make_task,
        reach,
        read_plan,
        run_episode,
    )
    from robosim.movers.movers import MoversConfig

    names: dict[str, Any] = {}
    exec(blocks(page, "python")[0], names)
    config = EpisodeConfig(
        goal="explore",
        mapper=names["Mapper"],
        simulator=SimulatorConfig(
            physics="kinematic", robot=RobotConfig(lidar="lds-01"), movers=MoversConfig(people=1)
        ),
        max_steps=130,
    )
    building = make_building(read_plan("office"))
    places = reach(building, radius_m=0.10)
    log, _ = run_episode(building, places, make_task(places, np.random.default_rng(1)), config)
    return int(log.steps != 130)


def test_citations() -> None:
    """Every source that is cited is in the bibliography."""
    known = set(re.findall(r"^@\w+\{([\w-]+),", (DOCS / "references.bib").read_text("utf-8"), re.MULTILINE))
    cited = {
        key.strip()
        for page in DOCS.rglob("*.md")
        if "_build" not in page.parts
        for keys in re.findall(r"\{cite(?::\w+)?\}`([^`]+)`", page.read_text("utf-8"))
        for key in keys.split(",")
    }
    assert cited <= known


@pytest.mark.parametrize("term", ["impulse response", "URDF", "custom reward", "ROS bag", "heat map"])
def test_common_search_terms_are_found(term: str) -> None:
    """A reader who searches for a usual term of the field finds a page."""
    assert any(term.lower() in page.read_text("utf-8").lower() for page in PAGES)


def test_readme_is_short() -> None:
    """At most 120 lines; the rest is in the documentation."""
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) <= 120


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_named_files_exist(page: Path) -> None:
    """Files and folders of the repository that a page names exist."""
    text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    named = re.findall(r"`((?:tests|docs|robosim|slam|wireless|assets|scripts)/[\w./-]+)`", text)
    missing = [name for name in named if not (ROOT / name).exists() and not name.startswith("docs/_build")]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_references_resolve(page: Path) -> None:
    """Python references of a page exist."""
    for target in re.findall(r"\{py:\w+\}`(?:[^`<]*<)?~?([\w.]+)>?`", page.read_text("utf-8")):
        parts = target.split(".")
        for n in range(len(parts), 0, -1):
            try:
                found = importlib.import_module(".".join(parts[:n]))
            except ModuleNotFoundError:
                continue
            break
        for name in parts[n:]:
            assert hasattr(found, name), target
            found = getattr(found, name)


def test_entries_of_the_bibliography_are_closed_and_have_different_keys() -> None:
    """Braces are balanced in each entry; every citation of a page has one."""
    entries = re.split(r"^@", (DOCS / "references.bib").read_text("utf-8"), flags=re.MULTILINE)[1:]
    assert not [entry[:40] for entry in entries if entry.count("{") != entry.count("}")]
    keys = [entry.partition("{")[2].partition(",")[0] for entry in entries]
    cited = [
        key
        for page in PAGES
        for some in re.findall(r"\{cite\}`([^`]+)`", page.read_text("utf-8"))
        for key in some.split(",")
    ]
    assert len(keys) == len(set(keys)) and {key.strip() for key in cited} <= set(keys)
