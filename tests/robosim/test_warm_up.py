"""After the warm-up an episode compiles nothing."""

import os
import subprocess
import sys
from pathlib import Path

#: A short episode.
CODE = """
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


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder)}
    return subprocess.run([sys.executable, *command], env=environment, capture_output=True, text=True)


def test_an_episode_compiles_nothing_after_the_warm_up(tmp_path):
    """Without it, the episode says that it compiles. Both have the same results (see the tests of episodes)."""
    done = run(["-m", "robosim", "warm-up"], tmp_path)
    assert done.returncode == 0 and "Compiled" in done.stdout, done.stderr
    files = set(tmp_path.rglob("*.nbc"))
    assert len(files) > 100
    assert "robosim warm-up" not in run(["-c", CODE], tmp_path).stderr
    assert set(tmp_path.rglob("*.nbc")) == files
    assert "All loops were compiled before" in run(["-m", "robosim", "warm-up"], tmp_path).stdout


def test_without_a_cache_folder_it_is_an_error(tmp_path, monkeypatch):
    """The message names the remedy."""
    (tmp_path / "robosim").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    done = run(["-m", "robosim", "warm-up"], tmp_path)
    assert done.returncode == 2
    assert "Set NUMBA_CACHE_DIR to a writable folder" in " ".join(done.stderr.split())
