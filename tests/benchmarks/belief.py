"""Beliefs about the target's place, held against where it is.

Searches are driven by one policy, and beliefs of several kinds look on, each with another part left out, so that all
are told the same. Where a measurement counted, two things are noted:

    the density at the target   mean over 3 x 3 cells around it, per m2, as its natural logarithm: a proper score, at
                                its best in the mean for who says what is true (Gneiting and Raftery 2007)
    the mass around the peak    how much probability a belief has within 0.5, 1 and 2 m of its peak, and whether the
                                target is there: of places believed with p, a share p should hold it

The expected calibration error is the mean over ten classes of claimed mass, weighted by how many fall in each, of the
difference between the mass claimed and the share that held the target (Guo et al. 2017). Chance alone makes it larger
than 0; how much of it is told beside it. Intervals are of 95 %, from
drawing the searches anew. Each search is kept in a file of its own, so that a run which was killed goes on.

References: Gneiting and Raftery, JASA 102 (2007); Guo et al., On calibration of modern neural networks, ICML 2017.
"""

import io
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float, Int
from rich.console import Console
from rich.table import Table

from robosim.episode import Decision, EpisodeConfig, run_episode
from robosim.evaluation.episodes import Job, make_jobs, task_of
from robosim.evaluation.evaluate import find_suite
from robosim.evaluation.manifest import code_digest, settings_of
from robosim.evaluation.scores import Estimate, bootstrap
from robosim.policies.belief import BeliefConfig, TargetBelief
from robosim.support.arrays_in import Array, read_npz
from robosim.support.figures import save_figure
from robosim.support.files import write_json, write_whole
from robosim.support.progress import told_units
from robosim.support.reading import reading
from robosim.support.run_folder import run_folder
from robosim.support.workers import Workers
from robosim.task.record import EpisodeLog
from wireless.paths import LinkState

#: Distances from the peak within which a belief's mass is told [m].
RADII_M = (0.5, 1.0, 2.0)
#: Classes of claimed mass.
_CLASSES = 10
#: What is noted of each measurement that counted, by column.
_STEP, _STATE, _SCORE, _CLAIMED = 0, 1, 2, 3
_HELD = _CLAIMED + len(RADII_M)
_MS = _HELD + len(RADII_M)
_NOTED = Array("f", f"n {_MS + 1}")


def variants(base: BeliefConfig) -> dict[str, BeliefConfig]:
    """The belief as it is, and with one part left out at a time."""
    return {
        "as it is": base,
        "without ways": replace(base, ways=False),
        "without departures": replace(base, departures=False),
        "last measurement alone": replace(base, remembers=False),
        "no measurement": replace(base, weight=0.0),
    }


@dataclass(frozen=True)
class Row:
    """What one kind of belief comes to, over all searches."""

    belief: str
    measurements: int
    score: Estimate
    """Mean over searches of the logarithm of the density at the target [1/m2]."""
    score_by_state: dict[str, float]
    """The same, by believed link state, over all measurements."""
    calibration_error: dict[str, float]
    """By the radius around the peak [m]."""
    perfect_error: dict[str, float]
    """What a perfectly calibrated belief with the same claims would come to, in the mean over chance."""
    ms: tuple[float, float]
    """CPU time of a measurement that counted: mean, and what 95 % keep within."""


def run(
    plans: Sequence[str],
    *,
    goal: str,
    targets: int,
    seed: int,
    max_steps: int,
    workers: int,
    cluster: str | None = None,
    out: Path,
    console: Console,
) -> Table:
    """Run the searches that are missing, write `belief.json` and `belief.png`, and return the table.

    Args:
        plans: Files of floor plans, folders of them, or names of shipped ones.
        goal: Who drives.
        targets: Tasks of each plan.
        seed: Seed of tasks and noise.
        max_steps: Decisions before a search is given up.
        workers: Processes at once.
        cluster: Address of a dask scheduler that is used instead.
        out: Folder for the files, and to go on from.
        console: Where progress is shown.

    Raises:
        FolderError: If the folder holds searches of other settings.
        WorkerLost: If a process was killed, when the other searches are done.
    """
    config = EpisodeConfig(goal=goal, max_steps=max_steps)
    suite = find_suite(plans, config, targets=targets, seed=seed, workers=workers, console=console)
    jobs = make_jobs(suite, config, (goal,), 1, code_digest())
    with run_folder(out, "bench belief", {**settings_of(suite, config), "goal": goal}):
        files = [out / "searches" / f"{job.name.replace('/', '-')}.npz" for job in jobs]
        missing = [i for i, file in enumerate(files) if not file.exists()]
        with (
            Workers(min(workers, len(missing) or 1), cluster, what="searches") as pool,
            told_units(console, "searches", len(jobs), len(jobs) - len(missing)) as tell,
        ):
            for number, content in pool.run(watch, [(jobs[i],) for i in missing]):
                write_whole(files[missing[number]], content)
                tell(jobs[missing[number]].name)
        names = list(variants(config.fused.belief))
        noted = [read_search(file, len(names)) for file in files]
        by_name = {name: [search[i] for search in noted] for i, name in enumerate(names)}
        rows = [_row(name, searches) for name, searches in by_name.items()]
        write_json(
            out / "belief.json",
            {"goal": goal, "searches": len(jobs), "rows": [_plain(row) for row in rows]},
        )
        _plot(out / "belief.png", by_name)
    return table(rows)


