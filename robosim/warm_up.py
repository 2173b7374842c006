"""Compile all loops in advance, or those of the default episode alone, in two processes on machines with two cores.

Loops are compiled at their first call and cached on disk (`robosim.support.compiled`). While one process compiles a
loop, others wait for it. Therefore the two processes call the loops in different orders. Of an episode `views_of` and
`trace_links` take most time, and the second needs the result of the first. A process compiles the first; the other
interprets it, which is fast for two rooms, and compiles the second.

Left out: loops that only training and calibration call.
"""

import gc
import logging
import os
from collections.abc import Callable
from concurrent.futures import FIRST_EXCEPTION, wait
from dataclasses import replace
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np

from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.plans.storey_plans import StoreyPlan, StoreysPlan
from robosim.support.compiled import Loop, cache_folders, writable_folder
from robosim.support.processes import Processes

if TYPE_CHECKING:
    from robosim.building.building import Building
    from robosim.episode_config import EpisodeConfig

#: Interval between reports of progress [s].
_REPORT_S = 0.5


def warm_up(report: Callable[[int], None] = lambda count: None, *, episode: bool = False) -> int:
    """Compile and cache all loops; returns the number of functions compiled, 0 if all were cached.

    `report` is called twice a second with the number so far. `episode` leaves out what the default episode does not
    call. ValueError if no cache folder is writable.
    """
    before = _count_cached()
    n_processes = min(2, len(os.sched_getaffinity(0)))
    pool = Processes(n_processes)
    try:
        pending = {pool.submit(call_loops, half, episode=episode) for half in range(n_processes)}
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


def call_loops(half: int = 0, *, episode: bool = False) -> None:
    """Call every loop, or those of the default episode: first those of the episode (part 0), or the others (1)."""
    logging.disable(logging.WARNING)
    gc.disable()  # searches for garbage take a sixth of the time in which numba compiles
    if episode:
        _call_default_episode(half)
        return
    work: list[Callable[[], None]] = [
        _trace_meshes,
        _trace_plans,
        _map_log,
        _make_dataset,
        _search_otherwise,
        lambda: _call_default_episode(0),
    ]
    for call in work if half else reversed(work):
        call()


def _call_default_episode(half: int) -> None:
    """Search by the defaults; first comes what buildings and transmitters need (part 0), or links (1)."""
    # Here, so that both processes import the simulator at the same time.
    from robosim.building.building import make_building
    from robosim.episode_config import EpisodeConfig
    from slam.exploration.frontiers import lines_across
    from slam.exploration.tour import costs_between, values_of_orders
    from slam.grid import GridFrame
    from slam.planning.cost_map import Box
    from slam.planning.travel_time import travel_time

    if half == 1:
        with patch.object(Loop, "__call__", _interpret), np.errstate(all="ignore"):
            _trace(make_building(_two_rooms()))
    building = make_building(_two_rooms())
    if half == 0:
        _trace(building)
    for goal in ("explore", "fused"):
        _search(EpisodeConfig(goal=goal))
    # Regions are found and ordered after more steps than these searches have.
    floor = GridFrame(origin_xy=(0.0, 0.0), resolution_m=0.1, shape=(20, 20))
    nothing, empty = np.zeros(floor.shape, bool), np.zeros(floor.shape, np.float32)
    box = Box(
        frame=floor, probability=empty, explored=~nothing, anticipated=empty, obstacle=nothing, blocked=nothing,
        offset_m=None, pose=np.zeros(3),
    )  # fmt: skip
    lines_across(box, np.ones((1, 2)), 1.0)
    field = travel_time(floor, np.ones(floor.shape), np.ones(floor.shape, bool), (1, 1))
    costs_between(field, np.array([[1.5, 0.5], [0.5, 1.5]]))
    values_of_orders(np.ones(2), np.ones(2), np.ones((2, 2)))


def _search(config: "EpisodeConfig") -> None:
    """Search for three steps in two rooms."""
    from robosim.building.building import make_building
    from robosim.building.reach import reach
    from robosim.entrants import make_entrants
    from robosim.episode import run_team
    from robosim.task.tasks import make_task

    building = make_building(_two_rooms())
    places = reach(building, *config.simulator.robot.hull_m)
    task = make_task(places, np.random.default_rng(0))
    run_team(building, make_entrants(building, places, task, replace(config, max_steps=3)))


def _search_otherwise() -> None:
    """Search with other robots, sensors, mappers, controllers and bands, among people."""
    from robosim.camera.depth_noise import DepthNoise
    from robosim.episode_config import EpisodeConfig
    from robosim.movers.movers import MoversConfig
    from robosim.robot.named import JACKAL, TURTLEBOT4
    from robosim.robot.robots import RobotConfig
    from robosim.team.team_config import TeamConfig

    default = EpisodeConfig()
    scanning = RobotConfig(lidar="rplidar-a1", depth_noise=DepthNoise(level=1.0))
    among_people = replace(default.simulator, robot=scanning, movers=MoversConfig(people=3))
    _search(replace(default, simulator=among_people))
    _search(replace(default, simulator=among_people, mapper="classical", goal="los"))
    for robot in (TURTLEBOT4, JACKAL):
        _search(replace(default.of_robot(robot), goal="fused", explorer="gain"))
    blind = replace(default.simulator, camera="none", robot=scanning, physics="kinematic")
    _search(replace(default, simulator=blind, mapper="classical", explorer="tour", goal="explore"))
    tabled = replace(
        default.simulator, physics="kinematic", radio=replace(default.simulator.radio, engine="table")
    )
    _search(replace(default, simulator=tabled, goal="fused"))
    _search(replace(default, goal="shortest"))
    _search(replace(default, simulator=blind, mapper="classical", team=TeamConfig(robots="2")))
    for camera in ("plan", "embree"):
        flat = replace(default.simulator, camera=camera, physics="kinematic")
        _search(replace(default, simulator=flat, controller="velocity", goal="explore"))
    for band in ("ble", "wifi-5"):
        _search(replace(default.in_band(band), goal="rss"))


