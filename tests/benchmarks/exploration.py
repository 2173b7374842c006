"""Exploration over many plans: how much of the floor is seen after how many decisions, by each explorer.

Every explorer gets the same tasks: start, noise and seeds depend on the plan alone. The score is the area under the
curve of coverage over the first 1000 decisions, divided by 1000: the mean part of the floor that had been seen. A
robot that ends sooner keeps what it has seen. Against the first explorer the difference is taken plan by plan, with an
interval of 95 % from drawing the plans anew 2000 times (bootstrap).
Each episode is kept in a file of its own, so that a run which was killed goes on where it was.
Reference: Chaplot et al., ICLR 2020 (coverage at 1000 steps); Efron, Annals of Statistics 7(1), 1979.
"""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.collections import LineCollection
from rich.console import Console
from rich.table import Table

from robosim.building.building import Building, make_building
from robosim.building.reach import reach
from robosim.camera.depth_noise import DepthNoise
from robosim.drawing.plots import plan_axes
from robosim.episode import EpisodeConfig, run_episode
from robosim.parts import MapperPart, PhysicsPart
from robosim.plans.files import find_plans, read_plan
from robosim.robot.odometry import NoiseModel
from robosim.simulator import SimulatorConfig
from robosim.support.checks import LEVEL, SEED, checked
from robosim.support.figures import save_figure
from robosim.support.files import write_json
from robosim.support.progress import told_units
from robosim.support.run_folder import run_folder
from robosim.support.stopwatch import LOOP_STAGES
from robosim.support.text_in import read_json
from robosim.support.workers import Workers
from robosim.task.tasks import make_task
from slam.exploration.explorer import ExplorerName
from slam.planning.paths import length

#: Decisions of an episode, and those at which coverage is told.
DECISIONS = 1000
MILESTONES = (250, 500, 1000)


@dataclass(frozen=True, kw_only=True)
@checked
class ExplorationSettings:
    """What is the same for every explorer."""

    mapper: MapperPart
    """Who makes the map, as in `robosim.navigation`."""
    seed: Annotated[int, SEED] = 1
    """Seed of tasks and noise."""
    noise: Annotated[float, LEVEL] = 1.0
    """Level of actuation and odometry noise."""
    depth_noise: Annotated[float, LEVEL] = 0.0
    """Level of the depth camera's noise."""
    physics: PhysicsPart = "dynamic"
    """How the robot is moved."""

    def episode(self, explorer: ExplorerName, plan: str) -> EpisodeConfig:
        """Exploring a plan by an explorer."""
        return EpisodeConfig(
            goal="explore",
            explorer=explorer,
            mapper=self.mapper,
            seed=zlib.crc32(f"{self.seed} {plan}".encode()),
            max_steps=DECISIONS,
            simulator=SimulatorConfig(
                physics=self.physics,
                noise=NoiseModel(level=self.noise),
                depth_noise=DepthNoise(level=self.depth_noise),
            ),
        )


def run(
    plans: Sequence[str],
    settings: ExplorationSettings,
    *,
    explorers: Sequence[str],
    workers: int,
    cluster: str | None = None,
    out: Path,
    console: Console,
) -> Table:
    """Run the episodes that are missing, write `exploration.json`, curves and pictures, and return the table.

    Args:
        plans: Files of floor plans, folders of them, or names of shipped ones.
        settings: What is the same for all.
        explorers: Explorers to run on each; the first is the one that others are compared with.
        workers: Processes at once.
        cluster: Address of a dask scheduler that is used instead.
        out: Folder for the files.
        console: Where progress is shown.

    Raises:
        FolderError: If the folder holds episodes of other settings.
        WorkerLost: If a process was killed, when the other episodes are done.
    """
    found = {read_plan(path).name: path for path in find_plans(plans)}
    units = [(name, explorer) for name in found for explorer in explorers]
    with run_folder(out, "bench exploration", asdict(settings)):
        missing = [unit for unit in units if not _file(out, *unit).exists()]
        calls = [(found[name], explorer, settings) for name, explorer in missing]
        with (
            Workers(min(workers, len(calls) or 1), cluster, what="episodes") as pool,
            told_units(console, "episodes", len(units), len(units) - len(missing)) as tell,
        ):
            for number, row in pool.run(_episode, calls):
                write_json(_file(out, *missing[number]), row)
                tell(" ".join(missing[number]))
        rows = [
            read_json(_file(out, *unit), "results of a plan", "Delete it to measure again.") for unit in units
        ]
        scores = [
            {key: value for key, value in row.items() if key not in ("coverage", "poses")} for row in rows
        ]
        write_json(out / "exploration.json", {**asdict(settings), "episodes": scores})
        plot_curves(out / "exploration.png", rows)
        _plot_ways(rows, found, out)
    return table(rows)


def _file(out: Path, plan: str, explorer: str) -> Path:
    return out / "episodes" / f"{plan}-{explorer}.json"


def _episode(path: Path, explorer: ExplorerName, settings: ExplorationSettings) -> dict[str, Any]:
    """One episode, as a row of the table."""
    plan = read_plan(path)
    config = settings.episode(explorer, plan.name)
    building = make_building(plan, config=config.building)
    robot = config.simulator.robot
    places = reach(building, robot.radius_m, robot.height_m)
    task = make_task(places, np.random.default_rng([config.seed, 0]))
    log, _ = run_episode(building, places, task, config)
    loop_s = sum(log.seconds.get(stage, 0.0) for stage in LOOP_STAGES)
    poses = np.array(log.poses)
    return {
        "plan": plan.name,
        "explorer": explorer,
        **asdict(settings),
        **log.result(),
        "coverage": held(np.array(log.coverage)).round(4),
        "poses": poses.round(3),
        "path_length_m": length(poses[:, :2]),  # of the whole walk, which may have passed the target
        "decisions_per_s": log.steps / loop_s,
    }


