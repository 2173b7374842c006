"""Navigation over many plans: arrival, what is touched, what is seen, and how well the robot knows where it is.

One task a plan and goal policy, drawn from the seed and the plan's name, so that a plan's result does not depend
on which others are run beside it, nor on the number of workers. Penetration is judged twice: by the contacts of
the physics, and by the distance of the true positions from the building's walls, which the physics knows nothing of.
"""

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import shapely
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from robosim.building import make_building
from robosim.episode import EpisodeConfig, run_episode
from robosim.files import write_json
from robosim.goals import GoalName
from robosim.odometry import NoiseModel
from robosim.planfiles import find_plans, read_plan
from robosim.plots import plot_episode
from robosim.reach import reach
from robosim.simulator import SimulatorConfig
from robosim.stopwatch import LOOP_STAGES
from robosim.tasks import make_task

_MILESTONES = (250, 500, 1000)


def run(
    plans: Sequence[str],
    *,
    goals: Sequence[GoalName],
    seed: int,
    noise: float,
    workers: int,
    out: Path,
    console: Console,
) -> Table:
    """Run the tasks, write `navigation.json` and a picture an episode, and return the table.

    Args:
        plans: Files of floor plans, folders of them, or names of shipped ones.
        goals: Policies to run on each.
        seed: Seed of tasks and noise.
        noise: Level of actuation and odometry noise.
        workers: Processes at once.
        out: Folder for the files.
        console: Where progress is shown.
    """
    jobs = [
        joblib.delayed(_episode)(path, goal, seed, noise, out) for path in find_plans(plans) for goal in goals
    ]
    rows = []
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task("episodes", total=len(jobs))
        for row in joblib.Parallel(n_jobs=workers, return_as="generator")(jobs):
            rows.append(row)
            progress.update(bar, advance=1, description=f"{row['plan']} {row['goal']} {row['ended']}")
    write_json(out / "navigation.json", {"seed": seed, "noise": noise, "episodes": rows})
    return _table(rows)


def _episode(path: str | Path, goal: GoalName, seed: int, noise: float, out: Path) -> dict[str, Any]:
    """One episode, as a row of the table."""
    plan = read_plan(path)
    own_seed = zlib.crc32(f"{seed} {plan.name}".encode())
    simulator = SimulatorConfig(noise=NoiseModel(level=noise))
    config = EpisodeConfig(goal=goal, seed=own_seed, simulator=simulator)
    building = make_building(plan, config=config.building)
    places = reach(building, simulator.robot.radius_m)
    task = make_task(places, np.random.default_rng([own_seed, 0]))
    log, estimate = run_episode(building, places, task, config)
    plot_episode(out / f"{plan.name}-{goal}.png", building, log, estimate)
    points = shapely.points(np.array(log.poses)[:, :2])
    clearance = shapely.distance(points, building.free.boundary) - simulator.robot.radius_m
    coverage = {f"coverage_{n}": log.coverage[min(n, len(log.coverage) - 1)] for n in _MILESTONES}
    loop_s = sum(log.seconds.get(stage, 0.0) for stage in LOOP_STAGES)
    return {
        "plan": plan.name,
        "goal": goal,
        **log.result(),
        **coverage,
        "deepest_by_distance_m": max(0.0, -float(clearance.min())),
        "decisions_per_s": log.steps / loop_s,
        "seconds": log.seconds,
    }


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="Navigation: one task a plan", caption=_summary(rows))
    for name in ("plan", "goal", "ended", "steps", "SPL", "seen 250/500/1000 [%]"):
        table.add_column(name)
    for name in ("penetration [mm]", "pose error RMS [cm]", "collisions", "decisions/s"):
        table.add_column(name, justify="right")
    for row in rows:
        deepest = max(row["deepest_penetration_m"], row["deepest_by_distance_m"])
        table.add_row(
            row["plan"],
            row["goal"],
            row["ended"],
            str(row["steps"]),
            f"{row['spl']:.2f}",
            "/".join(f"{100 * row[f'coverage_{n}']:.0f}" for n in _MILESTONES),
            f"{1000 * deepest:.1f}",
            f"{100 * row['position_error_rms_m']:.1f}",
            str(row["collisions"]),
            f"{row['decisions_per_s']:.0f}",
        )
    return table


def _summary(rows: list[dict[str, Any]]) -> str:
    """One line a policy: what the table comes to."""
    lines = []
    for goal in dict.fromkeys(row["goal"] for row in rows):
        own = [row for row in rows if row["goal"] == goal]
        arrived = sum(row["arrived"] for row in own)
        seen = np.array([[row[f"coverage_{n}"] for n in _MILESTONES] for row in own])
        deepest = max(max(row["deepest_penetration_m"], row["deepest_by_distance_m"]) for row in own)
        error = np.array([row["position_error_last_m"] for row in own])
        lines.append(
            f"{goal}: {arrived} of {len(own)} arrived ({100 * arrived / len(own):.1f} %), "
            f"mean SPL {np.mean([row['spl'] for row in own]):.3f}, "
            f"mean seen {'/'.join(f'{100 * mean:.1f}' for mean in seen.mean(0))} %, "
            f"deepest penetration {1000 * deepest:.2f} mm, "
            f"last pose error median {100 * np.median(error):.1f} cm, 95 % {100 * np.quantile(error, 0.95):.1f} cm, "
            f"median {np.median([row['decisions_per_s'] for row in own]):.0f} decisions/s"
        )
    return "\n".join(lines)
