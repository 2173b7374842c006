"""Scores of episodes: difficulty, arrival rates, relative arrival times, their intervals, and the order of tasks.

The oracle's steps define the difficulty of a task: of the tasks in their order the first 27 % are easy, the next 39 %
moderate, the rest hard, the shares of the published 52, 76 and 65 tasks (arXiv 2110.14789). The arrival time of a
policy is counted in steps, relative to the oracle's on the same task, and infinite without arrival. Where `shortest`
was run, which knows the building too, times are also given relative to its: the oracle is no bound. With repetitions a
task's oracle steps are their median.

Intervals are 95 %: Wilson's for rates, which counts tasks as independent, and percentiles of the bootstrap for the
others. A plan with all its tasks is one observation, as tasks of one building are alike; of fewer than five plans, a
task with all its repetitions.

Task by task, one policy is compared with the best other one: `fused` where that was run, else the first that is no bar.
The bars, `oracle` and `shortest`, know the target, and are compared only if no other policy was run.
"""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

BARS = ("oracle", "shortest")


@dataclass(frozen=True)
class Compared:
    """Task, with all episodes of a repetition of it."""

    plan: str
    task: int
    repeat: int
    subject: int | None
    """Number of the episode that is looked at; None if that policy was not run."""
    rival: int | None
    """Number of the best other one; None if there is none."""
    episodes: tuple[int, ...]
    """Numbers of all, in the order that policies come in."""
    loss: float
    """Steps of the first over those of the second: infinite if only the second arrived, 0 if only the first did, NaN if
    neither, or if there is no second."""


def subject_of(policies: Sequence[str]) -> str:
    """The policy that is looked at: `fused`, or the first that is no bar."""
    seekers = [policy for policy in policies if policy not in BARS]
    return "fused" if "fused" in seekers else (seekers or list(policies))[0]


def compared(rows: Sequence[Mapping[str, Any]]) -> list[Compared]:
    """All tasks: failures of the policy first, then those where it lost most."""
    subject = subject_of(list(dict.fromkeys(row["policy"] for row in rows)))
    groups: dict[tuple[str, int, int], list[int]] = defaultdict(list)
    for i, row in enumerate(rows):
        groups[row["plan"], row["task"], row["repeat"]].append(i)
    comparisons = []
    for (plan, task, repeat), episodes in groups.items():
        subject_row = next((i for i in episodes if rows[i]["policy"] == subject), None)
        others = [i for i in episodes if i != subject_row]
        seekers = [i for i in others if rows[i]["policy"] not in BARS]
        rival = min(seekers or others, key=lambda i: steps_to_arrival(rows[i]), default=None)
        loss = math.nan if subject_row is None or rival is None else _loss(rows[subject_row], rows[rival])
        comparisons.append(Compared(plan, task, repeat, subject_row, rival, tuple(episodes), loss))
    return sorted(comparisons, key=lambda comparison: _order(comparison, rows))


def _order(comparison: Compared, rows: Sequence[Mapping[str, Any]]) -> tuple[Any, ...]:
    """Return the sort key: failures that another avoids, failures, then by loss; tasks not run come last."""
    failed = comparison.subject is not None and not rows[comparison.subject]["arrived"]
    place = (not math.isinf(comparison.loss), not failed, comparison.subject is None)
    return (
        *place,
        math.inf if math.isnan(comparison.loss) else -comparison.loss,
        comparison.plan,
        comparison.task,
        comparison.repeat,
    )


def steps_to_arrival(row: Mapping[str, Any]) -> float:
    """Steps of an episode until the robot arrived; infinite if it did not."""
    return math.inf if row["arrived_at_step"] is None else float(row["arrived_at_step"])


def _loss(row: Mapping[str, Any], rival: Mapping[str, Any]) -> float:
    steps, others = steps_to_arrival(row), steps_to_arrival(rival)
    return math.nan if math.isinf(steps) and math.isinf(others) else steps / max(others, 1.0)


CLASSES = ("easy", "moderate", "hard")
#: Tasks of each class in the published evaluation.
_PUBLISHED = (52, 76, 65)
#: Two-sided 95 % of the normal distribution.
_Z95 = 1.959964
_RESAMPLES = 2000
#: Fewest plans that intervals are drawn over.
_LEAST_PLANS = 5

TaskKey = tuple[str, int]


class Estimate(NamedTuple):
    """A number and its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Summary:
    """Scores of a policy on the tasks of a class, or on all."""

    policy: str
    difficulty: str
    """easy, moderate, hard or all."""
    tasks: int
    episodes: int
    arrival_rate: Estimate
    time_median: Estimate
    """Relative arrival time that half of the episodes keep within; infinite if less than half arrive."""
    time_p80: Estimate
    """Relative arrival time that 80 % of the episodes keep within."""
    limit_median: Estimate
    """Median arrival time relative to that of `shortest`, the physical limit; NaN where that was not run."""
    spl: Estimate
    """Mean success weighted by path length."""


def score(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows with `difficulty`, `oracle_steps`, `relative_time` and `limit_time` added; needs the oracle's episodes.

    `relative_time` is infinite without arrival, and NaN where the oracle did not arrive either: such tasks count as
    hard, and have no relative times. `limit_time` is the same relative to `shortest`, NaN where that was not run.
    """
    oracle, limit = (steps_of(rows, policy) for policy in ("oracle", "shortest"))
    missing = {_key(row) for row in rows} - set(oracle)
    if missing:
        raise ValueError(f"no episode of the oracle for {sorted(missing)[0]}; difficulty goes by it.")
    classes = difficulty(oracle)
    scored = []
    for row in rows:
        key = _key(row)
        at = steps_to_arrival(row)
        added = {
            "difficulty": classes[key],
            "oracle_steps": oracle[key],
            "relative_time": _relative(at, oracle[key]),
            "limit_time": _relative(at, limit.get(key, np.inf)),
        }
        scored.append({**row, **added})
    return scored


