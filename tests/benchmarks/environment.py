"""Environments: steps a second by what is observed and simulated, and radio tables: errors by what they cost.

All robots of a case are in one process and do random actions, three of five of them forward. Environments of
Gymnasium-Robotics and MiniWorld are measured in the same run where they are installed. Paths that a radio table
interpolates are compared with those of the tracer at the place itself, and with those of the nearest node; estimates by
rule from true paths with those of the full receiver.
"""

import importlib
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes, Positional

import robosim.environments  # noqa: F401  (registers the environments)
from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.plans.floorplan import FloorPlan
from robosim.radio.link import RadioLink
from robosim.radio.receivers import random_transmitters
from robosim.radio.table import RadioTable
from robosim.radio.table_reader import read_paths
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.support.progress import tracked
from slam.poses import wrap
from tests.benchmarks.harness import DEFAULT, Options, console, plans_of, timed
from tests.benchmarks.results import Results
from wireless.estimates import PathEstimates
from wireless.paths import Paths
from wireless.tracing.tracer import Tracer

#: Each case runs for so long after it is warm [s of CPU].
SECONDS = 1.5
#: What the environment is made with.
CASES: dict[str, dict[str, Any]] = {
    "lidar of 64 beams": {"observe": ("lidar", "odometry")},
    "depth 64 x 64": {"observe": ("depth", "odometry")},
    "depth 64 x 64, radio by table": {"observe": ("depth", "odometry", "radio")},
    "depth 64 x 64, map, coverage": {"observe": ("depth", "map", "pose"), "rewards": {"coverage": 1.0}},
    "RGB-D 64 x 64": {"observe": ("rgb", "depth", "odometry")},
    "RGB-D 128 x 128, MuJoCo": {"observe": ("rgb", "depth"), "config": SimulatorConfig()},
    "lidar, radio measured and estimated": {
        "observe": ("lidar", "radio"),
        "config": SimulatorConfig(physics="kinematic", camera="none", robot=RobotConfig(lidar="ring-64")),
    },
}
#: Environments of others: what has to be installed, and what they are.
PEERS = {
    "PointMaze_UMaze-v3": ("gymnasium_robotics", "a sphere in a maze, MuJoCo, no picture"),
    "AntMaze_UMaze-v5": ("gymnasium_robotics", "a walking robot in a maze, MuJoCo, no picture"),
    "MiniWorld-FourRooms-v0": ("miniworld", "four rooms, picture of 80 x 60 by OpenGL"),
}
#: Grids of radio tables [m], transmitters, and places of each at which estimates are compared too.
STEPS_M, TRANSMITTERS, MEASURED = (0.1, 0.15, 0.25, 0.5), 3, 60


