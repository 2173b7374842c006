"""Suites of searches in large buildings, floors of a campus and generated ones, as files of `robosim evaluate`.

Plans of floors have cells of 0.05 m, rows from below, the origin in the corner, and their outside closed, unless the
outline leaks. `robosim evaluate` draws tasks of the same seed alike: the first two of a floor are the published ones.
Seeds of generated buildings begin at `FIRST`; no training uses them. The two suites are evaluated separately, since the
difficulty of a task depends on all tasks of its suite.
"""

import shlex
from pathlib import Path

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from robosim.episode_config import EpisodeConfig
from robosim.evaluation.evaluate import find_suite
from robosim.evaluation.suite import write_suite
from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.generator.wings import LARGE_STYLES
from robosim.plans.files import write_ros
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.support.progress import tracked
from robosim.support.reading import FileError, shown
from tests.benchmarks.harness import DEFAULT, Options, console
from tests.benchmarks.mapex import floor_names, outside_of, read_pictures

#: Tasks of a campus floor, and of a generated building.
FLOOR_TASKS, BUILDING_TASKS = 6, 3
#: Seed of the first generated building. Training and its comparisons begin at the seed, and at 10, 20 and 30 million.
FIRST = 40_000_000
#: Options of the evaluation: physics, and decisions before a search is given up.
EVALUATED = "--physics kinematic --max-steps 4000 --policies oracle shortest learned fused snr"


def main(campus: Positional[Path], *, count: int = 10, options: OmitArgPrefixes[Options] = DEFAULT) -> None:
    """Suites of searches in large buildings: plans and tasks for `robosim evaluate`.

    Args:
        campus: Folder of NAME_occ.png and NAME_rooms.png.
        count: Number of generated buildings of each style.
        options: Of every benchmark; the seed is that of the tasks.
    """
    out = options.folder("large_buildings")
    names = floor_names(campus)
    if not names:
        raise FileError(f"{shown(campus)}: no NAME_occ.png. Give the folder of the floors.")
    for name in names:
        write_ros(campus_plan(campus, name), out / "campus" / f"{name}.yaml")
    make_suite(out / "campus", FLOOR_TASKS, options)
    styles = [style for style in LARGE_STYLES for _ in range(count)]
    with tracked(range(len(styles)), "plans", console) as numbers:
        for number in numbers:
            plan = generate_plan(FIRST + number, config=GeneratorConfig(style=styles[number]))
            write_ros(plan, out / "generated" / f"{plan.name}.yaml")
    if styles:
        make_suite(out / "generated", BUILDING_TASKS, options)


def campus_plan(folder: Path, name: str) -> FloorPlan:
    """Read a floor as a plan, in which the outside is occupied."""
    drawn, rooms = read_pictures(folder, name)
    occupied = (drawn | outside_of(drawn, rooms))[::-1]
    return FloorPlan(
        occupancy=np.where(occupied, OCCUPIED, FREE).astype(np.uint8), resolution_m=0.05, name=name
    )


def make_suite(plans: Path, targets: int, options: Options) -> None:
    """Draw the tasks of the plans of a folder, and write them to a suite file next to it."""
    suite = find_suite(
        [str(plans)],
        EpisodeConfig(),
        targets=targets,
        seed=options.seed,
        workers=options.workers,
        console=console,
    )
    file = plans.with_suffix(".yaml")
    write_suite(suite, file)
    console.print(f"Wrote {len(suite.tasks)} tasks in {len(suite.plans)} plans: {file}", soft_wrap=True)
    folder = shlex.quote(str(plans.parent / f"{plans.name}-searches"))
    console.print(
        f"Next: robosim evaluate {shlex.quote(str(file))} {EVALUATED} --out {folder}", soft_wrap=True
    )
    console.print(f"Then: python -m tests.benchmarks search {folder}", soft_wrap=True)
