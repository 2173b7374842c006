"""Task by task: one policy and the best of the others, the tasks that it did worst first.

The policy is `fused` where that was run, else the first that is no bar; the bars, `oracle` and `shortest`, know the
target, and are compared with only if no other policy was run.
"""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

BARS = ("oracle", "shortest")


@dataclass(frozen=True)
class Compared:
    """One task, with all episodes of one repetition of it."""

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
    found = []
    for (plan, task, repeat), episodes in groups.items():
        own = next((i for i in episodes if rows[i]["policy"] == subject), None)
        others = [i for i in episodes if i != own]
        seekers = [i for i in others if rows[i]["policy"] not in BARS]
        rival = min(seekers or others, key=lambda i: _steps(rows[i]), default=None)
        loss = math.nan if own is None or rival is None else _loss(rows[own], rows[rival])
        found.append(Compared(plan, task, repeat, own, rival, tuple(episodes), loss))
    return sorted(found, key=lambda one: _order(one, rows))


def _order(one: Compared, rows: Sequence[Mapping[str, Any]]) -> tuple[Any, ...]:
    """Failures that another avoids, failures, then by loss; what was not run comes last."""
    failed = one.subject is not None and not rows[one.subject]["arrived"]
    place = (not math.isinf(one.loss), not failed, one.subject is None)
    return *place, math.inf if math.isnan(one.loss) else -one.loss, one.plan, one.task, one.repeat


def _steps(row: Mapping[str, Any]) -> float:
    return math.inf if row["arrived_at_step"] is None else float(row["arrived_at_step"])


def _loss(own: Mapping[str, Any], rival: Mapping[str, Any]) -> float:
    steps, others = _steps(own), _steps(rival)
    return math.nan if math.isinf(steps) and math.isinf(others) else steps / max(others, 1.0)