def held(coverage: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
    """Coverage before each of the first 1000 decisions and after the last: the last value is held."""
    n = DECISIONS + 1
    return np.concatenate([coverage, np.full(n, coverage[-1])])[:n]


def area_under(coverage: Float[np.ndarray, " n"]) -> float:
    """Area under the curve of coverage over decisions, by trapezoids, divided by its width: 0 to 1."""
    return float(np.trapezoid(coverage) / (len(coverage) - 1))


def bumps_in_100_m(rows: Sequence[Mapping[str, Any]]) -> float:
    """Actions that ended at something, for 100 m driven in all episodes together."""
    driven_m = sum(row["path_length_m"] for row in rows)
    return 100 * sum(row["collisions"] for row in rows) / max(driven_m, 1e-9)


def gain_over(
    own: Float[np.ndarray, " n"], other: Float[np.ndarray, " n"], draws: int = 2000
) -> tuple[float, float, float]:
    """By which part the mean over plans exceeds another explorer's on the same plans, with its interval of 95 %."""
    drawn = np.random.default_rng(0).integers(len(own), size=(draws, len(own)))
    ratios = own[drawn].mean(axis=1) / other[drawn].mean(axis=1) - 1
    low, high = np.quantile(ratios, [0.025, 0.975])
    return float(own.mean() / other.mean() - 1), float(low), float(high)


def _by_explorer(rows: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """Rows of each explorer, sorted by plan."""
    names = dict.fromkeys(row["explorer"] for row in rows)
    return {
        name: sorted((r for r in rows if r["explorer"] == name), key=lambda r: str(r["plan"]))
        for name in names
    }


def table(rows: list[dict[str, Any]]) -> Table:
    """One row an explorer: what all its episodes come to.

    Args:
        rows: Episodes, as `run` collects them: the same plans for each explorer.
    """
    grid = Table(title=f"Exploration: {DECISIONS} decisions a plan")
    grid.add_column("explorer")
    for name in ("plans", *(f"seen after {n} [%]" for n in MILESTONES), "least after 1000 [%]"):
        grid.add_column(name, justify="right")
    for name in ("area under curve", "over the first [%]", "bumps in 100 m", "decisions/s"):
        grid.add_column(name, justify="right")
    first: np.ndarray | None = None
    for name, own in _by_explorer(rows).items():
        curves = np.array([row["coverage"] for row in own])
        area = np.array([area_under(curve) for curve in curves])
        first = area if first is None else first
        more, low, high = (100 * value for value in gain_over(area, first))
        grid.add_row(
            name,
            str(len(own)),
            *(f"{100 * curves[:, n].mean():.1f}" for n in MILESTONES),
            f"{100 * curves[:, -1].min():.1f}",
            f"{area.mean():.4f}",
            "-" if area is first else f"{more:+.1f} ({low:+.1f} to {high:+.1f})",
            f"{bumps_in_100_m(own):.1f}",
            f"{np.median([row['decisions_per_s'] for row in own]):.0f}",
        )
    return grid


def plot_curves(path: Path, rows: list[dict[str, Any]]) -> None:
    """Draw median and quartiles over plans of coverage against decisions."""
    figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
    for name, own in _by_explorer(rows).items():
        curves = 100 * np.array([row["coverage"] for row in own])
        area = np.mean([area_under(curve) for curve in curves]) / 100
        low, middle, high = np.quantile(curves, [0.25, 0.5, 0.75], axis=0)
        line = axes.plot(middle, label=f"{name}: area {area:.3f}")[0]
        axes.fill_between(np.arange(len(middle)), low, high, color=line.get_color(), alpha=0.15, lw=0)
    axes.set(xlabel="decisions", ylabel="reachable floor seen [%]", xlim=(0, DECISIONS), ylim=(0, 101))
    axes.set_title("Median over plans, and the middle half of them", fontsize=9)
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right", fontsize=8)
    save_figure(figure, path)


def _plot_ways(rows: list[dict[str, Any]], files: dict[str, Path], out: Path) -> None:
    """Draw the last explorer's ways through the best, the median and the worst of its plans."""
    own = next(reversed(_by_explorer(rows).values()))
    order = sorted(own, key=lambda row: area_under(np.array(row["coverage"])))
    for name, row in (("worst", order[0]), ("median", order[len(order) // 2]), ("best", order[-1])):
        plot_way(out / f"{name}.png", make_building(read_plan(files[row["plan"]])), row)


def plot_way(path: Path, building: Building, row: dict[str, Any]) -> None:
    """Draw the way of an episode through its plan, coloured by decision."""
    figure, axes = plan_axes(building)
    axes.set_facecolor("white")
    building.draw_walls(axes)
    points = np.array(row["poses"])[:, :2]
    way = LineCollection(list(np.stack([points[:-1], points[1:]], axis=1)), cmap="viridis", linewidths=1.6)
    way.set_array(np.arange(len(points) - 1))
    axes.add_collection(way)
    axes.plot(*points[0], "o", color="black", ms=5)
    figure.colorbar(way, ax=axes, label="decision", shrink=0.7)
    curve = np.array(row["coverage"])
    seen = ", ".join(f"{100 * curve[n]:.0f} % after {n}" for n in MILESTONES)
    axes.set_title(
        f"{row['plan']}, {row['explorer']}: {seen}; area {area_under(curve):.3f}",
        fontsize=9,
        parse_math=False,
    )
    save_figure(figure, path)
