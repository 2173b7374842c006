"""Navigation over many plans: arrival, what is touched, what is seen, and how well the robot knows where it is.

One task a plan and goal policy, drawn and run as `robosim evaluate` does, so that a plan's result does not depend
on which others are run beside it, nor on the number of workers. Penetration is judged twice: by the contacts of
the physics, and by the distance of the true positions from the building's walls, which the physics knows nothing of.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robosim.episode import EpisodeConfig
from robosim.evaluation.episode_file import read_head
from robosim.evaluation.episodes import MILESTONES, make_jobs
from robosim.evaluation.evaluate import find_suite
from robosim.evaluation.manifest import code_digest, settings_of
from robosim.evaluation.sweep import sweep
from robosim.robot.odometry import NoiseModel
from robosim.simulator import SimulatorConfig
from robosim.support.files import write_json
from robosim.support.parts import Part
from robosim.support.run_folder import run_folder


def run(
    plans: Sequence[str],
    *,
    goals: Sequence[str],
    seed: int,
    noise: float,
    mapper: Part,
    explorer: Part,
    workers: int,
    cluster: str | None = None,
    out: Path,
    console: Console,
) -> Table:
    """Run the tasks, write `navigation.json`, and return the table.

    Args:
        plans: Files of floor plans, folders of them, or names of shipped ones.
        goals: Policies to run on each.
        seed: Seed of tasks and noise.
        noise: Level of actuation and odometry noise.
        mapper: Who makes the map, as in `robosim.navigation`.
        explorer: Who chooses among frontiers.
        workers: Processes at once.
        cluster: Address of a dask scheduler that is used instead.
        out: Folder for the files, and to go on from.
        console: Where progress is shown.

    Raises:
        ValueError: If the folder holds episodes of another configuration, or an episode raised an error.
    """
    simulator = SimulatorConfig(noise=NoiseModel(level=noise))
    config = EpisodeConfig(mapper=mapper, explorer=explorer, simulator=simulator)
    suite = find_suite(plans, config, targets=1, seed=seed, workers=workers, cluster=cluster, console=console)
    with run_folder(out, "bench navigation", settings_of(suite, config), grows=("plans", "tasks")):
        jobs = make_jobs(suite, config, tuple(goals), 1, code_digest())
        failures = sweep(jobs, out, workers=workers, cluster=cluster, console=console)
        if failures:
            raise ValueError(
                f"{len(failures)} episodes failed, first {failures[0].job.name}: {failures[0].error}"
            )
        heads = [read_head(job.file(out)) for job in jobs]
        rows = [
            {**h.row, "decisions_per_s": h.timing.get("decisions_per_s", 0.0), "seconds": h.timing}
            for h in heads
        ]
        told = {"seed": seed, "noise": noise, "mapper": mapper, "explorer": explorer}
        write_json(out / "navigation.json", {**told, "episodes": rows})
    return _table(rows)


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="Navigation: one task a plan", caption=_summary(rows))
    for name in ("plan", "policy", "ended", "steps", "SPL", "seen 250/500/1000 [%]"):
        table.add_column(name)
    for name in ("penetration [mm]", "pose error RMS [cm]", "collisions", "decisions/s"):
        table.add_column(name, justify="right")
    for row in rows:
        deepest = max(row["deepest_penetration_m"], row["deepest_by_distance_m"])
        table.add_row(
            Text(row["plan"]),
            row["policy"],
            row["ended"],
            str(row["steps"]),
            f"{row['spl']:.2f}",
            "/".join(f"{100 * row[f'coverage_{n}']:.0f}" for n in MILESTONES),
            f"{1000 * deepest:.1f}",
            f"{100 * row['position_error_rms_m']:.1f}",
            str(row["collisions"]),
            f"{row['decisions_per_s']:.0f}",
        )
    return table


def _summary(rows: list[dict[str, Any]]) -> str:
    """One line a policy: what the table comes to."""
    lines = []
    for goal in dict.fromkeys(row["policy"] for row in rows):
        own = [row for row in rows if row["policy"] == goal]
        arrived = sum(row["arrived"] for row in own)
        seen = np.array([[row[f"coverage_{n}"] for n in MILESTONES] for row in own])
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
