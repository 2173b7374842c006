"""After the warm-up an episode compiles nothing, and the whole warm-up reaches every loop."""

import gc
import importlib
import logging
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import CodeType

import robosim
from robosim.support.compiled import Loop, cache_folders, writable_folder
from robosim.warm_up import call_loops

#: Loops that the warm-up leaves out, as only these call them: environments, collection of frames, training of
#: explorers, and calibration of materials.
LEFT_OUT = {
    "robosim.datasets.true_patch._fill",
    "robosim.datasets.true_patch._kind",
    "robosim.training.grid_walk._mark",
    "wireless.tracing.reweighed.reweigh",
}

#: A short episode.
EPISODE = """
import numpy as np

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.plans.files import read_plan
from robosim.task.tasks import make_task

config = EpisodeConfig(seed=2, max_steps=12, goal="fused")
building = make_building(read_plan("cottage"))
places = reach(building, 0.1, config.simulator.robot.height_m)
run_episode(building, places, make_task(places, np.random.default_rng(2)), config)
"""

#: Versions of loops that are in memory after the warm-up, and those that an episode adds.
VERSIONS = f"""
import sys

from robosim.support.compiled import Loop
from robosim.warm_up import call_loops


def versions():
    loops = {{value for module in list(sys.modules.values()) for value in vars(module).values() if type(value) is Loop}}
    return {{(loop.__module__, loop.__name__, str(types)) for loop in loops for types in loop.dispatcher.signatures}}


for half in range(2):
    call_loops(half, episode=True)
before = versions()
{EPISODE}
print(len(before), sorted(versions() - before))
"""


def run(command: list[str]) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, *command], capture_output=True, text=True)


def test_an_episode_compiles_nothing_after_the_warm_up():
    """An episode calls loops with no types of arguments that the warm-up has not called them with."""
    done = run(["-c", VERSIONS])
    count, new = done.stdout.split(maxsplit=1)
    assert int(count) > 20, done.stderr
    assert new == "[]\n"


def all_loops() -> set[Loop]:
    """Every compiled function of the three packages."""
    top, loops = Path(robosim.__file__).parent.parent, set()
    for package in ("robosim", "slam", "wireless"):
        for file in (top / package).rglob("*.py"):
            if "\n@compiled\n" in file.read_text():
                module = importlib.import_module(".".join(file.relative_to(top).with_suffix("").parts))
                loops |= {value for value in vars(module).values() if isinstance(value, Loop)}
    return loops


def names_in(code: CodeType) -> set[str]:
    """Global names that a function uses, in its comprehensions too."""
    inner = (names_in(constant) for constant in code.co_consts if isinstance(constant, CodeType))
    return set(code.co_names).union(*inner)


def test_warm_up_reaches_every_loop(monkeypatch):
    """Loops that are called, and those that these call in turn, which are compiled with them."""
    reached, call = set(), Loop.__call__
    monkeypatch.setattr(Loop, "__call__", lambda loop, *args: reached.add(loop) or call(loop, *args))
    try:
        call_loops()
    finally:
        logging.disable(logging.NOTSET)
        gc.enable()
    pending = list(reached)
    while pending:
        function = pending.pop().py_func
        values = map(function.__globals__.get, names_in(function.__code__))
        callees = {value for value in values if isinstance(value, Loop)} - reached
        reached |= callees
        pending += callees
    missing = {f"{loop.__module__}.{loop.__name__}" for loop in all_loops() - reached}
    assert missing == LEFT_OUT


def test_an_episode_reads_what_the_warm_up_has_cached(tmp_path, monkeypatch):
    """In other processes. All loops are cached but for some, so that this takes seconds where others have compiled."""
    with suppress(shutil.Error):  # another process writes to the cache
        shutil.copytree(writable_folder(cache_folders()), tmp_path / "robosim")
    for folder in tmp_path.glob("robosim/robosim.policies.route_directions-*"):
        shutil.rmtree(folder)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    done = run(["-m", "robosim", "warm-up", "--episode"])
    assert done.returncode == 0 and "Compiled" in done.stdout, done.stderr
    files = set(tmp_path.rglob("*.nbc"))
    assert len(files) > 100
    assert "robosim warm-up" not in run(["-c", EPISODE]).stderr
    assert set(tmp_path.rglob("*.nbc")) == files
    assert "All loops were compiled before" in run(["-m", "robosim", "warm-up", "--episode"]).stdout


def test_without_a_cache_folder_it_is_an_error(tmp_path, monkeypatch):
    """The message names the remedy."""
    (tmp_path / "robosim").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    done = run(["-m", "robosim", "warm-up"])
    assert done.returncode == 2
    assert "Set NUMBA_CACHE_DIR to a writable folder" in " ".join(done.stderr.split())