def _trace_plans() -> None:
    """Trace plans whose walls are passed, rough and curved, and storeys."""
    import trimesh

    from robosim.building.building import make_building
    from robosim.building.multi_storey import make_storeys
    from wireless.tracing.tracer import Tracer, TracerConfig

    building, ends = make_building(_two_rooms()), (np.array([[4.5, 1.5, 1.2]]), np.array([[1.5, 1.5, 1.2]]))
    post = trimesh.creation.cylinder(radius=0.5, height=2.5)
    for scene, options in ((building, {}), (building, {"scattering": 0.3}), (post, {"curved_walls": True})):
        Tracer(scene, frequency_hz=2.4e9, config=TracerConfig(**options)).trace(*ends, workers=1)
    Tracer(make_storeys(_two_storeys())).trace(ends[0], ends[1] + np.array([0, 0, 2.8]), workers=1)


def _trace_meshes() -> None:
    """Trace a room with a box in it exhaustively and by rays, through walls, and with scattering."""
    import trimesh

    from wireless.tracing.tracer import Tracer, TracerConfig

    room, box = trimesh.creation.box((6, 3, 2.5)), trimesh.creation.box((0.5, 0.5, 2))
    mesh = trimesh.Trimesh(
        np.concatenate([room.vertices, box.vertices]),
        np.concatenate([room.faces, box.faces + 8]),
        process=False,
    )
    ends = np.array([[2.5, 1.2, 0.1]]), np.array([[-2.5, -1.0, 0.2], [1.1, 0.7, 0.3]])
    exhaustive = TracerConfig(scene="space", max_reflections=2)
    by_rays = replace(exhaustive, search="rays", rays=1000)
    for frequency_hz, config in (
        (28e9, exhaustive),
        (28e9, by_rays),
        (5e9, exhaustive),
        (5e9, replace(by_rays, scattering=0.3)),
    ):
        tracer = Tracer(mesh, materials=("partition",), frequency_hz=frequency_hz, config=config)
        tracer.trace(*ends, workers=1)


def _map_log() -> None:
    """Map the log of a laser that goes once to and fro in a room, with odometry and without."""
    from robosim.logs.log_mapping import map_log
    from robosim.logs.robot_log import RobotLog

    x = 2 * np.sin(np.linspace(0, np.pi, 40))
    bearing = np.linspace(-np.pi, np.pi, 360, endpoint=False)
    ahead, left = np.cos(bearing), np.sin(bearing)
    along_m = np.where(ahead > 0, 5 - x[:, None], 1 + x[:, None]) / np.maximum(np.abs(ahead), 1e-9)
    range_m = np.minimum(along_m, np.where(left > 0, 2.0, 1.5) / np.maximum(np.abs(left), 1e-9))
    for step in (1, 15):
        log = RobotLog(
            name="room",
            bearing_rad=bearing[::step],
            range_m=range_m[:, ::step],
            displacement=np.diff(x, prepend=x[0])[:, None] * [1.0, 0, 0],
            known=np.full(len(x), True),
            times=np.arange(len(x)) / 2,
        )
        map_log(log)


def _make_dataset() -> None:
    """Make the links of a data set in two rooms and in storeys, with both estimators, among people."""
    from robosim.datasets.link_units import LinkPlan, LinkSetConfig, make_unit

    transmitters = np.array([[4.5, 1.5, 1.5]])
    for estimator in ("sage", "pca"):
        config = LinkSetConfig(grid_m=1.0, estimator=estimator, people=3)
        for plan in (_two_rooms(), _two_storeys().storey(0)):
            make_unit(LinkPlan.of(plan, transmitters, 1), 0, config)


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


def _two_storeys() -> StoreysPlan:
    """The two rooms twice, over each other, with an opening."""
    opening = ((3.5, 1.0), (4.5, 1.0), (4.5, 2.0), (3.5, 2.0))
    rooms = _two_rooms()
    return StoreysPlan(
        name="storeys", storeys=(StoreyPlan(plan=rooms, openings=(opening,)), StoreyPlan(plan=rooms))
    )


def _count_cached() -> int:
    folder = writable_folder(cache_folders())
    if folder is None:
        raise ValueError("no cache folder is writable. Set NUMBA_CACHE_DIR to a writable folder.")
    # Not `rglob`, which raises where another process deletes an old version meanwhile.
    return sum(name.endswith(".nbc") for _, _, names in os.walk(folder) for name in names)
