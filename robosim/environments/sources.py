"""Sources of plans for an environment: files, folders, a suite of tasks, or generated homes.

An environment is given one of

- a floor plan, its file, the name of a shipped one, a folder of plans, or several of these;
- a suite file: then the tasks are the suite's;
- "homes" or "homes:500": that many generated homes (`robosim.generator`); or `GeneratedHomes(...)`.

Plans are read on first use, and cached.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Annotated, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from robosim.evaluation.suite import Suite, is_suite, read_suite
from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.plans.files import find_plans, read_plan
from robosim.plans.floorplan import FloorPlan
from robosim.support.checks import SEED, Range, checked

#: Cached plans.
_CACHED = 256


class TaskSpec(NamedTuple):
    """A plan, and what a source specifies of the task in it; the rest is drawn."""

    plan: FloorPlan
    start: Float[np.ndarray, "3"] | None = None
    """x [m], y [m], yaw [rad] in `map`."""
    target: Float[np.ndarray, "2"] | None = None


@runtime_checkable
class Source(Protocol):
    """Plans, or tasks in plans, by number."""

    def __len__(self) -> int:
        """Number of plans or tasks."""

    def task_spec(self, number: int) -> TaskSpec:
        """Plan and task of a number."""


@dataclass(frozen=True, kw_only=True)
@checked
class GeneratedHomes:
    """Generated homes."""

    count: Annotated[int, Range(1, 10_000_000, "homes")] = 100
    """Different homes."""
    seed: Annotated[int, SEED] = 0
    """Seed of the first home; the others follow it."""
    config: GeneratorConfig = field(default_factory=GeneratorConfig)
    """Kind of building."""

    def __len__(self) -> int:
        return self.count

    def task_spec(self, number: int) -> TaskSpec:
        """A home without a task."""
        return TaskSpec(_home(self.seed + number, self.config))


class _Plans:
    """Floor plans and their files."""

    def __init__(self, plans: Sequence[FloorPlan | Path]) -> None:
        self._plans = plans

    def __len__(self) -> int:
        return len(self._plans)

    def task_spec(self, number: int) -> TaskSpec:
        plan = self._plans[number]
        return TaskSpec(plan if isinstance(plan, FloorPlan) else _plan_of(plan))


class _Tasks:
    """Tasks of a suite."""

    def __init__(self, suite: Suite) -> None:
        suite.check_places()
        self._suite = suite

    def __len__(self) -> int:
        return len(self._suite.tasks)

    def task_spec(self, number: int) -> TaskSpec:
        task = self._suite.tasks[number]
        x, y, yaw_deg = task.start
        plan = _plan_of(self._suite.plans[task.plan], self._suite.reader)
        return TaskSpec(plan, np.array([x, y, np.radians(yaw_deg)]), np.array(task.target))


def source_of(plan: object) -> Source:
    """The source for the argument `plan` of an environment; ValueError or MapError if there is none."""
    if isinstance(plan, GeneratedHomes):
        return plan
    if isinstance(plan, str) and plan.partition(":")[0] == "homes":
        count = plan.partition(":")[2]
        if count and not count.isdecimal():
            raise ValueError(f"plan is {plan!r}, expected homes, or a number of them such as homes:500.")
        return GeneratedHomes(count=int(count)) if count else GeneratedHomes()
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


@lru_cache(_CACHED)
def _home(seed: int, config: GeneratorConfig) -> FloorPlan:
    return generate_plan(seed, config=config)


@lru_cache(_CACHED)
def _plan_of(file: Path, reader: str = "auto") -> FloorPlan:
    return read_plan(file, reader=reader)