def watch(job: Job) -> bytes:
    """Let beliefs look on in one search, and return what was noted as the content of a file."""
    building, places = job.scene()
    task = task_of(places, job.task)
    kinds = list(variants(job.config.fused.belief).values())
    beliefs: list[TargetBelief] = []
    noted: list[list[list[float]]] = [[] for _ in kinds]

    def look(log: EpisodeLog, decision: Decision) -> None:
        estimate = decision.estimate
        if not beliefs:
            beliefs.extend(TargetBelief(estimate.pose[:2], kind) for kind in kinds)
        for belief, lines in zip(beliefs, noted, strict=True):
            begin = process_time()
            counted = belief.add(decision.situation.measured(), estimate)
            ms = 1000 * (process_time() - begin)
            if counted:
                state = decision.situation.measured().state
                lines.append([log.steps, state, *judged(belief, task.target), ms])

    log, _ = run_episode(building, places, task, job.config, look)
    if log.ended in ("interrupted", "terminated"):
        raise KeyboardInterrupt
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {
        f"belief_{i}": np.array(lines).reshape(-1, _MS + 1) for i, lines in enumerate(noted)
    }
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def judged(belief: TargetBelief, target: Float[np.ndarray, "2"]) -> list[float]:
    """Logarithm of the density at the target, mass claimed within each radius of the peak, and whether it is there."""
    p, cell_m = belief.probability(), belief.config.cell_m
    iy, ix = (int(i) for i in belief.frame.index(target))
    around = p[max(iy - 1, 0) : iy + 2, max(ix - 1, 0) : ix + 2]
    density = float(around.mean()) / cell_m**2 if around.size else 0.0
    peak, _ = belief.peak()
    from_peak = np.hypot(*(belief.centres - peak).transpose(2, 0, 1))
    off_m = math.hypot(*(target - peak))
    claimed = [float(p[from_peak <= radius].sum()) for radius in RADII_M]
    return [math.log(max(density, 1e-12)), *claimed, *(float(off_m <= radius) for radius in RADII_M)]


def calibration_error(claimed: Float[np.ndarray, " n"], held: Float[np.ndarray, " n"]) -> float:
    """Expected calibration error: 0 if of places believed with p a share p held the target."""
    classes = _classes(claimed)
    gaps = [
        abs(float(claimed[own].mean() - held[own].mean())) * float(own.mean())
        for own in (classes == i for i in range(_CLASSES))
        if own.any()
    ]
    return sum(gaps)


def perfect_error(searches: Sequence[Float[np.ndarray, " n"]], draws: int = 200) -> float:
    """Expected calibration error of a belief whose claims are right, in the mean over chance.

    It is above 0, and falls with the number of searches: claims of one search are about one target, and so hold or fail
    together.

    Args:
        searches: Masses claimed in each search.
        draws: How often chance is tried.
    """
    rng = np.random.default_rng(0)
    claimed = np.concatenate(searches)
    own = np.repeat(np.arange(len(searches)), [len(one) for one in searches])
    chance = rng.random((draws, len(searches)))
    return float(np.mean([calibration_error(claimed, (claimed > one[own]).astype(float)) for one in chance]))


