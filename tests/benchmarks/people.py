"""Searches among people: arrivals, steps, contacts and poses over those of the same tasks without people.

Read from folders of `robosim evaluate` with the same plans, tasks and seed and different numbers of people, the first
one without. Intervals are of 95 %, by bootstrap over homes.
"""

from pathlib import Path
from typing import Any

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from robosim.evaluation.episodes import read_job_head
from robosim.support.reading import FileError, shown
from robosim.support.run_folder import SETTINGS
from robosim.support.text_in import read_json
from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.results import Results

Key = tuple[str, int, int]


def main(*evaluations: Positional[Path], options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Searches among people, over the same searches without.

    Args:
        evaluations: Folders of `robosim evaluate` with the same tasks, the first one without people.
        options: Of every benchmark.
    """
    results = Results()
    rows = {label_of(folder): rows_of(folder) for folder in evaluations}
    alone = rows.get("0 people")
    if alone is None:
        raise FileError(
            f"none of {', '.join(map(shown, evaluations))} is without people. Run one with --people 0."
        )
    for label, found in rows.items():
        for policy, own in found.items():
            add(results, label, policy, own, alone.get(policy, {}))
    return options.finish("people", results)


def label_of(evaluation: Path) -> str:
    """What an evaluation is with: `5 people`, or `5 people, not tracked`."""
    movers = read_json(evaluation / SETTINGS, "settings of an evaluation")["settings"]["episode"][
        "simulator"
    ]["movers"]
    return f"{movers['people']} people{'' if movers.get('tracking', True) else ', not tracked'}"


def rows_of(evaluation: Path) -> dict[str, dict[Key, dict[str, Any]]]:
    """Results by policy and task."""
    found: dict[str, dict[Key, dict[str, Any]]] = {}
    for file in sorted((evaluation / "episodes").glob("*/*.npz")):
        row = read_job_head(file).row
        found.setdefault(row["policy"], {})[row["plan"], row["task"], row["repeat"]] = row
    return found


def add(
    results: Results,
    label: str,
    policy: str,
    own: dict[Key, dict[str, Any]],
    alone: dict[Key, dict[str, Any]],
) -> None:
    """The results of one policy with a number of people."""
    n, path_km = len(own), sum(row["path_length_m"] for row in own.values()) / 1000
    arrived = 100 * float(np.mean([row["arrived"] for row in own.values()]))
    results.add("arrived", label, policy, arrived, "%", digits=0, cases=n)
    results.add("SPL", label, policy, float(np.mean([row["spl"] for row in own.values()])), digits=2, cases=n)
    both = {
        key: row["steps"] / alone[key]["steps"]
        for key, row in own.items()
        if key in alone
        and row["arrived"]
        and alone[key]["arrived"]
        and min(row["steps"], alone[key]["steps"]) > 0
    }
    if both:
        ratios = np.array(list(both.values()))
        results.add_ratio("steps", label, policy, ratios, [plan for plan, _, _ in both])
        median = float(np.exp(np.median(np.log(ratios))))
        results.add("steps, median", label, policy, median, digits=2, cases=len(both))
    for name in ("contacts_by_robot", "contacts_by_others"):
        count = sum(row.get(name, 0) for row in own.values())
        title = name.replace("_", " ") + " per km"
        results.add(title, label, policy, count / path_km, digits=1, cases=n)
    errors = 100 * np.array([row["position_error_rms_m"] for row in own.values()])
    results.add("position error", label, policy, float(np.median(errors)), "cm", digits=1, cases=n)
    states = [
        row["link_state_accuracy"] for row in own.values() if row.get("link_state_accuracy") is not None
    ]
    if states:
        results.add("link states right", label, policy, 100 * float(np.mean(states)), "%", digits=1, cases=n)
