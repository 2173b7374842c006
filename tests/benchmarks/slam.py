"""Mapping and moving over many plans: the classical mapper against the learned one, and ways to know the pose.

What is measured in each plan is in `slam_plan`; speed against error in `slam_speed`.
Obstacles in view: within the field of view and 3.2 m. Hidden: the
rest of the patch ahead, as far as it is floor or the face of a wall; there the classical map says what it saw from
elsewhere, and unknown is neither obstacle nor floor.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from robosim.building.building import make_building
from robosim.generator.trial_floors import TRIAL_FLOORS
from robosim.plans.files import find_plans
from robosim.support.files import write_json, write_whole
from robosim.support.progress import told_units
from robosim.support.run_folder import run_folder
from robosim.support.stopwatch import LOOP_STAGES
from robosim.support.text_in import read_json
from robosim.support.workers import Workers
from slam.networks.scores import PatchScores
from tests.benchmarks.exploration import MILESTONES, area_under, bumps_in_100_m, gain_over, held
from tests.benchmarks.slam_pictures import plot_coverage, plot_map, plot_reliability
from tests.benchmarks.slam_plan import EVERY, MATCHED, TELLERS, TOLD_AT, Floor, SlamSettings, measure_plan
from tests.benchmarks.slam_speed import SpeedSettings, speed_table, speeds


def run(
    plans: Sequence[str],
    settings: SlamSettings,
    *,
    speed: SpeedSettings | None,
    workers: int,
    cluster: str | None = None,
    angles_deg: Sequence[float] = (0.0,),
    out: Path,
    console: Console,
) -> Group:
    """Measure the plans that are missing, write `slam.json` and pictures, and return the tables.

    Args:
        plans: Files of floor plans, folders of them, or names of shipped ones or of `robosim.generator.trial_floors`.
        settings: What to run in each.
        speed: Input sizes and networks to compare; None leaves that out.
        workers: Processes at once; scores do not depend on it.
        cluster: Address of a dask scheduler that is used instead; times are of its machines then.
        angles_deg: Each plan is turned by each of these against its grid.
        out: Folder for the files.
        console: Where progress is shown.
    """
    sources = [word for word in plans if word in TRIAL_FLOORS]
    sources += [str(path) for path in find_plans([word for word in plans if word not in TRIAL_FLOORS])]
    found = [Floor(source, degrees) for source in sources for degrees in angles_deg]
    floors = {floor.plan().name: floor for floor in found}
    with run_folder(out, "bench slam", asdict(settings)):
        rows = _measured(floors, settings, workers, cluster, out, console)
        return _told(floors, rows, settings, speed, workers, out, console)


def _measured(
    floors: Mapping[str, Floor],
    settings: SlamSettings,
    workers: int,
    cluster: str | None,
    out: Path,
    console: Console,
) -> list[dict[str, Any]]:
    """What is told of each plan, by name; from its file where it was measured before."""
    missing = [name for name in floors if not _row_file(out, name).exists()]
    with (
        Workers(min(workers, len(missing) or 1), cluster, what="plans") as pool,
        told_units(console, "plans", len(floors), len(floors) - len(missing)) as tell,
    ):
        for _, (row, maps) in pool.run(measure_plan, [(floors[name], settings) for name in missing]):
            write_whole(_row_file(out, row["plan"]).with_suffix(".npz"), maps)
            write_json(_row_file(out, row["plan"]), row)
            tell(row["plan"])
    remedy = "Delete it to measure again."
    return [read_json(_row_file(out, name), "results of a plan", remedy) for name in sorted(floors)]


def _row_file(out: Path, plan: str) -> Path:
    return out / "plans" / f"{plan}.json"


def _told(
    floors: Mapping[str, Floor],
    rows: list[dict[str, Any]],
    settings: SlamSettings,
    speed: SpeedSettings | None,
    workers: int,
    out: Path,
    console: Console,
) -> Group:
    """Write `slam.json` and pictures, and return the tables."""
    scores = {teller: _merged(rows, teller) for teller in TELLERS}
    summary: dict[str, Any] = {
        "settings": asdict(settings),
        "plans": [row["plan"] for row in rows],
        "frames_scored": sum(-(-row["frames"] // EVERY) for row in rows),
        "maps": {teller: score.result() for teller, score in scores.items()},
        "poses": _poses(rows),
        "walks": {name: _walks(rows, name) for name in ("classical", "learned")},
    }
    tables = [
        _map_table(rows, summary),
        _pose_table(summary),
        _part_table(rows),
        _walk_table(rows, summary),
        _stage_table(rows),
    ]
    files = [Path(floor.source) for floor in floors.values() if floor.source not in TRIAL_FLOORS]
    if speed is not None and files:
        summary["speed"] = speeds(
            list(dict.fromkeys(files)), speed, settings, workers=workers, out=out, console=console
        )
        tables.append(speed_table(summary["speed"]))
    write_json(out / "slam.json", summary)
    plot_reliability(scores, out / "reliability.png")
    plot_coverage(rows, out / "coverage.png")
    order = sorted(rows, key=lambda row: _own_iou(row, "network"))
    for name, row in (("worst", order[0]), ("median", order[len(order) // 2]), ("best", order[-1])):
        plan = row["plan"]
        title = f"{name} of {len(rows)}: {plan}, IoU of obstacles in view {_own_iou(row, 'network'):.3f}"
        kept = out / "plans" / f"{plan}.npz"
        plot_map(out / f"{name}.png", make_building(floors[plan].plan()), kept, title)
    return Group(*tables)


def _merged(rows: list[dict[str, Any]], teller: str) -> PatchScores:
    total = PatchScores()
    for row in rows:
        total.merge(PatchScores.of_counts(row["maps"][teller]))
    return total


def _own_iou(row: dict[str, Any], teller: str, part: str = "iou_seen") -> float:
    return PatchScores.of_counts(row["maps"][teller]).result()[part]


def _poses(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Medians over plans, and the 95th percentile, of errors of each way to know the pose."""
    out = {}
    for name in rows[0]["poses"]:
        own = [row["poses"][name] for row in rows if name in row["poses"]]
        out[name] = {key: float(np.median([pose[key] for pose in own])) for key in own[0]}
        for key in ("then_m", "then_deg", "ate_m"):
            out[name][f"{key}_95"] = float(np.quantile([pose[key] for pose in own], 0.95))
    return out


