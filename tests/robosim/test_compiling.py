"""The process that compiles beside the first: it calls all that an episode calls."""

import subprocess
import sys

#: Names and types of the loops that two calls need, each in a process of its own.
CODE = """
import sys
import numpy as np
from dataclasses import replace
from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.compiling import compile_loops, compiled_beside
from robosim.episode import EpisodeConfig, run_episode
from robosim.plans.files import read_plan
from robosim.task.tasks import make_task
from slam.support import compiled as of_slam
from wireless.support import compiled as of_wireless

for package in (of_slam, of_wireless):
    # What loops call of others is compiled only where it is not on disk, by whichever process is the first.
    def compile(self, sig, before=package._Loop.compile):
        sys.stdout.write(f"{self._cache._name} {sig}" + chr(10))  # whole lines, whatever the thread
        return before(self, sig)
    package._Loop.compile = compile

config = EpisodeConfig(seed=2, max_steps=12)
if sys.argv[1] == "beside":
    compile_loops(config)
else:
    building = make_building(read_plan("cottage"))
    places = reach(building, 0.1, config.simulator.robot.height_m)
    run_episode(building, places, make_task(places, np.random.default_rng(2)), config)
"""


def needed(what: str) -> set[str]:
    done = subprocess.run([sys.executable, "-c", CODE, what], capture_output=True, text=True, check=True)
    return {line for line in done.stdout.splitlines() if line.startswith(("robosim.", "slam.", "wireless."))}


def test_it_calls_every_loop_of_an_episode():
    """For the same types of arguments: otherwise they would be compiled after all, one after the other."""
    episode = needed("episode")
    assert len(episode) > 10
    assert not episode - needed("beside")
