"""Maps over many plans: the learned mapper against the classical one on the same frames.

A robot explores each plan by the classical map, with noise of motion, odometry and depth. At every frame the truth
ahead (`robosim.true_patch`) is compared with what is told of it by

- the frame alone: its scan entered into an empty classical grid that lies along the patch,
- the classical map, cut at the estimated pose, cell by cell and mixed between cells, whichever fits the truth better,
- the network,
- the learned map, into which its answers are fused, cut in the same way.

Obstacles in view: within the field of view and 3.2 m. Hidden: the rest of the patch, as far as it is floor or the face
of a wall; there the classical map says what it saw from elsewhere, and unknown is neither obstacle nor floor.
"""

import time
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import joblib
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from robosim.building import make_building
from robosim.depth_noise import DepthNoise
from robosim.files import write_json
from robosim.navigation import make_navigator
from robosim.odometry import NoiseModel
from robosim.planfiles import find_plans, read_plan
from robosim.plots import save_figure
from robosim.reach import reach
from robosim.simulator import Simulator, SimulatorConfig
from robosim.tasks import make_task
from robosim.true_patch import MATTERS, OBSTACLE, SEEN, TruePatches
from slam.egocentric import AHEAD, belief_ahead, egocentric_map
from slam.grid import MapEstimate
from slam.mapper.scores import PatchScores
from slam.neural_mapping import NeuralMapper
from slam.occupancy import OccupancyGrid
from slam.projection import scan_from_depth

#: Who tells of the patch.
TELLERS = ("frame alone", "classical map", "classical map, mixed", "network", "learned map")


def run(
    plans: Sequence[str],
    *,
    mapper: str,
    steps: int,
    seed: int,
    noise: float,
    depth_noise: float,
    workers: int,
    out: Path,
    console: Console,
) -> Table:
    """Explore, write `slam.json` and the reliability plot, and return the table.

    Args:
        plans: Files of floor plans, folders of them, or names of shipped ones.
        mapper: Learned mapper, as in `robosim.navigation`.
        steps: Frames of each plan.
        seed: Seed of tasks and noise.
        noise: Level of actuation and odometry noise.
        depth_noise: Level of the depth camera's noise.
        workers: Processes at once; scores do not depend on it.
        out: Folder for the files.
        console: Where progress is shown.
    """
    simulator = SimulatorConfig(
        physics="kinematic", noise=NoiseModel(level=noise), depth_noise=DepthNoise(level=depth_noise)
    )
    jobs = [joblib.delayed(_explore)(path, mapper, steps, seed, simulator) for path in find_plans(plans)]
    rows, scores = [], {teller: PatchScores() for teller in TELLERS}
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task("plans", total=len(jobs))
        for row, own in joblib.Parallel(n_jobs=workers, return_as="generator")(jobs):
            rows.append(row)
            for teller, score in own.items():
                scores[teller].merge(score)
            progress.update(bar, advance=1, description=row["plan"])
    overall = {teller: score.result() for teller, score in scores.items()}
    settings = {"seed": seed, "noise": noise, "depth_noise": depth_noise, "steps": steps, "mapper": mapper}
    write_json(out / "slam.json", {**settings, "overall": overall, "plans": rows})
    _plot_reliability(scores, out / "reliability.png")
    return _table(rows, overall)


