"""Driving to known targets and exploring, over many plans: arrival, coverage, pose, and what the hull touches.

Every explorer gets the same tasks: start, noise and seeds depend on the plan alone. Its score is the area under the
curve of coverage over the first 1000 decisions, divided by 1000: the mean part of the reachable floor that had been
seen. A robot that ends sooner holds its last value. Against the first explorer the difference is taken plan by plan,
with a 95 % interval by bootstrap over plans. How deep the hull was in a wall is judged by the contacts of the
physics, and by the distance of the true positions from the walls.
References: Chaplot et al., ICLR 2020 (coverage at 1000 steps); Efron, Annals of Statistics 7(1), 1979.
"""

import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import shapely
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.camera.depth_noise import DepthNoise
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.parts import EXPLORER, MapperPart, PhysicsPart
from robosim.plans.files import find_plans, read_plan
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.support.files import plain
from robosim.support.stopwatch import LOOP_STAGES
from robosim.task.tasks import make_task
from slam.planning.paths import length
from tests.benchmarks.harness import DEFAULT, Options, ratio_interval, run_units
from tests.benchmarks.results import Results

#: Decisions of an episode, and those after which coverage is reported.
DECISIONS, MILESTONES = 1000, (250, 500, 1000)
KNOWN_TARGET = "to a known target"


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    explorers: tuple[Annotated[str, EXPLORER.option()], ...] = ("nearest", "gain", "learned"),
    mapper: MapperPart = "neural",
    noise: float = 1.0,
    depth_noise: float = 0.0,
    physics: PhysicsPart = "dynamic",
    max_steps: int = DECISIONS,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Exploration: floor seen over decisions by each explorer, and drives to a known target; pose, bumps, speed.

    Goes on after a kill if it is given the same folder.

    Args:
        plans: Floor plans, or folders of them.
        explorers: Explorers to compare, with the first of them.
        mapper: Mapper: neural, classical, or a .safetensors file.
        noise: Level of actuation and odometry noise.
        depth_noise: Level of the depth camera's noise.
        physics: dynamic drives wheels in MuJoCo; kinematic moves a disk, faster.
        max_steps: Decisions of an episode.
        options: Of every benchmark.
    """
    simulator = SimulatorConfig(
        physics=physics,
        robot=RobotConfig(noise=NoiseModel(level=noise), depth_noise=DepthNoise(level=depth_noise)),
    )
    units = {}
    for path in find_plans(plans):
        name = read_plan(path).name
        seed = zlib.crc32(f"{options.seed} {name}".encode())
        shared = {"mapper": mapper, "seed": seed, "max_steps": max_steps, "simulator": simulator}
        units[f"{KNOWN_TARGET}, {name}"] = (path, EpisodeConfig(goal="oracle", **shared))
        for explorer in explorers:
            units[f"{explorer}, {name}"] = (path, EpisodeConfig(goal="explore", explorer=explorer, **shared))
    found = run_units(drive, units, options.folder("exploration"), workers=options.workers)
    results, first = Results(), None
    for what in (KNOWN_TARGET, *explorers):
        rows = [row for name, row in found.items() if name.startswith(f"{what}, ")]
        summarise(what, rows, results)
        if what != KNOWN_TARGET:
            area = np.array([area_under(row["coverage"]) for row in rows])
            first = area if first is None else first
            more, low, high = (100 * value for value in gain_over(area, first))
            results.add(
                "driving",
                what,
                f"over {explorers[0]}",
                more,
                "%",
                digits=1,
                spread=(low, high),
                cases=len(rows),
            )
    return options.finish("exploration", results)


def drive(path: Path, config: EpisodeConfig) -> dict[str, Any]:
    """One episode: its result, coverage held to the end, how deep the hull was in a wall, decisions a second."""
    plan, robot = read_plan(path), config.simulator.robot
    building = make_building(plan, config=config.building)
    places = reach(building, *robot.hull_m)
    task = make_task(places, np.random.default_rng([config.seed, 0]))
    log, _ = run_episode(building, places, task, config)
    poses = np.array(log.poses)
    walls = building.floor(robot.height_m).boundary
    deepest_m = robot.hull.radius_m - float(shapely.distance(shapely.points(poses[:, :2]), walls).min())
    return {
        **plain(log.result()),
        "coverage": held(np.array(log.coverage)),
        "driven_m": length(poses[:, :2]),
        "deepest_m": max(deepest_m, log.result()["deepest_penetration_m"], 0.0),
        "decisions_per_s": log.steps / max(sum(log.seconds.get(stage, 0.0) for stage in LOOP_STAGES), 1e-9),
    }


def summarise(what: str, rows: Sequence[Mapping[str, Any]], results: Results) -> None:
    """Add what the episodes of an explorer, or to known targets, come to."""

    def add(
        name: str, value: float, unit: str = "", digits: int = 1, spread: tuple[float, float] | None = None
    ) -> None:
        results.add("driving", what, name, value, unit, digits=digits, spread=spread, cases=len(rows))

    if what == KNOWN_TARGET:
        add("arrived", 100 * np.mean([row["arrived"] for row in rows]), "%")
        add("mean SPL", np.mean([row["spl"] for row in rows]), digits=2)
    else:
        curves = np.array([row["coverage"] for row in rows])
        for decisions in MILESTONES:
            seen, spread = ratio_interval(100 * curves[:, decisions], np.ones(len(curves)))
            add(f"seen after {decisions}", seen, "%", spread=spread)
        add("seen in the worst plan", 100 * curves[:, -1].min(), "%")
        add("area under the curve", np.mean([area_under(curve) for curve in curves]), digits=3)
    last_cm = [100 * row["position_error_last_m"] for row in rows]
    add("pose error at the end, median", np.median(last_cm), "cm")
    add("95 %", np.quantile(last_cm, 0.95), "cm")
    add("bumps in 100 m", bumps_in_100_m(rows))
    add("deepest in a wall", 1000 * max(row["deepest_m"] for row in rows), "mm")
    add("decisions a second", np.median([row["decisions_per_s"] for row in rows]), digits=0)


def held(coverage: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
    """Coverage before each of the first 1000 decisions and after the last: the last value is held."""
    n = DECISIONS + 1
    return np.concatenate([coverage, np.full(n, coverage[-1])])[:n]


def area_under(coverage: Float[np.ndarray, " n"]) -> float:
    """Area under the curve of coverage over decisions, by trapezoids, divided by its width: 0 to 1."""
    return float(np.trapezoid(coverage) / (len(coverage) - 1))


def bumps_in_100_m(rows: Sequence[Mapping[str, Any]]) -> float:
    """Actions that ended at something, for 100 m driven in all episodes together."""
    return 100 * sum(row["collisions"] for row in rows) / max(sum(row["driven_m"] for row in rows), 1e-9)


def gain_over(
    own: Float[np.ndarray, " n"], other: Float[np.ndarray, " n"], draws: int = 2000
) -> tuple[float, float, float]:
    """By which part the mean over plans exceeds another explorer's on the same plans, with its interval of 95 %."""
    drawn = np.random.default_rng(0).integers(len(own), size=(draws, len(own)))
    low, high = np.quantile(own[drawn].mean(axis=1) / other[drawn].mean(axis=1) - 1, [0.025, 0.975])
    return float(own.mean() / other.mean() - 1), float(low), float(high)
