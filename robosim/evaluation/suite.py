"""Which searches are made: a list of tasks, drawn from floor plans by a seed, or read from a file.

A task is a plan, a start and a target. Task i of a plan is drawn from the seed, the plan's name and i alone, so
that neither other plans nor the number of tasks change it. Places are kept as they are typed, in metres and degrees
and rounded, so that the command that replays an episode replays it bit for bit.

The file is YAML or JSON; plans lie relative to it, or are shipped ones by name:

    seed: 0
    plans: {flat: flat, house: maps/house.yaml}
    tasks:
    - {plan: house, start: [1.0, 2.0, 90.0], target: [7.5, -3.0]}
"""

import json
import os
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from robosim.reach import Reach
from robosim.support.assets import shipped_plans
from robosim.support.files import whole_file
from robosim.tasks import make_task

#: Endings of suite files.
SUFFIXES = (".yaml", ".yml", ".json")
#: Decimals that places are kept with: 0.1 mm and 0.01 degrees.
_PLACE_DECIMALS, _YAW_DECIMALS = 4, 2


@dataclass(frozen=True, kw_only=True)
class SuiteTask:
    """One search: where the robot starts and where the target stands."""

    plan: str
    """Name of the plan in the suite."""
    number: int
    """Which of the plan's tasks it is, from 0."""
    start: tuple[float, float, float]
    """x [m], y [m], yaw [degrees] in `map`."""
    target: tuple[float, float]
    """x [m], y [m]."""

    def seed(self, suite_seed: int, repeat: int) -> int:
        """Seed of the noise, the same for every policy, another for each task and repetition."""
        return _seed_of(suite_seed, self.plan, self.number, repeat)


@dataclass(frozen=True, kw_only=True)
class Suite:
    """Tasks, and the floor plans that they are in."""

    plans: Mapping[str, Path]
    """Files by name."""
    tasks: tuple[SuiteTask, ...]
    """Ordered by plan."""
    seed: int = 0
    """What the tasks and all noise are drawn from."""


def draw_tasks(plan: str, reach: Reach, count: int, seed: int) -> list[SuiteTask]:
    """Tasks in one plan, each with its start and target drawn anew.

    Args:
        plan: Name of the plan in the suite.
        reach: What the robot's hull can reach there.
        count: How many.
        seed: The suite's.

    Raises:
        MapError: If the hull fits nowhere.
    """
    tasks = []
    for number in range(count):
        task = make_task(reach, np.random.default_rng([seed, _seed_of(seed, plan, number)]))
        x, y = (round(float(value), _PLACE_DECIMALS) for value in task.start[:2])
        yaw = round(float(np.degrees(task.start[2])), _YAW_DECIMALS)
        target = tuple(round(float(value), _PLACE_DECIMALS) for value in task.target)
        tasks.append(SuiteTask(plan=plan, number=number, start=(x, y, yaw), target=(target[0], target[1])))
    return tasks


def name_plans(files: Sequence[Path]) -> dict[str, Path]:
    """Short names of plan files: what they are called without folders and endings.

    Raises:
        ValueError: If two would have one name.
    """
    names = [file.stem.removesuffix(".glb_topdownmap") for file in files]
    for name, count in Counter(names).items():
        if count > 1:
            twins = " and ".join(str(file) for file, own in zip(files, names, strict=True) if own == name)
            raise ValueError(
                f"{twins} are both called {name!r}. Give one of them, or name them in a suite file."
            )
    return dict(zip(names, files, strict=True))


def is_suite(path: str | Path) -> bool:
    """Whether a file is a suite rather than a floor plan: YAML or JSON with a list of tasks."""
    path = Path(path).expanduser()
    if path.suffix.lower() not in SUFFIXES or not path.is_file():
        return False
    if b"tasks" not in path.read_bytes():
        return False
    try:
        content = _parse(path)
    except ValueError:
        return False
    return isinstance(content, dict) and "tasks" in content


