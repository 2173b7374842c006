"""Beliefs about the target's place, against where it is.

Searches are driven by one policy, and beliefs with one part left out get the same measurements. Where a measurement
counted, two things are noted:

    the density at the target   mean over 3 x 3 cells around it, per m2, as its natural logarithm: a proper score
    the mass around the peak    probability within 0.5, 1 and 2 m of the peak, and whether the target is there

The expected calibration error is the mean over ten classes of claimed mass, weighted by how many fall in each, of the
difference between the mass claimed and the share that held the target. Chance alone makes it larger than 0; how much is
reported with it. Intervals are of 95 %, by bootstrap over searches.
References: Gneiting and Raftery, JASA 102 (2007); Guo et al., On calibration of modern neural networks, ICML 2017.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from time import process_time
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int
from tyro.conf import OmitArgPrefixes, Positional

from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.episode_log import EpisodeLog
from robosim.evaluation.episodes import Job, make_jobs, task_of
from robosim.evaluation.evaluate import find_suite
from robosim.evaluation.search_scores import bootstrap
from robosim.policies.belief import BeliefConfig, TargetBelief
from robosim.step import Step
from tests.benchmarks.harness import DEFAULT, Options, console, figure_of, run_units
from tests.benchmarks.results import Results
from tests.benchmarks.search import words_of
from wireless.paths import LinkState

#: Distances from the peak within which a belief's mass is noted [m].
RADII_M = (0.5, 1.0, 2.0)
#: Classes of claimed mass.
CLASSES = 10
#: What is noted of each measurement that counted, by column: link state, logarithm of the density, masses claimed,
#: whether they held the target, milliseconds.
STATE, SCORE, CLAIMED = 0, 1, 2
HELD = CLAIMED + len(RADII_M)
MS = HELD + len(RADII_M)


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    goal: Literal["snr", "los", "los-or-first", "fused"] = "fused",
    targets: int = 3,
    max_steps: int = 1000,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """The belief about the target's place: calibration, density at the target, and cost, with parts left out.

    Goes on after a kill if it is given the same folder.

    Args:
        plans: Floor plans, or folders of them.
        goal: Goal policy that drives.
        targets: Tasks of each plan.
        max_steps: Decisions before giving up.
        options: Of every benchmark.
    """
    config = EpisodeConfig(goal=goal, max_steps=max_steps)
    suite = find_suite(
        plans, config, targets=targets, seed=options.seed, workers=options.workers, console=console
    )
    units = {job.name: (job,) for job in make_jobs(suite, config, (goal,), 1, "belief")}
    found = run_units(search, units, options.folder("belief"), workers=options.workers)
    names = list(variants(config.fused.belief))
    by_name = {name: [one[i] for one in found.values()] for i, name in enumerate(names)}
    results = Results()
    for name, searches in by_name.items():
        summarise(name, searches, results)
    results.figures["belief"] = draw(by_name)
    return options.finish("belief", results)


def variants(base: BeliefConfig) -> dict[str, BeliefConfig]:
    """The whole belief, and with one part left out at a time."""
    return {
        "whole": base,
        "without routes": replace(base, routes=False),
        "without departures": replace(base, departures=False),
        "last measurement alone": replace(base, remembers=False),
        "no measurement": replace(base, weight=0.0),
    }


def search(job: Job) -> list[Float[np.ndarray, "n 9"]]:
    """Run a search, and note what each belief knew at each measurement that counted."""
    building, places = job.scene()
    task = task_of(places, job.task)
    kinds = list(variants(job.config.fused.belief).values())
    beliefs: list[TargetBelief] = []
    noted: list[list[list[float]]] = [[] for _ in kinds]

    def look(log: EpisodeLog, step: Step) -> None:
        estimate, measured = step.estimated.map, step.estimated.require_measurement()
        if not beliefs:
            beliefs.extend(TargetBelief(estimate.pose[:2], kind) for kind in kinds)
        for belief, lines in zip(beliefs, noted, strict=True):
            begin = process_time()
            counted = belief.add(measured, estimate)
            ms = 1000 * (process_time() - begin)
            if counted:
                lines.append([measured.state, *judge(belief, task.target), ms])

    log, _ = run_episode(building, places, task, job.config, look)
    if log.ended in ("interrupted", "terminated"):
        raise KeyboardInterrupt
    return [np.array(lines).reshape(-1, MS + 1) for lines in noted]


def judge(belief: TargetBelief, target: Float[np.ndarray, "2"]) -> list[float]:
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
    return sum(
        abs(float(claimed[own].mean() - held[own].mean())) * float(own.mean())
        for own in (classes == i for i in range(CLASSES))
        if own.any()
    )


def perfect_error(searches: Sequence[Float[np.ndarray, " n"]], draws: int = 200) -> float:
    """Expected calibration error of a belief whose claims are right, in the mean over chance.

    It is above 0, and falls with the number of searches: claims of one search are about one target, and so hold or fail
    together.

    Args:
        searches: Masses claimed in each search.
        draws: How often chance is drawn.
    """
    rng = np.random.default_rng(0)
    claimed = np.concatenate(searches)
    own = np.repeat(np.arange(len(searches)), [len(one) for one in searches])
    chance = rng.random((draws, len(searches)))
    return float(np.mean([calibration_error(claimed, (claimed > one[own]).astype(float)) for one in chance]))


def _classes(claimed: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Which of the equal classes of claimed mass each claim falls in."""
    return np.minimum((claimed * CLASSES).astype(int), CLASSES - 1)


