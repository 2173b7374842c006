"""Compile all loops of an episode in advance, in two processes on machines with two cores.

Loops are compiled at their first call and cached on disk (`robosim.support.compiled`). While one process compiles a
loop, others wait for it. Therefore the two processes call the loops of a short episode in different orders.
`views_of` and `trace_links` take most time, and the second needs the result of the first. One process compiles the
first; the other interprets it, which is fast for two rooms, and compiles the second.

Left out: engines of the radio other than `live`.
"""

import gc
import logging
import os
from collections.abc import Callable
from concurrent.futures import FIRST_EXCEPTION, wait
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np

from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.support.compiled import Loop, cache_folders, writable_folder
from robosim.support.processes import Processes

if TYPE_CHECKING:
    from robosim.building.building import Building

#: Interval between reports of progress [s].
_REPORT_S = 0.5


def warm_up(report: Callable[[int], None] = lambda count: None) -> int:
    """Compile and cache the loops of an episode; returns the number of functions compiled, 0 if all were cached.

    `report` is called twice a second with the number so far. ValueError if no cache folder is writable.
    """
    before = _count_cached()
    n_processes = min(2, len(os.sched_getaffinity(0)))
    pool = Processes(n_processes)
    try:
        pending = {pool.submit(call_loops, part) for part in range(n_processes)}
        while pending:
            done, pending = wait(pending, _REPORT_S, FIRST_EXCEPTION)
            for future in done:
                future.result()
            report(_count_cached() - before)
    except BaseException:
        pool.kill()
        raise
    finally:
        pool.shutdown()
    return _count_cached() - before


def call_loops(part: int = 0) -> None:
    """Call every loop of an episode, first those of buildings and transmitters (part 0) or those of links (1)."""
    logging.disable(logging.WARNING)
    gc.disable()  # searches for garbage take a sixth of the time in which numba compiles
    # Here, so that both processes import the simulator at the same time.
    from robosim.building.building import make_building
    from robosim.building.reach import reach
    from robosim.episode import run_episode
    from robosim.episode_config import EpisodeConfig
    from robosim.task.tasks import make_task

    if part == 1:
        with patch.object(Loop, "__call__", _interpret), np.errstate(all="ignore"):
            _trace(make_building(_two_rooms()))
    building = make_building(_two_rooms())
    if part == 0:
        _trace(building)
    robot = EpisodeConfig().simulator.robot
    places = reach(building, *robot.hull_m)
    task = make_task(places, np.random.default_rng(0))
    for goal in ("explore", "fused"):
        run_episode(building, places, task, EpisodeConfig(max_steps=3, goal=goal))


def _interpret(loop: Loop, *args: Any) -> Any:
    """Run a loop as plain Python, except the one that traces links."""
    function = loop.dispatcher if loop.py_func.__name__ == "trace_links" else loop.py_func
    return function(*args)


def _trace(building: "Building") -> None:
    """Trace one link, from the middle of one room to that of the other."""
    from robosim.radio.link import RadioLinkConfig
    from wireless.tracing.tracer import Tracer

    radio = RadioLinkConfig()
    tx, rx = [[4.5, 1.5, radio.height_m]], [[1.5, 1.5, radio.height_m]]
    tracer = Tracer(building, frequency_hz=radio.frequency_hz, config=radio.tracer)
    tracer.trace(np.array(tx), np.array(rx), workers=1)


def _two_rooms() -> FloorPlan:
    """Two rooms with a door between them, 6 m by 3 m."""
    occupancy = np.full((62, 122), OCCUPIED, np.uint8)
    occupancy[1:-1, 1:-1] = FREE
    occupancy[1:40, 60:63] = OCCUPIED
    return FloorPlan(occupancy=occupancy, resolution_m=0.05, name="two rooms")


def _count_cached() -> int:
    folder = writable_folder(cache_folders())
    if folder is None:
        raise ValueError("no cache folder is writable. Set NUMBA_CACHE_DIR to a writable folder.")
    return sum(1 for _ in folder.rglob("*.nbc"))
