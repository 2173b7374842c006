"""Cameras: time of a frame against error of its depth, the usual alternatives next to ours.

All draw the same shaded building from the same poses. Each runs in a process of its own, since a process uses one
OpenGL system, and they take turns of a fraction of a second, so that other work of the machine disturbs all of them;
ratios are medians over turns. Each draws 1,200 pictures before its time counts, since stock pyrender on OSMesa
compiles its shaders again for each picture and becomes slower once llvmpipe holds 1,024 of them. The judge of depth
is exact ray casting (`true_depth`); pixels at silhouettes, where a thousandth of a pixel decides, are left out.
"""

import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from multiprocessing import get_context
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import Building, make_building
from robosim.camera.model import CameraConfig, camera_pose
from robosim.camera.rendering.gl_systems import OpenGLError, default_system
from robosim.camera.rendering.shading import shaded_mesh
from tests.benchmarks.camera_peers import CAMERAS, OURS
from tests.benchmarks.harness import DEFAULT, Options, console, free_places, plans_of, quartiles
from tests.benchmarks.results import Results
from tests.benchmarks.true_depth import DepthJudge

#: Depth that cameras promise: within 1 mm + 0.1 %.
ABSOLUTE_M, RELATIVE = 1e-3, 1e-3
#: Slow cameras, whose time does not change, need not draw all the pictures of the warm-up [s].
WARM_UP_S = 10.0

_drawn: dict[str, Any] = {}


def main(
    plan: Positional[str] = "flat",
    *,
    sizes: tuple[int, ...] = (128, 256),
    warm_up: int = 1200,
    turns: int = 9,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Cameras: time of an RGB-D frame against error of its depth, ours against stock pyrender, MuJoCo and Embree.

    Args:
        plan: Floor plan to draw.
        sizes: Widths of the square pictures [pixels].
        warm_up: Pictures that each camera draws before its time counts.
        turns: Turns of each camera.
        options: Of every benchmark.
    """
    results = Results()
    building = make_building(plans_of([plan])[0])
    for size in sizes:
        measure(building, CameraConfig(width=size, height=size), warm_up, turns, results)
    return options.finish("render", results)


def measure(building: Building, config: CameraConfig, warm_up: int, turns: int, results: Results) -> None:
    """Time and errors of all cameras that work here, at one size of pictures."""
    mesh, poses = shaded_mesh(building), random_views(building, config, 32)
    judge = DepthJudge(building.mesh, config)
    truth = [judge.look(T_map_camera) for T_map_camera in poses]
    depth, sure = np.stack([view.depth for view in truth]), np.stack([view.sure for view in truth])
    try:
        system = default_system()
    except OpenGLError as error:
        console.print(f"Only Embree draws here: {error}")
        system = None
    names = [name for name in CAMERAS if system or name.startswith("Embree")]
    with ExitStack() as stack:
        workers, seconds = {}, {}
        for name in names:
            worker = stack.enter_context(ProcessPoolExecutor(1, get_context("spawn")))
            try:
                seen = worker.submit(_prepare, name, system, mesh, poses, config, warm_up).result()
            except Exception as error:  # whatever a library raises means that this camera does not work here
                console.print(f"{name}: {type(error).__name__}: {error}")
                continue
            workers[name], seconds[name] = worker, []
            error_mm = 1e3 * np.abs(seen - depth)[sure]
            row = f"{name}, {config.width} x {config.height}"
            beyond = error_mm > 1e3 * (ABSOLUTE_M + RELATIVE * depth[sure])
            results.add("cameras", row, "mean error", error_mm.mean(), "mm", cases=error_mm.size)
            results.add("cameras", row, "largest error", error_mm.max(), "mm")
            results.add("cameras", row, "beyond 1 mm + 0.1 %", 100 * beyond.mean(), "%", digits=3, bar=0)
        for _ in range(turns):
            for name, worker in workers.items():
                seconds[name].append(worker.submit(_turn, 0.2).result())
    for name, times in seconds.items():
        row = f"{name}, {config.width} x {config.height}"
        wall_s, cpu_s = np.array(times).T
        middle, spread = quartiles(1e3 * cpu_s)
        results.add(
            "cameras", row, "processor time of a frame", middle, "ms", digits=2, spread=spread, cases=turns
        )
        results.add("cameras", row, "frames a second", 1 / np.median(wall_s), digits=0)
        ours = OURS if OURS in seconds else "Embree"
        times_ours = cpu_s / np.array(seconds[ours])[:, 1]
        results.add("cameras", row, "times ours", np.median(times_ours), digits=1)


def random_views(building: Building, config: CameraConfig, count: int) -> Float[np.ndarray, "n 4 4"]:
    """Camera poses T_map_camera spread over the free floor, 0.2 m from walls; the same in each call."""
    rng = np.random.default_rng(0)
    places = free_places(building.free.buffer(-0.2), count, rng)
    return np.array([camera_pose(np.array([*place, rng.uniform(-np.pi, np.pi)]), config) for place in places])


def _prepare(
    name: str,
    system: str | None,
    mesh: trimesh.Trimesh,
    poses: Float[np.ndarray, "n 4 4"],
    config: CameraConfig,
    warm_up: int,
) -> Float[np.ndarray, "n h w"]:
    """Make a camera in this process and warm it up; the depth of all poses [m]."""
    os.environ.pop("LP_NUM_THREADS", None)  # set by our own cameras in the process above
    if system:
        os.environ.update({"PYOPENGL_PLATFORM": system, "MUJOCO_GL": system})
    draw: Callable[[np.ndarray], np.ndarray] = CAMERAS[name](mesh, config)
    depth = np.stack([draw(T_map_camera) for T_map_camera in poses])
    begin, drawn = time.perf_counter(), 0
    while drawn < warm_up and time.perf_counter() - begin < WARM_UP_S:
        draw(poses[drawn % len(poses)])
        drawn += 1
    _drawn.update(draw=draw, poses=poses)
    return depth


def _turn(least_s: float) -> tuple[float, float]:
    """Seconds of a picture by the wall clock and of processor time, over a turn of at least so long."""
    draw, poses = _drawn["draw"], _drawn["poses"]
    begin, cpu, drawn = time.perf_counter(), time.process_time(), 0
    while not drawn or time.perf_counter() - begin < least_s:
        draw(poses[drawn % len(poses)])
        drawn += 1
    return (time.perf_counter() - begin) / drawn, (time.process_time() - cpu) / drawn
