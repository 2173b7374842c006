"""PPO on what the environment observes, next to goal policies that map and plan; docs/tasks/learn_with_sb3.py."""

import runpy
from pathlib import Path

from tyro.conf import OmitArgPrefixes

from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.results import Results

EXAMPLE = Path(__file__).parents[2] / "docs" / "tasks" / "learn_with_sb3.py"


def main(
    *,
    steps: int = 300_000,
    robots: int = 8,
    searches: int = 20,
    homes: int = 10,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Learning: PPO of Stable-Baselines3 next to goal policies, searches in homes that were not trained in.

    Args:
        steps: Of training, which takes half an hour.
        robots: Trained at once.
        searches: Of each agent.
        homes: Trained in.
        options: Of every benchmark; the seed has no effect.
    """
    scores = runpy.run_path(str(EXAMPLE))["main"](steps, robots, searches, homes)
    return options.finish("learning", tabulated(scores, searches))


def tabulated(scores: dict[str, tuple[float, float]], searches: int) -> Results:
    """The table of the scores (share of arrivals, SPL) of agents."""
    results = Results()
    for agent, (share, spl) in scores.items():
        row = {"learned": "PPO", "at random": "random actions"}.get(agent, f"policy {agent}")
        results.add("searches", row, "arrived", 100 * share, "%", digits=0, cases=searches)
        results.add("searches", row, "SPL", spl, digits=2, cases=searches)
    return results
