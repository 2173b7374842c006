"""One episode of an evaluation: what it needs to run in any process, and all that is kept of it.

What is kept is one compressed NumPy file: the scores as a row of the table, times, both trajectories, the goals, what
the radio measured, and the map that the robot had built in the end. It holds enough to draw the episode without running
it again, in some 20 kB. A process keeps the building of the last plan, since jobs come ordered by plan.
"""

import io
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import shapely
from jaxtyping import Float, UInt8

from robosim.building.building import Building, BuildingConfig, make_building
from robosim.building.reach import Reach, reach
from robosim.episode import Decision, EpisodeConfig, run_episode
from robosim.evaluation.ablations import configured
from robosim.evaluation.rows import check_row, is_number, name_of
from robosim.evaluation.suite import Suite, SuiteTask, draw_tasks
from robosim.plans.files import read_plan
from robosim.plans.floorplan import MapError
from robosim.support.arrays_in import FAR, Array, read_npz
from robosim.support.files import plain
from robosim.support.reading import reading
from robosim.support.stopwatch import LOOP_STAGES, Stopwatch
from robosim.support.text_in import check_object, parse_json
from robosim.task.record import EpisodeLog
from robosim.task.tasks import Task, make_task
from slam.grid import MapEstimate
from wireless.paths import LinkState

#: Steps at which the part of the floor that was seen is told.
MILESTONES = (250, 500, 1000)


