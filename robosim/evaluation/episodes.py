"""Episodes of an evaluation, run by any number of workers; a run that was stopped resumes.

The result of an episode is one file (`robosim.recording.episode_file`, without pictures). It is written whole, by the
process that was started, and an episode whose file exists is not run again. It depends on its job only. A worker caches
the building of the last plan, since jobs are ordered by plan. An episode that fails is reported and left out; the
others continue, and the next run tries it again.
"""

import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import shapely
from rich.console import Console
from rich.text import Text

from robosim.building.building import Building, BuildingConfig, make_building
from robosim.building.reach import Reach, reach
from robosim.drawing.plan_view import building_rings
from robosim.entrants import make_entrants
from robosim.episode import run_team
from robosim.episode_config import EpisodeConfig
from robosim.evaluation.suite import Suite, SuiteTask, draw_tasks
from robosim.plans.files import read_plan
from robosim.plans.floorplan import MapError
from robosim.recording.episode_file import EpisodeWriter, Head, RecordedEpisode, read_episode, read_head
from robosim.robot.collision import depth_in
from robosim.robot.robots import RobotConfig
from robosim.support.files import plain, write_whole
from robosim.support.parts import place_in_part
from robosim.support.progress import unit_progress
from robosim.support.stopwatch import LOOP_STAGES, Stopwatch
from robosim.support.workers import Workers
from robosim.task.tasks import Task, make_task
from robosim.team.team_log import TeamLog
from slam.hull import Outline

#: Columns that are looked at by name. All others are numbers, or null where there is none.
_TEXT, _WHOLE = ("plan", "policy", "ended"), ("task", "repeat", "seed", "steps", "collisions")
_NUMBERS = (
    "spl", "shortest_m", "final_distance_m", "path_length_m", "coverage", "deepest_penetration_m",
    "deepest_by_distance_m", "position_error_rms_m",
)  # fmt: skip
_PLACES = {"start": 3, "target": 2}
#: Whole numbers up to here are distinct in floating-point columns.
_LARGEST = 1e15


def name_of(row: Mapping[str, Any]) -> str:
    """Name of an episode's file, unique in an evaluation: PLAN/TASK-POLICY-REPEAT.

    A policy that is a file lies in folders of its own, which are no folders of the evaluation.
    """
    policy = str(row["policy"]).replace("/", "_").replace("\\", "_")
    return f"{row['plan']}/{row['task']:03d}-{policy}-{row['repeat']}"


def read_job_head(path: Path) -> Head:
    """Read the result of an episode; FileError if the file is damaged, or another than its name says."""
    return read_head(path, lambda head: _check(head, path))


def read_job_episode(path: Path) -> RecordedEpisode:
    """Read an episode; errors as in `read_job_head`."""
    return read_episode(path, lambda head: _check(head, path))


def _check(head: Head, path: Path) -> None:
    check_row(head.row)
    if name_of(head.row) != f"{path.parent.name}/{path.stem}":
        raise ValueError(f"it is the episode {name_of(head.row)[:80]}, not that of its name")


def check_row(row: Mapping[str, Any]) -> None:
    """Raise ValueError for the first column of a row that no episode has."""
    at, transmitter = row.get("arrived_at_step"), row.get("transmitter")
    good = {
        **{name: isinstance(row.get(name), str) for name in _TEXT},
        **{name: _is_whole(row.get(name)) for name in _WHOLE},
        "arrived": isinstance(row.get("arrived"), bool) and row["arrived"] == (at is not None),
        "arrived_at_step": "arrived_at_step" in row and (at is None or _is_whole(at)),
        **{name: is_number(row.get(name)) for name in _NUMBERS},
        **{name: _is_place(row.get(name), length) for name, length in _PLACES.items()},
        "transmitter": transmitter is None or _is_place(transmitter, 2),
    }
    good |= {name: value is None or is_number(value) for name, value in row.items() if name not in good}
    for name, fine in good.items():
        if not fine:
            raise ValueError(f"{name} of the episode is {str(row.get(name))[:80]!r}")


def is_number(value: Any) -> bool:
    """Whether a value of JSON is a number that a table can hold."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= _LARGEST


def _is_whole(value: Any) -> bool:
    return is_number(value) and isinstance(value, int) and value >= 0


def _is_place(value: Any, length: int) -> bool:
    return isinstance(value, list) and len(value) == length and all(map(is_number, value))


#: Steps at which the seen part of the floor is reported.
MILESTONES = (250, 500, 1000)


@dataclass(frozen=True, kw_only=True)
class Job:
    """Episode to run."""

    task: SuiteTask
    plan_file: Path
    reader: str
    """Reader of the plan."""
    repeat: int
    """Number of the repetition with other noise, from 0."""
    policy: str
    """Goal policy."""
    config: EpisodeConfig
    """Configuration, with the policy's requirements and the seed."""
    made_by: str
    """Digest of code and versions, stored with the result."""

    @property
    def name(self) -> str:
        """Name of the episode's file, unique in an evaluation."""
        return name_of(self.identity)

    @property
    def identity(self) -> dict[str, Any]:
        """Columns that name the episode."""
        task = self.task
        return {"plan": task.plan, "task": task.number, "policy": self.policy, "repeat": self.repeat}

    def scene(self) -> tuple[Building, Reach]:
        """Building of the episode, and the places that the robot can reach in it."""
        config = self.config
        return scene(self.plan_file, self.reader, config.building, config.robots[0].hull_m)

    def file(self, out: Path) -> Path:
        """File of the episode below the folder of an evaluation."""
        return Path(out) / "episodes" / f"{self.name}.npz"


