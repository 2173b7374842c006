"""Suites of searches: a list of tasks, drawn from floor plans by a seed, or read from a file.

A task is a plan, a start and a target. Task i of a plan is drawn from the seed, the plan's name and i alone, so
that neither other plans nor the number of tasks change it. Places are stored as they are typed, in metres and degrees
and rounded, so that the command that replays an episode replays it bit for bit.

The file is YAML or JSON; plans lie relative to it, or are shipped ones by name:

    seed: 0
    plans: {flat: flat, house: maps/house.yaml}
    tasks:
    - {plan: house, start: [1.0, 2.0, 90.0], target: [7.5, -3.0]}

`reader` may name the reader of the plans: a name of `robosim.parts.READER`, or `module:Name`, which runs code and is
rejected outside of `robosim.support.parts.code_allowed` (the option `--allow-code`).
"""

import json
import logging
import os
import re
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml

from robosim.building.reach import Reach
from robosim.parts import READER
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FARTHEST_M
from robosim.support.checks import SEED, check_choice, check_number, check_some, checked
from robosim.support.files import whole_file
from robosim.support.from_dict import from_dict
from robosim.support.installation import shipped_plans
from robosim.support.parts import check_code_allowed
from robosim.support.reading import FileError, expanded, read_bytes, reading, shown
from robosim.support.text_in import MOST_JSON, MOST_YAML, parse_json, parse_yaml
from robosim.task.tasks import ARRIVAL_M, make_task

logger = logging.getLogger(__name__)

#: Endings of suite files.
SUFFIXES = (".yaml", ".yml", ".json")
#: Decimals that places are stored with: 0.1 mm and 0.01 degrees.
_PLACE_DECIMALS, _YAW_DECIMALS = 4, 2
_WHAT = "a suite of searches"
_REMEDY = "It has `seed`, `plans` and `tasks`, in YAML or JSON; `robosim evaluate --suite-out` writes one."
#: The key of a list of tasks in YAML or JSON.
_TASKS = re.compile(rb"""^\{?[ \t]*["']?tasks["']?[ \t]*:|[,{]\s*["']tasks["']\s*:""", re.MULTILINE)


@dataclass(frozen=True, kw_only=True)
class SuiteTask:
    """A search: where the robot starts and where the target stands."""

    plan: str
    """Name of the plan in the suite."""
    number: int
    """Number of the task in its plan, from 0."""
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
    """Seed of the tasks and of all noise."""
    reader: str = "auto"
    """Reader of the plans, of `robosim.parts.READER`, by name or `module:Name`."""
    file: Path | None = field(default=None, compare=False)
    """File that the suite was read from."""

    def check_places(self) -> None:
        """Raise FileError, before any task is run, if one begins or ends outside of its plan."""
        name = None
        for task in self.tasks:
            if task.plan != name:  # one plan in memory at a time
                name, plan = task.plan, read_plan(self.plans[task.plan], reader=self.reader)
            for what, place in (("start", task.start[:2]), ("target", task.target)):
                cell = plan.to_cells(np.array(place))
                if not ((cell >= 0) & (cell <= plan.shape[::-1])).all():
                    source = "" if self.file is None else f"{shown(self.file)}: "
                    raise FileError(
                        f"{source}task {task.number} of {task.plan}: {what} is ({place[0]:g}, {place[1]:g}) m, "
                        "outside of the plan. Choose a place on its floor."
                    )


def draw_tasks(plan: str, reach: Reach, count: int, seed: int) -> list[SuiteTask]:
    """Tasks in one plan of the suite, each with its start and target drawn again; MapError if the hull fits nowhere."""
    tasks = []
    for number in range(count):
        task = make_task(reach, np.random.default_rng([seed, _seed_of(seed, plan, number)]))
        x, y = (round(float(value), _PLACE_DECIMALS) for value in task.start[:2])
        yaw = round(float(np.degrees(task.start[2])), _YAW_DECIMALS)
        target = tuple(round(float(value), _PLACE_DECIMALS) for value in task.target)
        tasks.append(SuiteTask(plan=plan, number=number, start=(x, y, yaw), target=(target[0], target[1])))
    return tasks


def name_plans(files: Sequence[Path]) -> dict[str, Path]:
    """Names of plan files, which are those of the files; ValueError if two have the same."""
    names = [file.stem.removesuffix(".glb_topdownmap") for file in files]
    for name, count in Counter(names).items():
        if count > 1:
            twins = " and ".join(str(file) for file, other in zip(files, names, strict=True) if other == name)
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
    """Read a suite from a YAML or JSON file."""
    path = expanded(path)
    is_json = path.suffix.lower() == ".json"
    with reading(path, _WHAT, _REMEDY, most_bytes=MOST_JSON if is_json else MOST_YAML) as file:
        return _suite((parse_json if is_json else parse_yaml)(file.read()), path)


@dataclass(frozen=True, kw_only=True)
class _Task:
    """Keys of a task."""

    plan: str
    start: tuple[float, float, float]
    target: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
@checked
class _File:
    """Keys of a file."""

    plans: Mapping[str, str]
    tasks: tuple[_Task, ...]
    seed: Annotated[int, SEED] = 0
    reader: str = "auto"

    def __post_init__(self) -> None:
        check_code_allowed("reader", self.reader)
        if self.reader != "auto":
            READER.check("reader", self.reader)
        check_some("the list of tasks", self.tasks, "plan, start and target of each")
        for name in self.plans:
            if not is_plan_name(name):
                raise ValueError(f"plan {shown(name)} names files too; use letters, digits, - and _.")
        for number, task in enumerate(self.tasks):
            check_choice(f"plan of tasks[{number}]", task.plan, self.plans)
            for value in (*task.start, *task.target):
                check_number(f"a number of tasks[{number}]", value, -FARTHEST_M, FARTHEST_M)
            check_number(f"yaw of tasks[{number}]", task.start[2], -360, 360, "degrees")
            if np.hypot(*np.subtract(task.start[:2], task.target)) < ARRIVAL_M:
                raise ValueError(f"tasks[{number}] starts at its target, expected {ARRIVAL_M:g} m between")


def _suite(content: Any, path: Path) -> Suite:
    said = from_dict(_File, content)
    plans = {name: _plan_file(path.parent, file) for name, file in said.plans.items()}
    for name, file in plans.items():
        if not file.is_file():
            raise FileError(f"plan {shown(name)} is {shown(file)}, where there is no file.")
    counts: Counter[str] = Counter()
    tasks, known = [], dict[_Task, int]()
    for number, task in enumerate(said.tasks):
        if (first := known.setdefault(task, number)) < number:
            logger.warning(f"{shown(path)}: tasks[{number}] is tasks[{first}] again. Use --seeds.")
        tasks.append(SuiteTask(number=counts[task.plan], **vars(task)))
        counts[task.plan] += 1
    order = {name: place for place, name in enumerate(plans)}
    ordered = tuple(sorted(tasks, key=lambda t: (order[t.plan], t.number)))
    return Suite(plans=plans, tasks=ordered, seed=said.seed, reader=said.reader, file=path)


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
