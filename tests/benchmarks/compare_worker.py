"""Processor seconds of five short tasks, by name as JSON, with the packages that the interpreter finds.

Run by `tests.benchmarks.compare` with the packages of two commits, so this file imports public names only, and none of
`tests`. Each task is called once before it counts.
"""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import robosim
import wireless


def main() -> None:
    """Print the seconds."""
    building = robosim.make_building(robosim.read_plan("flat"))
    places = robosim.reach(building, 0.1)
    task = robosim.make_task(places, np.random.default_rng(1))
    receivers = robosim.receiver_grid(building, 0.5, 1.5).position
    environment = robosim.TargetSearch("flat")

    def search(goal: str, mapper: str) -> None:
        config = robosim.EpisodeConfig(goal=goal, mapper=mapper, max_steps=40)
        robosim.run_episode(building, places, task, config)

    def steps() -> None:
        environment.reset(seed=1)
        for _ in range(500):
            environment.step(1)

    tasks: dict[str, Callable[[], Any]] = {
        "import": lambda: subprocess.run([sys.executable, "-c", "import robosim.cli"], check=True),
        "trace": lambda: wireless.Tracer(building.mesh).trace(
            np.array([[7.0, 7.0, 1.5]]), receivers, workers=1
        ),
        "search": lambda: search("fused", "neural"),
        "explore": lambda: search("explore", "classical"),
        "environment": steps,
    }
    for action in tasks.values():
        action()
    sys.stdout.write(json.dumps({name: _seconds(action) for name, action in tasks.items()}) + "\n")


def _seconds(action: Callable[[], Any]) -> float:
    """Processor time of this process and of those that it waited for [s]."""
    begin = _processor()
    action()
    return _processor() - begin


def _processor() -> float:
    import resource

    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


if __name__ == "__main__":
    main()