def _explore(
    path: str | Path, mapper: str, steps: int, seed: int, config: SimulatorConfig
) -> tuple[dict[str, Any], dict[str, PatchScores]]:
    """Scores of one plan, as numbers and to be added up."""
    plan = read_plan(path)
    building = make_building(plan)
    places, truth = reach(building, config.robot.radius_m), TruePatches(building)
    rng = np.random.default_rng([seed, zlib.crc32(plan.name.encode())])
    task = make_task(places, rng)
    learned, planner, controller, explorer = make_navigator(config, mapper=mapper)
    if not isinstance(learned, NeuralMapper):
        raise ValueError(f"mapper is {mapper!r}, expected a learned one: neural, or a .safetensors file.")
    simulator = Simulator(building, config)
    scores = {teller: PatchScores() for teller in TELLERS}
    errors, seconds, action = [], [], None
    try:
        view = simulator.reset(task, rng)
        learned.reset(task.start)
        for _ in range(steps):
            begin = time.perf_counter()
            estimate = learned.update(view.depth, action, view.odometry)
            seconds.append(time.perf_counter() - begin)
            errors.append(float(np.hypot(*(estimate.pose - simulator.pose)[:2])))
            patch = truth.at(simulator.pose)
            for teller, told in _told(learned, estimate, view.depth).items():
                scores[teller].add(told, patch[OBSTACLE], patch[SEEN], patch[MATTERS])
            known = learned.classical.estimate()
            goal = explorer.goal(known)
            if goal is None:
                break
            action = controller.act(known.pose, planner.plan(known, goal))
            view, _ = simulator.step(action)
    finally:
        simulator.close()
    row: dict[str, Any] = {teller: score.result() for teller, score in scores.items()}
    return {
        "plan": plan.name,
        "frames": len(errors),
        "pose_error_median_m": float(np.median(errors)),
        "mapper_ms_median": 1000 * float(np.median(seconds)),
        **row,
    }, scores


def _told(
    learned: NeuralMapper, estimate: MapEstimate, depth: np.ndarray
) -> dict[str, Float[np.ndarray, "ny nx"]]:
    """Obstacle probability of the patch, by each teller."""
    classical = learned.classical.estimate()
    config = learned.classical.config
    frame = OccupancyGrid(AHEAD, config.occupancy)
    scan = scan_from_depth(depth, config.camera, config.band)
    lowest = float(config.camera.slopes(depth.shape)[1][-1])
    frame.integrate(scan, np.zeros(3), config.camera.height_m, lowest)
    mixed = belief_ahead(classical)
    nearest = np.where(egocentric_map(classical)[0], 1.0, np.minimum(mixed, 0.5))
    answer = learned.prediction
    return {
        "frame alone": frame.probability,
        "classical map": nearest,
        "classical map, mixed": mixed,
        "network": 1 / (1 + np.exp(-answer.obstacle)),
        "learned map": belief_ahead(estimate, anticipated=True),
    }


def _table(rows: list[dict[str, Any]], overall: dict[str, dict[str, float]]) -> Table:
    table = Table(title="Maps of the 3.2 m ahead, against the truth", caption=_caption(rows))
    table.add_column("told by")
    columns = {
        "obstacles in view: IoU": "iou_seen",
        "obstacles hidden: IoU": "iou_hidden",
        "floor hidden: IoU": "iou_hidden_floor",
        "calibration error in view": "calibration_error_seen",
        "elsewhere": "calibration_error_hidden",
        "Brier score in view": "brier_seen",
        "elsewhere ": "brier_hidden",
    }
    for title in columns:
        table.add_column(title, justify="right")
    for teller, score in overall.items():
        table.add_row(teller, *(f"{score[name]:.3f}" for name in columns.values()))
    return table


def _caption(rows: list[dict[str, Any]]) -> str:
    """Spread over plans, and what it takes."""
    lines = []
    for teller in ("classical map", "network"):
        seen = np.array([row[teller]["iou_seen"] for row in rows])
        lines.append(
            f"{teller}, obstacles in view by plan: median {np.median(seen):.3f}, worst {seen.min():.3f} "
            f"({rows[int(seen.argmin())]['plan']})"
        )
    lines.append(
        f"{len(rows)} plans, {sum(row['frames'] for row in rows)} frames; median pose error "
        f"{100 * np.median([row['pose_error_median_m'] for row in rows]):.1f} cm; learned mapper "
        f"{np.median([row['mapper_ms_median'] for row in rows]):.1f} ms a frame, the classical part included"
    )
    return "\n".join(lines)


def _plot_reliability(scores: dict[str, PatchScores], path: Path) -> None:
    """Share that came true against the probability told."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained")
    for ax, part in zip(axes, ("seen", "hidden"), strict=True):
        ax.plot([0, 1], [0, 1], color="0.7")
        for teller, score in scores.items():
            told, came, _ = score.reliability(part).T
            ax.plot(told, came, ".-", label=teller)
        ax.set(title=f"cells {part}", xlabel="probability told", ylabel="share that were obstacles")
        ax.legend()
    save_figure(figure, path)
