"""Speed of the working tree compared with that of another commit, in five short tasks that take turns.

Each commit runs in a process of its own for each turn, the two one after the other in an order that alternates, so that
other work of the machine disturbs both. A ratio is the median over turns of seconds here over seconds there; its 95 %
interval is by bootstrap over turns.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from tyro.conf import OmitArgPrefixes

from robosim.evaluation.search_scores import bootstrap
from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.results import ROOT, Results

WORKER = Path(__file__).with_name("compare_worker.py")


def main(ref: str, *, turns: int = 9, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Ratios of processor time of this working tree to that of a commit; above 1 is slower here.

    Args:
        ref: The other commit, branch or tag.
        turns: Measured turns; one more compiles loops.
        options: Of every benchmark.
    """
    results = Results()
    with tempfile.TemporaryDirectory() as folder:
        other = checkout(ref, Path(folder) / "other")
        both = [ROOT, other]
        measured = [
            {tree: run(tree) for tree in both[:: 1 if turn % 2 else -1]} for turn in range(turns + 1)
        ][1:]
    for task in measured[0][ROOT]:
        here, there = (np.array([turn[tree][task] for turn in measured]) for tree in both)
        ratio, low, high = bootstrap((here / there)[:, None], 0.5)
        results.add("ratio", task, f"seconds here / {ref}", ratio, digits=3, spread=(low, high), cases=turns)
        results.add("ratio", task, "here", float(np.median(here)), "s")
    return options.finish("compare", results)


def checkout(ref: str, folder: Path) -> Path:
    """Files of a commit in a folder; ValueError if there is no such commit."""
    folder.mkdir()
    archive = subprocess.run(
        ["git", "archive", "--format=tar", ref], cwd=ROOT, capture_output=True, check=False
    )
    if archive.returncode:
        raise ValueError(f"ref is {ref!r}, expected a commit of this repository, such as HEAD~1")
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive.stdout, check=True)
    return folder


def run(tree: Path) -> dict[str, float]:
    """Seconds of each task with the packages of a source tree."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, str(WORKER)], cwd=tree, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise ValueError(f"the tasks do not run with {tree.name}: {done.stderr[-300:]}")
    seconds: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return seconds
