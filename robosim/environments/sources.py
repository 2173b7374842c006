"""Where the plans of an environment come from: files, folders, a suite of tasks, or invented homes.

An environment is given one of

- a floor plan, its file, the name of a shipped one, a folder of plans, or several of these;
- a suite file: then the tasks are the suite's;
- "homes" or "homes:500": invented homes (`robosim.generator`), so many different ones; or `MadeHomes(...)`.

Plans are read when they are first asked for, and kept while they are in use.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from robosim.evaluation.suite import Suite, is_suite, read_suite
from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.plans.files import find_plans, read_plan
from robosim.plans.floorplan import FloorPlan
from robosim.support.checks import SEED, check_numbers

#: Plans that are kept.
_KEPT = 256


class Given(NamedTuple):
    """What a source says of a task; the rest is drawn."""

    plan: FloorPlan
    start: Float[np.ndarray, "3"] | None = None
    """x [m], y [m], yaw [rad] in `map`."""
    target: Float[np.ndarray, "2"] | None = None


@runtime_checkable
class Source(Protocol):
    """Gives plans, or tasks in plans, by number."""

    def __len__(self) -> int:
        """How many there are."""

    def given(self, number: int) -> Given:
        """One of them."""


@dataclass(frozen=True, kw_only=True)
class MadeHomes:
    """Invented homes."""

    count: int = 100
    """Different homes."""
    seed: int = 0
    """Number of the first; the others follow it."""
    config: GeneratorConfig = field(default_factory=GeneratorConfig)
    """What kind of building is invented."""

    def __post_init__(self) -> None:
        check_numbers(self, count=(1, 10_000_000, "homes"), seed=SEED)

    def __len__(self) -> int:
        return self.count

    def given(self, number: int) -> Given:
        """A home."""
        return Given(_home(self.seed + number, self.config))


class _Plans:
    """Floor plans and their files."""

    def __init__(self, plans: Sequence[FloorPlan | Path]) -> None:
        self._plans = plans

    def __len__(self) -> int:
        return len(self._plans)

    def given(self, number: int) -> Given:
        plan = self._plans[number]
        return Given(plan if isinstance(plan, FloorPlan) else _plan_of(plan))


class _Tasks:
    """Tasks of a suite."""

    def __init__(self, suite: Suite) -> None:
        suite.check_places()
        self._suite = suite

    def __len__(self) -> int:
        return len(self._suite.tasks)

    def given(self, number: int) -> Given:
        task = self._suite.tasks[number]
        x, y, yaw_deg = task.start
        plan = _plan_of(self._suite.plans[task.plan], self._suite.reader)
        return Given(plan, np.array([x, y, np.radians(yaw_deg)]), np.array(task.target))


def source_of(plan: object) -> Source:
    """What an environment's argument `plan` means.

    Raises:
        ValueError: If it means nothing.
        MapError: If a file or folder has no plan.
    """
    if isinstance(plan, MadeHomes):
        return plan
    if isinstance(plan, str) and plan.partition(":")[0] == "homes":
        count = plan.partition(":")[2]
        if count and not count.isdecimal():
            raise ValueError(f"plan is {plan!r}, expected homes, or a number of them such as homes:500.")
        return MadeHomes(count=int(count)) if count else MadeHomes()
    if isinstance(plan, str | Path) and is_suite(plan):
        return _Tasks(read_suite(plan))
    several = [plan] if isinstance(plan, str | Path | FloorPlan) else plan
    if not isinstance(several, Sequence) or not several:
        raise ValueError(
            f"plan is {plan!r}, expected a floor plan, a file, a folder, a suite, or several plans."
        )
    found: list[FloorPlan | Path] = []
    for one in several:
        found += [one] if isinstance(one, FloorPlan) else find_plans([one])
    return _Plans(found)


@lru_cache(_KEPT)
def _home(seed: int, config: GeneratorConfig) -> FloorPlan:
    return generate_plan(seed, config=config)


@lru_cache(_KEPT)
def _plan_of(file: Path, reader: str = "auto") -> FloorPlan:
    return read_plan(file, reader=reader)