_WHAT, _REMEDY = "an episode of `robosim evaluate`", "Delete it to run it again."
#: What the file of an episode must hold.
_EXPECTED = {
    "head": Array("U", ""), "poses": Array("f", "n 3", FAR), "estimates": Array("f", "n 3", FAR),
    "goals": Array("f", "m 2", FAR), "coverage": Array("f", "n", FAR), "links": Array("f", "k 4"),
    "built": Array("u1", "ny nx"), "built_frame": Array("f", "3", FAR),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Job:
    """One episode to run."""

    task: SuiteTask
    """What is searched."""
    plan_file: Path
    """Where."""
    reader: str
    """Who reads it."""
    repeat: int
    """Which repetition with other noise, from 0."""
    policy: str
    """Who chooses the goals."""
    config: EpisodeConfig
    """How, with what the policy asks for and the seed."""
    made_by: str
    """Digest of code and versions, kept with the result."""

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
        """Where the episode is kept below the folder of an evaluation."""
        return Path(out) / "episodes" / f"{self.name}.npz"


@dataclass(frozen=True)
class Head:
    """What tables tell of an episode."""

    row: dict[str, Any]
    """Identity and scores: the same for the same seed."""
    timing: dict[str, float]
    """Seconds by stage, and in all."""
    made_by: str
    """Digest of code and versions."""


@dataclass(frozen=True, eq=False)
class Episode:
    """What is kept of an episode."""

    head: Head
    poses: Float[np.ndarray, "n 3"]
    """True poses."""
    estimates: Float[np.ndarray, "n 3"]
    """Estimated poses."""
    goals: Float[np.ndarray, "m 2"]
    """Where the robot wanted to be at each decision."""
    coverage: Float[np.ndarray, " n"]
    """Part of the reachable floor seen, at each pose."""
    links: Float[np.ndarray, "k 4"]
    """True state, believed state, SNR [dB] and error of the angle of arrival [rad] at each decision."""
    built: UInt8[np.ndarray, "ny nx"]
    """The built map: 0 unknown, 1 free, 2 obstacle."""
    built_frame: Float[np.ndarray, "3"]
    """Origin x, y and resolution [m] of the built map."""


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
    """Run an episode and return the content of its file.

    Args:
        job: What to run.
        watch: Measures the stages; wall-clock time if not given.

    Raises:
        MapError: If the task cannot be done in the plan.
        KeyboardInterrupt: If it was interrupted: half an episode is not kept.
    """
    begin = perf_counter()
    building, places = job.scene()
    task = task_of(places, job.task)
    goals: list[np.ndarray] = []

    def look(log: EpisodeLog, decision: Decision) -> None:
        goals.append(np.array(decision.goal, float))

    log, estimate = run_episode(building, places, task, job.config, look, watch)
    if log.ended in ("interrupted", "terminated"):
        raise KeyboardInterrupt
    seconds = perf_counter() - begin
    loop_s = sum(log.seconds.get(stage, 0.0) for stage in LOOP_STAGES)
    timing = {**log.seconds, "wall": seconds, "decisions_per_s": log.steps / loop_s if loop_s else 0.0}
    row = _row(job, log, building)
    return _to_bytes(Head(row, timing, job.made_by), log, np.array(goals).reshape(-1, 2), estimate)


def read_head(path: Path) -> Head:
    """Read what tables tell of an episode.

    Raises:
        FileError: If the file is no episode, or damaged, or another than its name says.
    """
    with reading(path, _WHAT, _REMEDY) as file:
        return _head(read_npz(file, {"head": _EXPECTED["head"]}), path)


def read_episode(path: Path) -> Episode:
    """Read all that is kept of an episode.

    Raises:
        FileError: As `read_head` does.
    """
    with reading(path, _WHAT, _REMEDY) as file:
        arrays = read_npz(file, _EXPECTED)
        head = _head(arrays, path)
        del arrays["head"]
        moments = len(arrays["poses"])
        if not moments or max(len(arrays["goals"]), len(arrays["links"])) > moments:
            raise ValueError(f"it has {moments} poses, but {len(arrays['goals'])} goals")
        if not np.isin(arrays["links"][:, :2], list(LinkState)).all():
            raise ValueError("a link state is none")
        if arrays["built"].max(initial=0) > 2:
            raise ValueError(f"a cell of the map is {arrays['built'].max()}, expected 0, 1 or 2")
        return Episode(head=head, **arrays)


def _head(arrays: Mapping[str, np.ndarray], path: Path) -> Head:
    told = check_object(parse_json(str(arrays["head"]).encode()), ("row", "timing", "made_by"))
    row, timing = check_object(told["row"]), check_object(told["timing"])
    check_row(row)
    if not all(map(is_number, timing.values())):
        raise ValueError("a time is no number")
    if name_of(row) != f"{path.parent.name}/{path.stem}":
        raise ValueError(f"it is the episode {name_of(row)[:80]}, not that of its name")
    return Head(row, timing, str(told["made_by"]))


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
    """The building of a plan and what a robot of a radius and a height can reach in it; the last one is kept."""
    building = make_building(read_plan(plan_file, reader=reader), config=config)
    return building, reach(building, *hull_m)


def task_of(places: Reach, task: SuiteTask) -> Task:
    """A task of a suite in its building.

    Raises:
        MapError: If it cannot be done there.
    """
    x, y, yaw_deg = task.start
    start = np.array([x, y, np.radians(yaw_deg)])
    try:
        return make_task(places, np.random.default_rng(0), start=start, target=np.array(task.target))
    except MapError as error:
        raise MapError(f"task {task.number} of {task.plan}: {error}") from error


def _row(job: Job, log: EpisodeLog, building: Building) -> dict[str, Any]:
    """Identity and scores; whatever the log's result tells passes through."""
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


def _to_bytes(head: Head, log: EpisodeLog, goals: np.ndarray, estimate: MapEstimate) -> bytes:
    built, frame = _built(estimate)
    links = [[link.state, link.believed, link.snr_db, link.aoa_error_rad] for link in log.links]
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        head=np.array(json.dumps(asdict(head))),
        poses=np.array(log.poses, np.float32),
        estimates=np.array(log.estimates, np.float32),
        goals=goals.astype(np.float32),
        coverage=np.array(log.coverage, np.float32),
        links=np.array(links, np.float32).reshape(-1, 4),
        built=built,
        built_frame=frame,
    )
    return buffer.getvalue()


def _built(estimate: MapEstimate) -> tuple[UInt8[np.ndarray, "ny nx"], Float[np.ndarray, "3"]]:
    """The built map as one number a cell, cut to what was explored, and where it lies."""
    kind = np.zeros(estimate.obstacle.shape, np.uint8)
    kind[estimate.explored] = 1
    kind[estimate.obstacle | estimate.blocked] = 2
    rows, columns = (np.flatnonzero((kind > 0).any(axis)) for axis in (1, 0))
    frame = estimate.frame
    if not len(rows):
        return kind[:0, :0], np.array([*frame.origin_xy, frame.resolution_m])
    corner = frame.origin_xy + np.array([columns[0], rows[0]]) * frame.resolution_m
    cut = kind[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return cut, np.array([*corner, frame.resolution_m])