def _walks(rows: list[dict[str, Any]], name: str) -> dict[str, float]:
    """Means over plans of what walks of one mapper came to."""
    own = [row["walks"][name] for row in rows]
    curves = np.array([held(np.array(walk["coverage"])) for walk in own])
    stages = {stage: float(np.median([walk["stage_ms"][stage] for walk in own])) for stage in LOOP_STAGES}
    return {
        **{f"seen_after_{n}": float(curves[:, n].mean()) for n in MILESTONES},
        "seen_least": float(curves[:, -1].min()),
        "area_under_curve": float(np.mean([area_under(curve) for curve in curves])),
        "collisions": float(np.mean([walk["collisions"] for walk in own])),
        "bumps_in_100_m": bumps_in_100_m(own),
        "decisions_per_s": float(np.median([walk["decisions_per_s"] for walk in own])),
        "ate_m": float(np.median([walk["ate_m"] for walk in own])),
        **{f"{stage}_ms": value for stage, value in stages.items()},
    }


def _numbers(title: str, first: str, columns: Sequence[str], caption: str = "") -> Table:
    table = Table(title=title, caption=Text(caption, "table.caption"))
    table.add_column(first)
    for column in columns:
        table.add_column(column, justify="right")
    return table


def _map_table(rows: list[dict[str, Any]], summary: dict[str, Any]) -> Table:
    columns = {
        "obstacles in view: IoU": "iou_seen",
        "obstacles hidden: IoU": "iou_hidden",
        "floor hidden: IoU": "iou_hidden_floor",
        "calibration error in view": "calibration_error_seen",
        "elsewhere": "calibration_error_hidden",
        "Brier score in view": "brier_seen",
        "elsewhere ": "brier_hidden",
    }
    lines = [f"{len(rows)} plans, {summary['frames_scored']} frames"]
    for teller in ("classical map", "network"):
        seen = np.array([_own_iou(row, teller) for row in rows])
        lines.append(
            f"{teller}, obstacles in view by plan: median {np.median(seen):.3f}, worst {seen.min():.3f} "
            f"({rows[int(seen.argmin())]['plan']})"
        )
    table = _numbers("Maps of the 3.2 m ahead, against the truth", "told by", list(columns), "\n".join(lines))
    for teller, score in summary["maps"].items():
        table.add_row(teller, *(f"{score[name]:.3f}" for name in columns.values()))
    return table


