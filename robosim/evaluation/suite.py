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
import re
import reprlib
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from robosim.building.reach import Reach
from robosim.evaluation.rows import is_number
from robosim.parts import READER
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FARTHEST_M
from robosim.support.assets import shipped_plans
from robosim.support.files import whole_file
from robosim.support.reading import FileError, expanded, read_bytes, reading, shown
from robosim.support.text_in import MOST_JSON, MOST_YAML, check_object, parse_json, parse_yaml
from robosim.task.tasks import make_task

#: Endings of suite files.
SUFFIXES = (".yaml", ".yml", ".json")
#: Decimals that places are kept with: 0.1 mm and 0.01 degrees.
_PLACE_DECIMALS, _YAW_DECIMALS = 4, 2
_WHAT = "a suite of searches"
_REMEDY = "It has `seed`, `plans` and `tasks`, in YAML or JSON; `robosim evaluate --suite-out` writes one."
_SHORT = reprlib.Repr()
_SHORT.maxstring, _SHORT.maxlevel = 80, 3
#: The key of a list of tasks in YAML or JSON.
_TASKS = re.compile(rb"""^\{?[ \t]*["']?tasks["']?[ \t]*:|[,{]\s*["']tasks["']\s*:""", re.MULTILINE)


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
    reader: str = "auto"
    """Who reads the plans, of `robosim.parts.READER`, by name or `module:Name`."""
    file: Path | None = field(default=None, compare=False)
    """What it was read from."""

    def check_places(self) -> None:
        """Refuse tasks that begin or end outside of their plan, before any of them is run.

        Raises:
            ValueError: If one does; the message names the suite's file and the task.
            MapError: If a plan cannot be read.
        """
        plans = {name: read_plan(file, reader=self.reader) for name, file in self.plans.items()}
        for task in self.tasks:
            plan = plans[task.plan]
            for what, place in (("start", task.start[:2]), ("target", task.target)):
                cell = plan.to_cells(np.array(place))
                if not ((cell >= 0) & (cell <= plan.shape[::-1])).all():
                    source = "" if self.file is None else f"{shown(self.file)}: "
                    raise FileError(
                        f"{source}task {task.number} of {task.plan}: {what} is ({place[0]:g}, {place[1]:g}) m, "
                        "outside of the plan. Choose a place on its floor."
                    )


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
    path = expanded(path)
    if path.suffix.lower() not in SUFFIXES:
        return False
    try:
        return _TASKS.search(read_bytes(path, _WHAT, most_bytes=MOST_JSON)) is not None
    except FileError:
        return False


def read_suite(path: str | Path) -> Suite:
    """Read a suite from a YAML or JSON file.

    Raises:
        FileError: If it is no suite; the message names file, entry and fix.
    """
    path = expanded(path)
    is_json = path.suffix.lower() == ".json"
    with reading(path, _WHAT, _REMEDY, most_bytes=MOST_JSON if is_json else MOST_YAML) as file:
        content = check_object((parse_json if is_json else parse_yaml)(file.read()))
        return _suite(content, path)


def _suite(content: Mapping[str, Any], path: Path) -> Suite:
    if not isinstance(content.get("tasks"), list):
        raise FileError("no list of tasks. A suite has `seed`, `plans` and `tasks`.")
    listed, seed = content.get("plans"), content.get("seed", 0)
    if not isinstance(listed, dict) or not listed:
        raise FileError(f"`plans` is {_short(listed)}, expected file by name, as in {{flat: flat}}.")
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise FileError(f"`seed` is {_short(seed)}, expected a whole number of 0 or more.")
    reader = str(content.get("reader", "auto"))
    if reader != "auto":
        READER.check("`reader`", reader)
    for name in map(str, listed):
        if not is_plan_name(name):
            raise FileError(f"plan {_short(name)} names files too; use letters, digits, - and _.")
    plans = {str(name): _plan_file(path.parent, str(file)) for name, file in listed.items()}
    for name, file in plans.items():
        if not file.is_file():
            raise FileError(f"plan {_short(name)} is {shown(file)}, where there is no file.")
    counts: Counter[str] = Counter()
    tasks = []
    for index, entry in enumerate(content["tasks"]):
        task = _task(index, entry, plans, counts)
        tasks.append(task)
        counts[task.plan] += 1
    if not tasks:
        raise FileError("the list of tasks is empty.")
    order = {name: place for place, name in enumerate(plans)}
    ordered = tuple(sorted(tasks, key=lambda t: (order[t.plan], t.number)))
    return Suite(plans=plans, tasks=ordered, seed=seed, reader=reader, file=path)


def is_plan_name(name: str) -> bool:
    """Whether a plan may be called so: folders and files are named after it."""
    strange = set(name) & set('/\\:*?"<>|')
    return 0 < len(name) <= 200 and name.isprintable() and not strange and not name.startswith(".")


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
    head = {"seed": suite.seed, "plans": plans}
    if suite.reader != "auto":
        head["reader"] = suite.reader
    with whole_file(path) as partial:
        if path.suffix.lower() == ".json":
            text = json.dumps({**head, "tasks": tasks}, indent=1) + "\n"
        else:
            text = yaml.safe_dump(head, sort_keys=False)
            text += yaml.safe_dump({"tasks": tasks}, sort_keys=False, default_flow_style=None, width=200)
        partial.write_text(text, encoding="utf-8")


def _seed_of(*parts: object) -> int:
    return zlib.crc32(" ".join(map(str, parts)).encode())


def _plan_file(folder: Path, file: str) -> Path:
    """The file of a plan; a name with neither folder nor ending is a shipped plan's."""
    if file in shipped_plans() and not (folder / file).is_file():
        return shipped_plans()[file]
    return Path(os.path.normpath(folder / expanded(file)))


def _task(index: int, entry: Any, plans: Mapping[str, Path], counts: Mapping[str, int]) -> SuiteTask:
    where = f"task {index + 1}"
    if not isinstance(entry, dict):
        raise FileError(f"{where} is {_short(entry)}, expected plan, start and target.")
    plan = entry.get("plan")
    if not isinstance(plan, str) or plan not in plans:
        raise FileError(f"{where}: plan is {_short(plan)}, expected one of {', '.join(plans)}.")
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
    if not good or not all(is_number(v) and abs(v) <= FARTHEST_M for v in value):
        raise FileError(f"{what} is {_short(value)}, expected {expected}.")
    return [float(v) for v in value]


def _short(value: Any) -> str:
    """A value for a message, of which a damaged file may hold a great deal."""
    return _SHORT.repr(value)