def read_suite(path: str | Path) -> Suite:
    """Read a suite from a YAML or JSON file.

    Raises:
        ValueError: If it is no suite; the message names file, entry and fix.
    """
    path = Path(path).expanduser()
    content = _parse(path)
    if not isinstance(content, dict) or not isinstance(content.get("tasks"), list):
        raise ValueError(f"{path}: no list of tasks. A suite has `seed`, `plans` and `tasks`.")
    listed, seed = content.get("plans"), content.get("seed", 0)
    if not isinstance(listed, dict) or not listed:
        raise ValueError(f"{path}: `plans` is {listed!r}, expected file by name, as in {{flat: flat}}.")
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise ValueError(f"{path}: `seed` is {seed!r}, expected a whole number of 0 or more.")
    plans = {str(name): _plan_file(path.parent, str(file)) for name, file in listed.items()}
    for name in plans:
        if not name or set(name) & set('/\\:*?"<>|') or name.startswith("."):
            raise ValueError(f"{path}: plan {name!r} names files too; use letters, digits, - and _.")
    counts: Counter[str] = Counter()
    tasks = []
    for index, entry in enumerate(content["tasks"]):
        task = _task(path, index, entry, plans, counts)
        tasks.append(task)
        counts[task.plan] += 1
    if not tasks:
        raise ValueError(f"{path}: the list of tasks is empty.")
    order = {name: place for place, name in enumerate(plans)}
    return Suite(plans=plans, tasks=tuple(sorted(tasks, key=lambda t: (order[t.plan], t.number))), seed=seed)


def write_suite(suite: Suite, path: Path) -> None:
    """Write a suite to a YAML file, or to JSON if it ends in .json; plans relative to it where they are files."""
    shipped = set(shipped_plans().values())
    plans = {
        name: file.stem if file in shipped else Path(os.path.relpath(file, path.parent)).as_posix()
        for name, file in suite.plans.items()
    }
    tasks = [
        {"plan": task.plan, "start": list(task.start), "target": list(task.target)} for task in suite.tasks
    ]
    with whole_file(path) as partial:
        if path.suffix.lower() == ".json":
            text = json.dumps({"seed": suite.seed, "plans": plans, "tasks": tasks}, indent=1) + "\n"
        else:
            text = yaml.safe_dump({"seed": suite.seed, "plans": plans}, sort_keys=False)
            text += yaml.safe_dump({"tasks": tasks}, sort_keys=False, default_flow_style=None, width=200)
        partial.write_text(text, encoding="utf-8")


def _seed_of(*parts: object) -> int:
    return zlib.crc32(" ".join(map(str, parts)).encode())


def _parse(path: Path) -> Any:
    try:
        text = path.read_text(encoding="utf-8")
        return json.loads(text) if path.suffix.lower() == ".json" else yaml.safe_load(text)
    except (yaml.YAMLError, json.JSONDecodeError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"{path}: cannot be read as YAML or JSON ({reason}).") from error


def _plan_file(folder: Path, file: str) -> Path:
    """The file of a plan; a name with neither folder nor ending is a shipped plan's."""
    if file in shipped_plans() and not (folder / file).is_file():
        return shipped_plans()[file]
    return Path(os.path.normpath(folder / Path(file).expanduser()))


def _task(
    path: Path, index: int, entry: Any, plans: Mapping[str, Path], counts: Mapping[str, int]
) -> SuiteTask:
    where = f"{path}: task {index + 1}"
    if not isinstance(entry, dict):
        raise ValueError(f"{where} is {entry!r}, expected plan, start and target.")
    plan = entry.get("plan")
    if not isinstance(plan, str) or plan not in plans:
        raise ValueError(f"{where}: plan is {plan!r}, expected one of {', '.join(plans)}.")
    start = _numbers(f"{where}: start", entry.get("start"), 3, "[x, y, yaw] in metres and degrees")
    target = _numbers(f"{where}: target", entry.get("target"), 2, "[x, y] in metres")
    return SuiteTask(
        plan=plan,
        number=counts[plan],
        start=(start[0], start[1], start[2]),
        target=(target[0], target[1]),
    )


def _numbers(what: str, value: Any, count: int, expected: str) -> list[float]:
    good = isinstance(value, list) and len(value) == count
    if not good or not all(isinstance(v, (int, float)) and np.isfinite(v) for v in value):
        raise ValueError(f"{what} is {value!r}, expected {expected}.")
    return [float(v) for v in value]