def _relative(at: float, steps: float) -> float:
    return at / max(steps, 1.0) if np.isfinite(steps) else np.nan


def steps_of(rows: Sequence[Mapping[str, Any]], policy: str) -> dict[TaskKey, float]:
    """Steps that a policy needs for each task: the median of the repetitions, infinite if it does not arrive."""
    steps: dict[TaskKey, list[float]] = defaultdict(list)
    for row in rows:
        if row["policy"] == policy:
            steps[_key(row)].append(steps_to_arrival(row))
    return {key: float(np.quantile(counts, 0.5, method="inverted_cdf")) for key, counts in steps.items()}


def difficulty(steps: Mapping[TaskKey, float]) -> dict[TaskKey, str]:
    """Class of each task by the oracle's steps, in the published shares; ties go by name; hard without arrival."""
    order = sorted(steps, key=lambda key: (steps[key], key))
    share = np.cumsum(_PUBLISHED) / sum(_PUBLISHED)
    first_moderate, first_hard = (round(float(fraction) * len(order)) for fraction in share[:2])
    return {
        key: "hard" if math.isinf(steps[key]) else CLASSES[(place >= first_moderate) + (place >= first_hard)]
        for place, key in enumerate(order)
    }


def summarise(scored: Sequence[Mapping[str, Any]]) -> list[Summary]:
    """Every policy on every class that has tasks, and on all, in the order that the policies come in."""
    summaries = []
    for policy in dict.fromkeys(row["policy"] for row in scored):
        for name in (*CLASSES, "all"):
            selected = [r for r in scored if r["policy"] == policy and name in (r["difficulty"], "all")]
            if selected:
                summaries.append(_summary(policy, name, selected))
    return summaries


def _summary(policy: str, name: str, rows: list[Mapping[str, Any]]) -> Summary:
    tasks: dict[TaskKey, list[Mapping[str, Any]]] = defaultdict(list)
    for row in rows:
        tasks[_key(row)].append(row)
    arrived, times, limit, spl = (
        _table([[float(row[column]) for row in repeats] for repeats in tasks.values()])
        for column in ("arrived", "relative_time", "limit_time", "spl")
    )
    plans = [plan for plan, _ in tasks]
    return Summary(
        policy,
        name,
        len(tasks),
        len(rows),
        arrival_rate=wilson(float(np.nanmean(arrived, axis=1).sum()), len(tasks)),
        time_median=bootstrap(by_plan(times, plans), 0.5),
        time_p80=bootstrap(by_plan(times, plans), 0.8),
        limit_median=bootstrap(by_plan(limit, plans), 0.5),
        spl=bootstrap(by_plan(spl, plans), None),
    )


def wilson(successes: float, n: int) -> Estimate:
    """A rate with Wilson's score interval (1927); successes may be a sum of shares."""
    if n == 0:
        return Estimate(np.nan, 0.0, 1.0)
    rate, z2 = successes / n, _Z95**2
    centre = (rate + z2 / (2 * n)) / (1 + z2 / n)
    half = _Z95 / (1 + z2 / n) * np.sqrt(rate * (1 - rate) / n + z2 / (4 * n**2))
    return Estimate(rate, max(0.0, centre - half), min(1.0, centre + half))


def by_plan(
    values: Float[np.ndarray, "n_tasks n_repeats"], plans: Sequence[str]
) -> Float[np.ndarray, "n_observations n_values"]:
    """Values of tasks with those of a plan in one row, for `bootstrap`; the same of fewer than five plans."""
    rows: dict[str, list[float]] = defaultdict(list)
    for plan, repeats in zip(plans, values.tolist(), strict=True):
        rows[plan] += repeats
    return _table(list(rows.values())) if len(rows) >= _LEAST_PLANS else values


def bootstrap(values: Float[np.ndarray, "n_tasks n_repeats"], quantile: float | None) -> Estimate:
    """A quantile, or the mean if None, with percentiles of its values for rows drawn again with replacement.

    NaN are no values, and infinite is larger than all others. The quantile is the least value that so many do not
    exceed. One row alone has no interval.
    """
    values = values[~np.isnan(values).all(axis=1)]
    if len(values) < 2:
        return Estimate(float(_statistic(values, quantile)[0]) if len(values) else np.nan, np.nan, np.nan)
    drawn = np.random.default_rng(0).integers(len(values), size=(_RESAMPLES, len(values)))
    resampled = values[drawn].reshape(_RESAMPLES, -1)
    ends = _statistic(resampled, quantile)
    low, high = np.quantile(ends, [0.025, 0.975], method="inverted_cdf")
    return Estimate(float(_statistic(values.reshape(1, -1), quantile)[0]), float(low), float(high))


def _statistic(rows: Float[np.ndarray, "m n"], quantile: float | None) -> Float[np.ndarray, " m"]:
    if quantile is None:
        return np.nanmean(rows, axis=1)
    rows = np.sort(rows, axis=1)  # NaN last
    count = (~np.isnan(rows)).sum(axis=1)
    place = np.maximum(np.ceil(quantile * count - 1e-9).astype(int) - 1, 0)
    return rows[np.arange(len(rows)), place]


def _table(lists: list[list[float]]) -> Float[np.ndarray, "n_tasks n_repeats"]:
    """Lists as rows of a table, the short ones filled up with NaN."""
    table = np.full((len(lists), max(map(len, lists))), np.nan)
    for row, values in zip(table, lists, strict=True):
        row[: len(values)] = values
    return table


def _key(row: Mapping[str, Any]) -> TaskKey:
    return row["plan"], row["task"]
