"""A second process that compiles loops beside the first, where none have been compiled yet.

Loops are compiled when they are first called, one after the other, and kept on disk; what one process is compiling
others wait for (`slam.support.compiled_files`). So a process that calls the same loops in another order does half of
the work: this one starts with the tracer and the mapper, which an episode comes to last, after walls and the radio's
receiver. It runs a small episode for that, whose result nobody wants.
"""

import gc
import logging
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

import numpy as np

from robosim.building.building import Building, make_building
from robosim.building.reach import reach
from robosim.episode import EpisodeConfig, run_episode
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.radio.link import RadioLinkConfig
from robosim.support.processes import Processes
from robosim.task.tasks import make_task
from slam.support import compiled_files as of_slam
from wireless.support import compiled_files as of_wireless
from wireless.tracing.tracer import Tracer


@contextmanager
def compiled_beside(config: EpisodeConfig) -> Iterator[None]:
    """Inside of the block, the first loop that has to be compiled starts the second process; with one core it does not.

    Args:
        config: The episode that is going to be run.
    """
    pools: list[Processes] = []
    packages = (of_slam, of_wireless)

    def start() -> None:
        forget()
        if threading.current_thread() is threading.main_thread():
            pools.append(Processes(1))
            pools[0].submit(compile_loops, config)

    def forget() -> None:
        for package in packages:
            with suppress(ValueError):
                package.when_first.remove(start)

    if len(os.sched_getaffinity(0)) > 1:
        for package in packages:
            package.when_first.append(start)
    try:
        yield
    finally:
        forget()
        for pool in pools:
            pool.kill()
            pool.shutdown(wait=False)


def compile_loops(config: EpisodeConfig) -> None:
    """Call every loop of an episode once, those last that an episode calls first."""
    logging.disable(logging.WARNING)
    gc.disable()  # the process ends with the last loop
    building = make_building(_two_rooms(), config=config.building)
    _trace(building, config.simulator.radio)
    places = reach(building, config.simulator.robot.radius_m, config.simulator.robot.height_m)
    task = make_task(places, np.random.default_rng(0))
    short = replace(config, max_steps=3)
    run_episode(building, places, task, replace(short, goal="explore"))
    run_episode(building, places, task, short)


def _trace(building: Building, config: RadioLinkConfig) -> None:
    """One link, from the middle of one room to that of the other."""
    tx, rx = [[4.5, 1.5, config.height_m]], [[1.5, 1.5, config.height_m]]
    tracer = Tracer(building, frequency_hz=config.frequency_hz, config=config.tracer)
    tracer.trace(np.array(tx), np.array(rx), workers=1)


def _two_rooms() -> FloorPlan:
    """Two rooms with a door between them, 6 m by 3 m."""
    occupancy = np.full((62, 122), OCCUPIED, np.uint8)
    occupancy[1:-1, 1:-1] = FREE
    occupancy[1:40, 60:63] = OCCUPIED
    return FloorPlan(occupancy=occupancy, resolution_m=0.05, name="two rooms")