def _classes(claimed: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Which of the equal classes of claimed mass each claim falls in."""
    return np.minimum((claimed * _CLASSES).astype(int), _CLASSES - 1)


def read_search(path: Path, count: int) -> list[Float[np.ndarray, "n m"]]:
    """What was noted of each of some beliefs in one search.

    Raises:
        FileError: If the file is none of these, or damaged.
    """
    with reading(
        path, "a search of `python -m tests.benchmarks belief`", "Delete it to run it again."
    ) as file:
        arrays = read_npz(file, {f"belief_{i}": _NOTED for i in range(count)})
        for noted in arrays.values():
            shares = noted[:, _CLAIMED:_MS]
            if not np.isin(noted[:, _STATE], list(LinkState)).all():
                raise ValueError("a link state is none")
            if ((shares < 0) | (shares > 1.001)).any():
                raise ValueError("a probability is not between 0 and 1")
    return [arrays[f"belief_{i}"] for i in range(count)]


def _row(name: str, searches: list[np.ndarray]) -> Row:
    noted = np.concatenate(searches)
    means = np.array([[one[:, _SCORE].mean()] if len(one) else [np.nan] for one in searches])
    return Row(
        belief=name,
        measurements=len(noted),
        score=bootstrap(means, None),
        score_by_state={
            state.name.lower(): float(noted[own, _SCORE].mean())
            for state in LinkState
            if (own := noted[:, _STATE] == state).any()
        },
        calibration_error={
            f"{radius:g}": calibration_error(noted[:, _CLAIMED + i], noted[:, _HELD + i])
            for i, radius in enumerate(RADII_M)
        },
        perfect_error={
            f"{radius:g}": perfect_error([one[:, _CLAIMED + i] for one in searches])
            for i, radius in enumerate(RADII_M)
        },
        ms=(float(noted[:, _MS].mean()), float(np.quantile(noted[:, _MS], 0.95))),
    )


def _plain(row: Row) -> dict[str, Any]:
    return {**asdict(row), "score": row.score._asdict()}


def table(rows: Sequence[Row]) -> Table:
    """One row a kind of belief."""
    grid = Table(
        title="Log density at the target [1/m2], and calibration of the mass around the peak",
        caption="In brackets: what a perfectly calibrated belief with these claims would come to in so few searches.",
    )
    grid.add_column("belief")
    states = {state.name.lower(): state.name.lower().replace("_", " ") for state in LinkState}
    for name in ("measurements", "mean of searches (95 %)", *states.values()):
        grid.add_column(name, justify="right")
    for radius in RADII_M:
        grid.add_column(f"ECE {radius:g} m", justify="right")
    for name in ("ms", "ms, 95 %"):
        grid.add_column(name, justify="right")
    for row in rows:
        grid.add_row(
            row.belief,
            str(row.measurements),
            f"{row.score.value:.2f} ({row.score.low:.2f} to {row.score.high:.2f})",
            *(f"{row.score_by_state[s]:.2f}" if s in row.score_by_state else "-" for s in states),
            *(_shown_error(row, f"{radius:g}") for radius in RADII_M),
            *(f"{ms:.1f}" for ms in row.ms),
        )
    return grid


def _shown_error(row: Row, radius: str) -> str:
    return f"{row.calibration_error[radius]:.3f} ({row.perfect_error[radius]:.3f})"


def _plot(path: Path, by_name: dict[str, list[np.ndarray]]) -> None:
    """Reliability within 1 m, and the score over the part of the search that is done."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
    left.plot([0, 1], [0, 1], color="0.7", lw=1, label="right")
    parts = np.linspace(0, 1, 11)
    for name, searches in by_name.items():
        noted = np.concatenate(searches)
        claimed, held = noted[:, _CLAIMED + 1], noted[:, _HELD + 1]
        classes = _classes(claimed)
        shown = [i for i in range(_CLASSES) if np.count_nonzero(classes == i) >= 10]
        points = [(claimed[classes == i].mean(), held[classes == i].mean()) for i in shown]
        line = left.plot(*np.array(points).reshape(-1, 2).T, marker="o", ms=4, label=name)[0]
        curves = [
            np.interp(parts, np.linspace(0, 1, len(one)), one[:, _SCORE]) for one in searches if len(one) > 1
        ]
        right.plot(100 * parts, np.mean(curves, axis=0), color=line.get_color(), label=name)
    left.set(xlabel="mass claimed within 1 m of the peak", ylabel="share that holds the target")
    left.set(xlim=(0, 1), ylim=(0, 1))
    right.set(xlabel="part of the search that is done [%]", ylabel="log density at the target [1/m²]")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    right.legend(loc="best", fontsize=8)
    save_figure(figure, path)