def main(
    plan: Positional[str] = "flat",
    *,
    robots: int = 16,
    links: int = 100,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Environments: steps per second of CPU by what is observed; radio tables: errors by what they cost.

    Two minutes.

    Args:
        plan: Floor plan to search in.
        robots: Robots in one process, compared with one alone.
        links: Places at which radio tables are compared with the tracer, for each of three transmitters.
        options: Of every benchmark.
    """
    (found,), results = plans_of([plan]), Results()
    with tracked(CASES.items(), "settings", console) as cases:
        for name, changes in cases:
            for count in dict.fromkeys((robots, 1)):
                options_of = {"plan": found, "targets": 2, **changes}
                rate = steps_per_s(
                    lambda count=count, options_of=options_of: _make(count, options_of), options.seed
                )
                results.add("environments", name, f"{count} robot{'s' * (count > 1)}", rate, digits=0)
    for name, (module, words) in PEERS.items():
        try:
            gymnasium.register_envs(importlib.import_module(module))
        except ImportError:
            continue
        rate = steps_per_s(lambda name=name: gymnasium.make_vec(name, 1, "sync"), options.seed)
        results.add("environments", f"{name}: {words}", "1 robot", rate, digits=0)
    add_radio_errors(found, links, options.seed, results)
    return options.finish("environment", results)


def _make(count: int, options: dict[str, Any]) -> gymnasium.vector.VectorEnv:
    return gymnasium.make_vec(
        "robosim/TargetSearch-v1", count, vectorization_mode="vector_entry_point", **options
    )


def steps_per_s(make: Callable[[], gymnasium.vector.VectorEnv], seed: int) -> float:
    """Steps of all robots per second of CPU, after a few that do not count."""
    env, rng = make(), np.random.default_rng(seed)
    env.reset(seed=seed)
    _drive(env, rng)
    spent, steps = 0.0, 0
    while spent < SECONDS:
        spent += timed(lambda: _drive(env, rng))[0]
        steps += 4 * env.num_envs
    env.close()
    return steps / spent


def _drive(env: gymnasium.vector.VectorEnv, rng: np.random.Generator) -> None:
    """Four random actions of all robots."""
    for _ in range(4):
        if isinstance(env.single_action_space, gymnasium.spaces.Discrete):
            env.step(rng.choice([0, 0, 0, *range(1, int(env.single_action_space.n))], env.num_envs))
        else:
            box: Any = env.action_space
            env.step(rng.uniform(box.low, box.high).astype(box.dtype))


def add_radio_errors(plan: FloorPlan, links: int, seed: int, results: Results) -> None:
    """Errors of tables over their grid, and of estimates by rule."""
    building, rng = make_building(plan), np.random.default_rng(seed)
    link = RadioLink(building)
    height_m = link.config.height_m
    tracer = Tracer(building, frequency_hz=link.config.frequency_hz)
    transmitters = random_transmitters(building, TRANSMITTERS, height_m, rng)
    centres = plan.centres(reach(building, RobotConfig().hull.radius_m).parts == 1)
    at = centres[rng.integers(len(centres), size=links)]
    at = at + rng.uniform(-0.4, 0.4, at.shape) * plan.resolution_m
    rx = np.column_stack([at, np.full(links, height_m)])
    truth = [tracer.trace(tx[None], rx, workers=1) for tx in transmitters]
    RadioTable.trace(building, tracer, transmitters[0], STEPS_M[-1]).at(at[0])  # compiled before it is timed
    for step_m in STEPS_M:
        between, nearest, spent_s, asked_s = [], [], 0.0, 0.0
        for tx, true in zip(transmitters, truth, strict=True):
            seconds, table = timed(
                lambda tx=tx, step_m=step_m: RadioTable.trace(building, tracer, tx, step_m)
            )
            spent_s += seconds
            seconds, got = timed(lambda table=table: [table.at(place) for place in at])
            asked_s += seconds
            states = true.link_state()[0]
            for i, place in enumerate(at):
                between.append(_gap(got[i], true.between(0, i), int(states[i])))
                nearest.append(_gap(_nearest(table, place), true.between(0, i), int(states[i])))
        row = f"{step_m:g} m"
        results.add("radio tables", row, "traced in", spent_s / TRANSMITTERS, "s", digits=2)
        results.add("radio tables", row, "one place", 1e6 * asked_s / (TRANSMITTERS * links), "us", digits=0)
        _add_gaps("radio tables", row, between, results)
        _add_gaps("radio tables", f"{row}, nearest node", nearest, results)
    gaps = []
    for tx in transmitters:
        link.place(tx[:2])
        for _ in range(MEASURED):
            pose = np.array([*centres[rng.integers(len(centres))], rng.uniform(-np.pi, np.pi)])
            measured = link.measure(pose, rng)
            gaps.append(_estimate_gap(read_paths(link.paths, float(pose[2]), link.sounder, rng), measured))
    _add_gaps("estimates", "by rule, against the full receiver", gaps, results)


def _add_gaps(table: str, row: str, gaps: Sequence[tuple[float, float, float]], results: Results) -> None:
    same, turn_deg, power_db = np.array(gaps).T
    name = "same link state" if table == "radio tables" else "as many paths"
    results.add(table, row, name, 100 * np.nanmean(same), "%", digits=1, cases=len(same))
    for words, values, unit in (("direction", turn_deg, "°"), ("power", power_db, "dB")):
        median, most = np.nanpercentile(values, [50, 90])
        results.add(table, row, f"{words}, median", median, unit, digits=1)
        results.add(table, row, f"{words}, 90 %", most, unit, digits=1)


def _nearest(table: RadioTable, place: Float[np.ndarray, "2"]) -> Paths | None:
    around = table.nodes_around(place)
    if around is None:
        return None
    return table.paths.select(table.paths.rx == int(around[0][around[1].argmax()]))


def _gap(got: Paths | None, own: Paths, state: int) -> tuple[float, float, float]:
    """Whether the state is right, and gaps of direction [degrees] and power [dB] of the strongest paths."""
    if got is None:
        return np.nan, np.nan, np.nan
    same = float(int(got.link_state().max()) == state)  # of the one link that has paths
    if not len(got) or not len(own):
        return same, np.nan, np.nan
    turn = abs(wrap(float(got.aoa_az[0] - own.aoa_az[0])))
    return same, float(np.degrees(turn)), abs(float(got.power_db[0] - own.power_db[0]))


def _estimate_gap(read: PathEstimates, measured: PathEstimates) -> tuple[float, float, float]:
    same = float(read.count[0] == measured.count[0])
    if not read.count[0] or not measured.count[0]:
        return same, np.nan, np.nan
    turn = abs(wrap(float(read.aoa_rad[0, 0] - measured.aoa_rad[0, 0])))
    return same, float(np.degrees(turn)), abs(float(read.snr_db[0, 0] - measured.snr_db[0, 0]))