def _pose_table(summary: dict[str, Any]) -> Table:
    columns = (
        f"after {TOLD_AT} decisions: median [m]",
        "95 % [m]",
        "median [deg]",
        "95 % [deg]",
        "ATE [m]",
        "RPE [mm]",
        "RPE [deg]",
        "ms a frame",
    )
    caption = "Learned pose and scan matching: the time of the whole mapper"
    table = _numbers("Pose on the same frames, medians over plans", "by", columns, caption)
    for name, pose in summary["poses"].items():
        table.add_row(
            name,
            f"{pose['then_m']:.3f}",
            f"{pose['then_m_95']:.3f}",
            f"{pose['then_deg']:.2f}",
            f"{pose['then_deg_95']:.2f}",
            f"{pose['ate_m']:.3f}",
            f"{1000 * pose['rpe_m']:.1f}",
            f"{pose['rpe_deg']:.3f}",
            f"{pose.get('ms', summary['walks']['classical']['mapper_ms']):.2f}",
        )
    return table


def _part_table(rows: list[dict[str, Any]]) -> Table:
    """Errors of the pose on each plan, and what becomes of them with a part left out or a radio."""
    others = [name for name in rows[0]["poses"] if name.startswith("with")]
    columns = ["ATE [cm]", "last", "worst", "worst [deg]", *(f"ATE [cm] {name}" for name in others)]
    caption = "By scan matching, and by the same with a part left out or with a radio, on the same frames"
    table = _numbers("Pose, plan by plan", "plan", columns, caption)
    for row in rows:
        pose = row["poses"][MATCHED]
        table.add_row(
            row["plan"],
            *(f"{100 * pose[key]:.1f}" for key in ("ate_m", "last_m", "worst_m")),
            f"{pose['worst_deg']:.2f}",
            *(f"{100 * row['poses'][name]['ate_m']:.1f}" for name in others),
        )
    return table


def _walk_table(rows: list[dict[str, Any]], summary: dict[str, Any]) -> Table:
    areas = {
        name: np.array([area_under(held(np.array(row["walks"][name]["coverage"]))) for row in rows])
        for name in summary["walks"]
    }
    more, low, high = (100 * value for value in gain_over(areas["learned"], areas["classical"]))
    caption = f"Area of the learned over the classical one's: {more:+.1f} % ({low:+.1f} to {high:+.1f})"
    columns = [
        *(f"seen after {n} [%]" for n in MILESTONES),
        "least [%]",
        "area under curve",
        "bumps in 100 m",
    ]
    table = _numbers("Exploring with each map", "map", [*columns, "ATE [m]", "decisions/s"], caption)
    for name, walk in summary["walks"].items():
        table.add_row(
            name,
            *(f"{100 * walk[f'seen_after_{n}']:.1f}" for n in MILESTONES),
            f"{100 * walk['seen_least']:.1f}",
            f"{walk['area_under_curve']:.4f}",
            f"{walk['bumps_in_100_m']:.1f}",
            f"{walk['ate_m']:.3f}",
            f"{walk['decisions_per_s']:.0f}",
        )
    return table


def _stage_table(rows: list[dict[str, Any]]) -> Table:
    stages = [stage for stage in LOOP_STAGES if any(_stage(row, "learned", stage) > 0.005 for row in rows)]
    table = _numbers("Milliseconds a decision, medians over plans", "map", [*stages, "all"])
    for name in ("classical", "learned"):
        parts = [float(np.median([_stage(row, name, stage) for row in rows])) for stage in stages]
        table.add_row(name, *(f"{part:.2f}" for part in parts), f"{sum(parts):.1f}")
    return table


def _stage(row: dict[str, Any], name: str, stage: str) -> float:
    return float(row["walks"][name]["stage_ms"][stage])