def summarise(name: str, searches: list[np.ndarray], results: Results) -> None:
    """Add what one kind of belief comes to over all searches."""
    noted = np.concatenate(searches)
    means = np.array([[one[:, SCORE].mean()] if len(one) else [np.nan] for one in searches])
    value, low, high = bootstrap(means, None)
    results.add("density", name, "mean of searches", value, digits=2, spread=(low, high), cases=len(searches))
    for state in LinkState:
        own = noted[:, STATE] == state
        mean = noted[own, SCORE].mean() if own.any() else None
        results.add("density", name, words_of(state), mean, digits=1, cases=int(own.sum()))
    for i, radius in enumerate(RADII_M):
        error = calibration_error(noted[:, CLAIMED + i], noted[:, HELD + i])
        perfect = perfect_error([one[:, CLAIMED + i] for one in searches])
        results.add("calibration", name, f"within {radius:g} m", error, digits=3, cases=len(noted))
        results.add("calibration", name, f"perfect, {radius:g} m", perfect, digits=3)
    results.add("calibration", name, "a measurement", noted[:, MS].mean(), "ms", digits=1)


def draw(by_name: dict[str, list[np.ndarray]]) -> Any:
    """Reliability within 1 m, and the score over the part of the search that is done."""
    figure, (left, right) = figure_of(2)
    left.plot([0, 1], [0, 1], color="0.7", lw=1)
    parts = np.linspace(0, 1, 11)
    for name, searches in by_name.items():
        noted = np.concatenate(searches)
        claimed, held = noted[:, CLAIMED + 1], noted[:, HELD + 1]
        classes = _classes(claimed)
        shown = [i for i in range(CLASSES) if np.count_nonzero(classes == i) >= 10]
        points = [(claimed[classes == i].mean(), held[classes == i].mean()) for i in shown]
        line = left.plot(*np.array(points).reshape(-1, 2).T, marker="o", ms=4, label=name)[0]
        curves = [
            np.interp(parts, np.linspace(0, 1, len(one)), one[:, SCORE]) for one in searches if len(one) > 1
        ]
        if curves:
            right.plot(100 * parts, np.mean(curves, axis=0), color=line.get_color(), label=name)
    left.set(xlabel="mass claimed within 1 m of the peak", ylabel="share that holds the target")
    left.set(xlim=(0, 1), ylim=(0, 1))
    right.set(xlabel="part of the search that is done [%]", ylabel="log density at the target [1/m²]")
    right.legend(loc="best", fontsize=8)
    return figure