@dataclass(frozen=True)
class Failure:
    """An episode that raised an error."""

    job: Job
    error: str
    """Kind of the error and the first line of its message."""
    trace: str
    """Traceback."""


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
            config=replace(config, goal=policy, seed=task.seed(suite.seed, repeat)),
            made_by=made_by,
        )
        for plan, file in suite.plans.items()
        for policy in policies
        for task in suite.tasks
        if task.plan == plan
        for repeat in range(repeats)
    ]


def run_jobs(
    jobs: Sequence[Job], out: Path, *, workers: int, console: Console, cluster: str | None = None
) -> list[Failure]:
    """Run all episodes, ordered by plan, whose file does not exist yet; returns those that failed.

    Raises:
        WorkerLost: If a process was killed, when the others are done.
    """
    left = [job for job in jobs if not job.file(out).is_file()]
    failures: list[Failure] = []
    with (
        Workers(min(workers, len(left) or 1), cluster, what="episodes") as pool,
        unit_progress(console, "episodes", len(jobs), len(jobs) - len(left)) as advance,
    ):
        for _, (job, content, failure) in pool.run(_safely, [(job,) for job in left]):
            if failure is None:
                write_whole(job.file(out), content)
            else:
                failures.append(failure)
                console.print(Text(f"{job.name} failed: {failure.error}"), soft_wrap=True)
            advance(job.name)
    return failures


def _safely(job: Job) -> tuple[Job, bytes, Failure | None]:
    try:
        return job, run_job(job), None
    except Exception as error:
        line = (str(error).splitlines() or [""])[0]
        place = place_in_part(error)
        words = f"{type(error).__name__}: {line}{place and f' ({place})'}"
        return job, b"", Failure(job, words, traceback.format_exc())


def run_job(job: Job, watch: Stopwatch | None = None) -> bytes:
    """Run an episode and return the content of its file; wall-clock times without `watch`.

    Raises:
        MapError: If the task cannot be done in the plan.
        KeyboardInterrupt: If it was interrupted: half an episode is not stored.
    """
    begin = perf_counter()
    building, places = job.scene()
    task = task_of(places, job.task)
    entrants = make_entrants(building, places, task, job.config)
    steps = {name: EpisodeWriter(building_rings(building), pictures=False) for name in entrants}
    team = run_team(building, entrants, lambda log, step: steps[log.robot].add(step), watch)
    log = team.first
    if log.ended in ("interrupted", "terminated"):
        raise KeyboardInterrupt
    seconds = perf_counter() - begin
    loop_s = sum(log.seconds.get(stage, 0.0) for stage in LOOP_STAGES)
    decisions = sum(robot.steps for robot in team.robots.values())
    timing = {**log.seconds, "wall": seconds, "decisions_per_s": decisions / loop_s if loop_s else 0.0}
    row = _row(job, team, building, entrants[log.robot].config.simulator.robot)
    head = Head(row=row, seeks_target=log.seeks_target, timing=timing, made_by=job.made_by)
    end = log.poses[-1], log.coverage[-1], team.maps[log.robot], log.times()
    return steps[log.robot].content(head, *end)


def draw_plan(
    plan: str,
    file: Path,
    reader: str,
    count: int,
    seed: int,
    building: BuildingConfig,
    hull_m: tuple[float, float, Outline],
) -> list[SuiteTask]:
    """Tasks in one plan, for a process of its own."""
    return draw_tasks(plan, scene(file, reader, building, hull_m)[1], count, seed)


@lru_cache(maxsize=1)
def scene(
    plan_file: Path, reader: str, config: BuildingConfig, hull_m: tuple[float, float, Outline]
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


def _row(job: Job, team: TeamLog, building: Building, robot: RobotConfig) -> dict[str, Any]:
    """Identity and scores; all values of the log's result are included."""
    log = team.first
    coverage = team.coverage or log.coverage
    walls, poses = building.floor(robot.height_m).boundary, np.array(log.poses)
    clearance = shapely.distance(shapely.points(poses[:, :2]), walls)
    seen = {f"coverage_{n}": coverage[min(n, len(coverage) - 1)] for n in MILESTONES}
    deepest = max(0.0, robot.hull.radius_m - float(clearance.min()))
    if robot.outline_m:
        hull = robot.hull
        near = poses[clearance < hull.turning_m]
        deepest = max((depth_in(walls, hull, pose) for pose in near), default=0.0)
    return {
        **job.identity,
        "seed": job.config.seed,
        **plain(team.result()),
        **seen,
        "deepest_by_distance_m": deepest,
    }
