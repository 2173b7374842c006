"""Environments measured: steps per second of CPU by what is observed and simulated, beside others' environments.

All robots of a case are in one process and do random actions, three of five of them forward. What is built at the first
reset is told apart. Others' environments are measured where they are installed, in the same run.
"""

import importlib
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import process_time
from typing import Any

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
from rich.console import Console
from rich.table import Table

from robosim.plans.floorplan import FloorPlan
from robosim.simulator import SimulatorConfig
from robosim.support.figures import save_figure
from robosim.support.files import write_json
from robosim.support.progress import tracked
from tests.benchmarks.radio_tables import plot_errors, radio_errors, radio_table

#: Each case runs for so long after it is warm [s of CPU].
_SECONDS = 1.5
_ID = "robosim/TargetSearch-v1"
_KINEMATIC_LIDAR = SimulatorConfig(physics="kinematic", camera="none", lidar="ring-64")


@dataclass(frozen=True)
class Case:
    """One setting."""

    name: str
    options: dict[str, Any] = field(default_factory=dict)
    """What the environment is made with."""


CASES = (
    Case("lidar of 64 beams", {"observe": ("lidar", "odometry")}),
    Case("depth 64 x 64", {"observe": ("depth", "odometry")}),
    Case("depth 64 x 64, radio by table", {"observe": ("depth", "odometry", "radio")}),
    Case("depth 64 x 64, map, coverage", {"observe": ("depth", "map", "pose"), "rewards": {"coverage": 1.0}}),
    Case("RGB-D 64 x 64", {"observe": ("rgb", "depth", "odometry")}),
    Case("RGB-D 128 x 128, MuJoCo", {"observe": ("rgb", "depth"), "config": SimulatorConfig()}),
    Case(
        "lidar, radio measured and estimated",
        {"observe": ("lidar", "radio"), "config": _KINEMATIC_LIDAR},
    ),
)
#: Environments of others: what has to be installed, and the environment's name.
PEERS = (
    ("gymnasium_robotics", "PointMaze_UMaze-v3", "a ball in a maze, MuJoCo, no picture"),
    ("gymnasium_robotics", "AntMaze_UMaze-v5", "a walking robot in a maze, MuJoCo, no picture"),
    ("miniworld", "MiniWorld-FourRooms-v0", "four rooms, picture of 80 x 60 by OpenGL"),
)


@dataclass(frozen=True)
class Row:
    """How fast one setting is."""

    name: str
    robots: int
    steps_per_s: float
    """Per second of CPU."""
    first_s: float
    """Making it and its first reset [s of CPU]."""


def run(
    plan: FloorPlan, *, robots: int, links: int, seed: int, out: Path, console: Console
) -> Sequence[Table]:
    """Measure, and write environment.json, environment.png and radio_tables.png.

    Args:
        plan: Where robots search.
        robots: How many there are in one process.
        links: Places at which tables of radio are compared with the tracer.
        seed: Of tasks, actions and places.
        out: Folder for the files.
        console: Where progress is shown.

    Returns:
        The tables of speeds and of errors.
    """
    rows: list[Row] = []
    with tracked(CASES, "settings", console) as shown:
        for case in shown:
            options = {"plan": plan, "targets": 2, **case.options}
            for count in dict.fromkeys((1, robots)):
                make = _maker(count, options)
                rows.append(_measured(case.name, make, count, seed))
    for module, name, told in PEERS:
        if (row := _peer(module, name, told, seed)) is not None:
            rows.append(row)
    errors = radio_errors(plan, links=links, seed=seed)
    write_json(
        out / "environment.json",
        {
            "plan": plan.name,
            "seed": seed,
            "rows": [asdict(row) for row in rows],
            "radio_tables": [asdict(error) for error in errors],
        },
    )
    plot(out / "environment.png", rows)
    plot_errors(out / "radio_tables.png", errors)
    return table(rows, plan.name), radio_table(errors, plan.name)


def _maker(count: int, options: dict[str, Any]) -> Callable[[], gymnasium.vector.VectorEnv]:
    return lambda: gymnasium.make_vec(_ID, count, vectorization_mode="vector_entry_point", **options)


def _peer(module: str, name: str, told: str, seed: int) -> Row | None:
    """The speed of somebody else's environment, or None if it is not installed, or cannot draw here."""
    try:
        gymnasium.register_envs(importlib.import_module(module))
        return _measured(f"{name} ({told})", lambda: gymnasium.make_vec(name, 1, "sync"), 1, seed)
    except ImportError:
        return None
    except Exception as error:  # whatever keeps a window system or a driver from drawing
        return Row(f"{name}: {type(error).__name__}", 1, math.nan, math.nan)


def _measured(name: str, make: Callable[[], gymnasium.vector.VectorEnv], count: int, seed: int) -> Row:
    begin = process_time()
    env = make()
    env.reset(seed=seed)
    first_s = process_time() - begin
    rng = np.random.default_rng(seed)
    _drive(env, rng, 4)  # warm: what is compiled or read at its first use
    done, begin = 0, process_time()
    while (spent := process_time() - begin) < _SECONDS:
        done += _drive(env, rng, 4)
    env.close()
    return Row(name, count, done / spent, first_s)


def _drive(env: gymnasium.vector.VectorEnv, rng: np.random.Generator, times: int) -> int:
    """So many random actions of all robots; how many those are."""
    for _ in range(times):
        if isinstance(env.single_action_space, gymnasium.spaces.Discrete):
            ways = [0, 0, 0, *range(1, int(env.single_action_space.n))]
            env.step(rng.choice(ways, env.num_envs))
        else:
            box: Any = env.action_space
            env.step(rng.uniform(box.low, box.high).astype(box.dtype))
    return times * env.num_envs


def table(rows: Sequence[Row], plan: str) -> Table:
    """One row a setting."""
    grid = Table(title=f"Environments in {plan}: steps per second of CPU")
    for name in ("setting", "robots", "steps / CPU-s", "first reset [CPU-s]"):
        grid.add_column(name, justify="left" if name == "setting" else "right")
    for row in rows:
        speed = "" if math.isnan(row.steps_per_s) else f"{row.steps_per_s:.0f}"
        first = "" if math.isnan(row.first_s) else f"{row.first_s:.1f}"
        grid.add_row(row.name, str(row.robots), speed, first)
    return grid


def plot(path: Path, rows: Sequence[Row]) -> None:
    """Draw steps per second."""
    drawn = [row for row in rows if not math.isnan(row.steps_per_s)][::-1]
    figure, axes = plt.subplots(figsize=(8.5, 0.32 * len(drawn) + 1.2), layout="constrained")
    ours = ["tab:blue" if not row.name.startswith(("Point", "Ant", "Mini")) else "0.6" for row in drawn]
    axes.barh(range(len(drawn)), [row.steps_per_s for row in drawn], color=ours, height=0.7)
    axes.set_yticks(range(len(drawn)), [f"{row.name}, {row.robots}" for row in drawn], fontsize=7)
    axes.set(xscale="log", xlabel="steps per second of CPU")
    axes.grid(alpha=0.3, axis="x", which="both")
    save_figure(figure, path)
