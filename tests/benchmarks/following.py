"""Whether an arrival leads on: how much nearer to the target a robot is some decisions after it began to follow one.

Told by the link state that the robot believed in, beside the same where `los-or-first` explores although a path of
higher order would be strong enough to follow: whether that state deserves to be trusted. Nearer is by the way that the
hull has left to drive in the true building. From kept episodes alone: a robot follows where it has just set its goal
as far ahead as the published system does. Left out: that a goal of the explorer may by chance lie as far ahead.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from robosim.building.building import BuildingConfig
from robosim.evaluation.episode_file import Episode, read_episode
from robosim.evaluation.episodes import scene
from robosim.evaluation.suite import Suite
from robosim.policies.arrival import FollowConfig
from wireless.paths import LinkState

#: Decisions after which the robot is looked at again.
LATER = 10
#: Policies that follow by one rule.
FOLLOWERS = ("snr", "los", "los-or-first")
#: Exploring where the link state is higher order.
EXPLORED = "higher_order, explored"
#: How far a goal may be off the distance ahead [m]; places are kept in single precision.
_SLACK_M = 0.01


class Progress(NamedTuple):
    """What came of following, or of exploring instead."""

    times: int
    nearer_share: float
    """Part in which the way left was shorter later."""
    nearer_m: float
    """By how much, on average [m]."""


def progress(
    results: Path,
    rows: Sequence[Mapping[str, Any]],
    suite: Suite,
    building: BuildingConfig,
    hull_m: tuple[float, float],
) -> dict[str, Progress]:
    """Progress by link state, and of exploring in higher order under `EXPLORED`.

    Args:
        results: Folder of the evaluation.
        rows: Its episodes.
        suite: What was searched.
        building: How plans became buildings.
        hull_m: Radius and height of the robot [m].
    """
    gained: dict[str, list[float]] = defaultdict(list)
    for row in sorted((r for r in rows if r["policy"] in FOLLOWERS), key=lambda r: (r["plan"], r["task"])):
        name = f"{row['plan']}/{row['task']:03d}-{row['policy']}-{row['repeat']}.npz"
        episode = read_episode(results / "episodes" / name)
        _, places = scene(suite.plans[row["plan"]], suite.reader, building, hull_m)
        travel = places.travel_m(np.array(row["target"]))
        left = np.array([places.remaining_m(travel, pose[:2]) for pose in episode.poses])
        for told, metres in _gains(episode, left, explores=row["policy"] == "los-or-first"):
            gained[told].append(metres)
    order = [state.name.lower() for state in LinkState if state != LinkState.OUTAGE] + [EXPLORED]
    return {
        name: Progress(len(own), float(np.mean(np.array(own) > 0)), float(np.mean(own)))
        for name in order
        if (own := gained.get(name))
    }


def _gains(episode: Episode, left: Float[np.ndarray, " n"], *, explores: bool) -> list[tuple[str, float]]:
    """How much shorter the way left is later, with what the robot followed at the time."""
    follow, found = FollowConfig(), []
    for i, (_, believed, snr_db, _) in enumerate(episode.links):
        state = LinkState(int(believed))
        if snr_db < follow.min_snr_db or i >= len(episode.goals):
            continue
        kept = i > 0 and np.array_equal(episode.goals[i], episode.goals[i - 1])
        ahead_m = float(np.hypot(*(episode.goals[i] - episode.estimates[i, :2])))
        follows = abs(ahead_m - follow.ahead_m) < _SLACK_M
        metres = float(left[i] - left[min(i + LATER, len(left) - 1)])
        if follows and not kept:
            found.append((state.name.lower(), metres))
        elif explores and not follows and state == LinkState.HIGHER_ORDER:
            found.append((EXPLORED, metres))
    return found


def told(found: Mapping[str, Progress]) -> list[str]:
    """One sentence for each link state."""
    return [
        f"{name.replace('_', ' ')}: after {LATER} decisions nearer in {100 * p.nearer_share:.0f} % of {p.times}, "
        f"{p.nearer_m:.2f} m on average."
        for name, p in found.items()
    ]
