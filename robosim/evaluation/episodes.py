"""One episode of an evaluation: what it needs to run in any process.

Its result is one file (`robosim.recording.episode_file`, without pictures). A process caches the building of the last
plan, since jobs come ordered by plan.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import shapely

from robosim.building.building import Building, BuildingConfig, make_building
from robosim.building.reach import Reach, reach
from robosim.drawing.plan_view import building_rings
from robosim.episode import EpisodeConfig, run_episode
from robosim.episode_log import EpisodeLog
from robosim.evaluation.ablations import configured
from robosim.evaluation.rows import name_of
from robosim.evaluation.suite import Suite, SuiteTask, draw_tasks
from robosim.plans.files import read_plan
from robosim.plans.floorplan import MapError
from robosim.recording.episode_file import EpisodeWriter, Head
from robosim.step import Step
from robosim.support.files import plain
from robosim.support.stopwatch import LOOP_STAGES, Stopwatch
from robosim.task.tasks import Task, make_task

#: Steps at which the seen part of the floor is reported.
MILESTONES = (250, 500, 1000)


@dataclass(frozen=True, kw_only=True)
class Job:
    """One episode to run."""

    task: SuiteTask
    """What is searched."""
    plan_file: Path
    """Where."""
    reader: str
    """Reader of the plan."""
    repeat: int
    """Which repetition with other noise, from 0."""
    policy: str
    """Goal policy."""
    config: EpisodeConfig
    """Configuration, with the policy's requirements and the seed."""
    made_by: str
    """Digest of code and versions, stored with the result."""

    @property
    def name(self) -> str:
        """Of its file, unique in an evaluation."""
        task = self.task
        row = {"plan": task.plan, "task": task.number, "policy": self.policy, "repeat": self.repeat}
        return name_of(row)

    def scene(self) -> tuple[Building, Reach]:
        """Its building, and what the robot can reach there."""
        config = self.config
        return scene(self.plan_file, self.reader, config.building, config.simulator.robot.hull_m)

    def file(self, out: Path) -> Path:
        """Where the episode is stored below the folder of an evaluation."""
        return Path(out) / "episodes" / f"{self.name}.npz"


def make_jobs(
    suite: Suite, config: EpisodeConfig, policies: tuple[str, ...], repeats: int, made_by: str
) -> list[Job]:
    """Every task by every policy, ordered by plan, and there by policy, task and repetition."""
    return [
        Job(
            task=task,
            plan_file=file,
            reader=suite.reader,
            repeat=repeat,
            policy=policy,
            config=replace(configured(config, policy), seed=task.seed(suite.seed, repeat)),
            made_by=made_by,
        )
        for plan, file in suite.plans.items()
        for policy in policies
        for task in suite.tasks
        if task.plan == plan
        for repeat in range(repeats)
    ]


def run_job(job: Job, watch: Stopwatch | None = None) -> bytes:
    """Run an episode and return the content of its file; wall-clock times without `watch`.

    Raises:
        MapError: If the task cannot be done in the plan.
        KeyboardInterrupt: If it was interrupted: half an episode is not stored.
    """
    begin = perf_counter()
    building, places = job.scene()
    task = task_of(places, job.task)
    steps = EpisodeWriter(building_rings(building), pictures=False)

    def record(log: EpisodeLog, step: Step) -> None:
        steps.add(step)

    log, estimate = run_episode(building, places, task, job.config, record, watch)
    if log.ended in ("interrupted", "terminated"):
        raise KeyboardInterrupt
    seconds = perf_counter() - begin
    loop_s = sum(log.seconds.get(stage, 0.0) for stage in LOOP_STAGES)
    timing = {**log.seconds, "wall": seconds, "decisions_per_s": log.steps / loop_s if loop_s else 0.0}
    row = _row(job, log, building)
    head = Head(row=row, seeks_target=log.seeks_target, timing=timing, made_by=job.made_by)
    return steps.content(head, log.poses[-1], log.coverage[-1], estimate)


def draw_plan(
    plan: str,
    file: Path,
    reader: str,
    count: int,
    seed: int,
    building: BuildingConfig,
    hull_m: tuple[float, float],
) -> list[SuiteTask]:
    """Tasks in one plan, for a process of its own."""
    return draw_tasks(plan, scene(file, reader, building, hull_m)[1], count, seed)


@lru_cache(maxsize=1)
def scene(
    plan_file: Path, reader: str, config: BuildingConfig, hull_m: tuple[float, float]
) -> tuple[Building, Reach]:
    """The building of a plan and what a robot of a radius and a height can reach in it; the last one is cached."""
    building = make_building(read_plan(plan_file, reader=reader), config=config)
    return building, reach(building, *hull_m)


def task_of(places: Reach, task: SuiteTask) -> Task:
    """A task of a suite in its building; MapError if it cannot be done there."""
    x, y, yaw_deg = task.start
    start = np.array([x, y, np.radians(yaw_deg)])
    try:
        return make_task(places, np.random.default_rng(0), start=start, target=np.array(task.target))
    except MapError as error:
        raise MapError(f"task {task.number} of {task.plan}: {error}") from error


def _row(job: Job, log: EpisodeLog, building: Building) -> dict[str, Any]:
    """Identity and scores; all values of the log's result are included."""
    robot = job.config.simulator.robot
    walls = building.floor(robot.height_m).boundary
    clearance = shapely.distance(shapely.points(np.array(log.poses)[:, :2]), walls)
    seen = {f"coverage_{n}": log.coverage[min(n, len(log.coverage) - 1)] for n in MILESTONES}
    deepest = max(0.0, robot.radius_m - float(clearance.min()))
    return {
        "plan": job.task.plan,
        "task": job.task.number,
        "policy": job.policy,
        "repeat": job.repeat,
        "seed": job.config.seed,
        **plain(log.result()),
        **seen,
        "deepest_by_distance_m": deepest,
    }
