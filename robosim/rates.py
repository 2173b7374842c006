"""Rates of this machine for the parts that take most of the time: what to expect of long runs, in half a minute.

Rates are of one core, by processor time, in the shipped flat and after a warm-up. Loops that are not compiled yet are
compiled first, which takes longer than the measurement.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from time import process_time
from typing import NamedTuple

import numpy as np

from robosim.building.building import Building, make_building
from robosim.building.reach import reach
from robosim.camera.cameras import make_camera
from robosim.camera.model import CameraConfig, camera_pose
from robosim.camera.rendering.shading import shaded_mesh
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.plans.files import read_plan
from robosim.support.stopwatch import LOOP_STAGES, Stopwatch
from robosim.task.tasks import make_task
from wireless.antennas.codebook import terminal_named
from wireless.estimation.estimators import estimator_named
from wireless.sounding.sounder import Rays, Sounder
from wireless.tracing.tracer import Tracer, TracerConfig

#: Each rate is measured for so long [s].
SECONDS = 3.0
#: Decisions of the search, and height of radios [m].
DECISIONS, HEIGHT_M = 60, 1.5


class Rate(NamedTuple):
    """Measured rate per second of one core."""

    name: str
    per_s: float
    unit: str


def measure_rates() -> Iterator[Rate]:
    """Measure one rate after the other."""
    building = make_building(read_plan("flat"))
    rng = np.random.default_rng(0)
    places = reach(building, 0.2)
    centres = building.plan.centres(places.parts == 1)[rng.permutation(int((places.parts == 1).sum()))]
    yield Rate("camera, 128 x 128", _frames_per_s(building, centres[:32], rng), "RGB-D frames")
    ends = np.insert(centres[:400], 2, HEIGHT_M, axis=1)
    tracer = Tracer(building, config=TracerConfig(max_reflections=3, diffraction_reflections=1))
    links = _calls_per_s(lambda: tracer.trace(ends[:1], ends[1:], workers=1)) * (len(ends) - 1)
    yield Rate("tracing, 3 reflections and an edge with 1", links, "links")
    sounder = Sounder(terminal_named("gnb"), terminal_named("ue"))
    rays = Rays.from_paths(tracer.trace(ends[:1], ends[1:101]))
    estimator = estimator_named("sage", sounder)
    tensor = sounder.measure(rays, rng)
    sounded = _calls_per_s(lambda: sounder.measure(rays, rng, workers=1)) * len(rays)
    yield Rate("sounding", sounded, "links")
    yield Rate(
        "estimation of paths, sage", _calls_per_s(lambda: estimator.estimate(tensor)) * len(rays), "links"
    )
    config = EpisodeConfig(goal="fused", max_steps=DECISIONS)
    task = make_task(places, np.random.default_rng(1))
    run_episode(building, places, task, replace(config, max_steps=2))
    log, _ = run_episode(building, places, task, config, watch=Stopwatch(process_time))
    seconds = sum(log.seconds.get(stage, 0.0) for stage in LOOP_STAGES)
    yield Rate("search by fused", log.steps / max(seconds, 1e-9), "decisions")


def _frames_per_s(building: Building, places: np.ndarray, rng: np.random.Generator) -> float:
    config = CameraConfig()
    camera = make_camera([shaded_mesh(building)], config)
    poses = [camera_pose(np.array([*place, rng.uniform(-np.pi, np.pi)]), config) for place in places]
    try:
        return _calls_per_s(lambda: [camera.render(pose) for pose in poses]) * len(poses)
    finally:
        camera.close()


def _calls_per_s(action: Callable[[], object]) -> float:
    """Calls per second of processor time, after one to warm up."""
    action()
    begin, count = process_time(), 0
    while process_time() - begin < SECONDS:
        action()
        count += 1
    return count / (process_time() - begin)
