"""What commands share: how points are typed, where plans and results lie, who does the work."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from datetime import datetime
from pathlib import Path
from shlex import quote
from typing import Annotated, Literal

import tyro

from robosim.commands.speaking import console
from robosim.parts import ReaderPart
from robosim.plans.floorplan import FloorPlan, MapError, MapReading
from robosim.plans.storey_plans import OneStorey, StoreysPlan
from robosim.support.checks import FARTHEST, check_number, check_numbers, shown
from robosim.support.interrupt import SIGNALLED
from robosim.support.run_folder import check_folder, run_folder

#: More processes than this are a slip of the finger.
MOST_WORKERS = 1024


def _numbers(
    least: int, most: int, metavar: str
) -> tyro.constructors.PrimitiveConstructorSpec[tuple[float, ...]]:
    """How tyro reads comma-separated numbers such as 3.2,-4.5."""

    def parse(words: list[str]) -> tuple[float, ...]:
        try:
            values = tuple(float(word) for word in words[0].split(","))
        except ValueError:
            values = ()
        if not (least <= len(values) <= most and all(abs(value) <= FARTHEST for value in values)):
            raise ValueError(
                f"{shown(words[0])}, expected {metavar}: numbers up to {FARTHEST:g} with commas and no spaces"
            )
        return values

    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=metavar,
        instance_from_str=parse,
        is_instance=lambda value: value is None or isinstance(value, tuple),
        str_from_instance=lambda value: ["None" if value is None else ",".join(f"{v:g}" for v in value)],
    )


def _named_place(word: str) -> tuple[str, float, float]:
    name, *numbers = word.split(",")
    try:
        x, y = map(float, numbers)
    except ValueError:
        raise ValueError(f"{shown(word)}, expected NAME,X,Y: a name and two numbers [m], no spaces") from None
    return name, x, y


# None stands inside: of a union tyro would tell all that each part of it was tried with.
XY = Annotated[tuple[float, ...] | None, _numbers(2, 2, "X,Y")]
Place = Annotated[tuple[float, ...] | None, _numbers(2, 3, "X,Y[,Z]")]
Pose = Annotated[tuple[float, ...] | None, _numbers(3, 3, "X,Y,YAW")]
#: Something with a name at a place.
NamedPlace = Annotated[
    tuple[str, float, float],
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="NAME,X,Y",
        instance_from_str=lambda words: _named_place(words[0]),
        is_instance=lambda value: isinstance(value, tuple),
        str_from_instance=lambda value: [",".join(map(str, value))],
    ),
]
#: One of several places.
OnePlace = Annotated[tuple[float, ...], _numbers(2, 3, "X,Y[,Z]")]


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """How to read floor plans that do not say everything themselves."""

    resolution: float | None = None
    """Metres per pixel, for plans that do not say (images, arrays)."""
    floor_height: float | None = None
    """Height of the storey's floor [m], for meshes of several storeys."""
    up: Literal["auto", "y", "z"] = "auto"
    """Axis of a mesh that points up; auto goes by its format and floors."""
    unit: float | None = None
    """Unit of length of a mesh [m]: 0.001 for millimetres, 0.0254 for inches; metres if not given."""
    ground: float | None = None
    """Height of level ground to add below a mesh that has no floor [m]."""
    thinnest_wall: float | None = None
    """Dark strokes of an image thinner than this are dropped as text, door arcs and furniture [m]; all are walls if
    not given."""
    allow_large: bool = False
    """Whether an image or array may be of a building longer than 500 m."""
    map_reading: MapReading = "common"
    """Unknown cells of a ROS map: by a common grey of unknown, or by the letter of its thresholds alone."""
    reader: ReaderPart = "auto"
    """Who reads the file: auto goes by its ending; module:Name is one of your own."""
    furnishings: Path | None = None
    """YAML file of what is placed in the building, beside what the plan says: tables, shelves, any mesh."""

    def __post_init__(self) -> None:
        check_numbers(
            self,
            resolution=(0.001, 10, "m, the side of a cell"),
            floor_height=(-1e5, 1e5, "m"),
            unit=(1e-9, 1e6, "m"),
            ground=(-1e5, 1e5, "m"),
            thinnest_wall=(1e-3, 10, "m"),
        )


#: For plans that say everything themselves.
NO_OPTIONS = PlanOptions()


def read(plan: str, options: PlanOptions = NO_OPTIONS) -> FloorPlan:
    """The floor plan of a name or file."""
    from robosim.plans.files import read_plan
    from robosim.plans.formats.furnishing_file import read_furnishings

    found = read_plan(
        plan,
        resolution_m=options.resolution,
        floor_height_m=options.floor_height,
        up=options.up,
        unit_m=options.unit,
        ground_m=options.ground,
        thinnest_wall_m=options.thinnest_wall,
        allow_large=options.allow_large,
        map_reading=options.map_reading,
        reader=options.reader,
    )
    if options.furnishings is None:
        return found
    return replace(found, furnishings=found.furnishings + read_furnishings(options.furnishings))


def read_place(plan: str, options: PlanOptions = NO_OPTIONS) -> FloorPlan | StoreysPlan:
    """The floor plan, or the building of several storeys, of a name or file."""
    from robosim.plans.storey_plans import is_storeys
    from robosim.plans.storeys_file import read_storeys
    from robosim.support.reading import expanded

    file = expanded(plan)
    if not is_storeys(file):
        return read(plan, options)
    for one in fields(options):
        if getattr(options, one.name) != one.default:
            raise MapError(
                f"{plan}: --{one.name.replace('_', '-')} is of single floor plans. Say it in the storeys' own files, "
                "such as 'furnishings: room.yaml' in their ROS maps."
            )
    return read_storeys(file)


def read_storey(plan: str, storey: int | None, options: PlanOptions = NO_OPTIONS) -> FloorPlan | OneStorey:
    """The floor plan of a name or file, or one storey of a building of several; the lowest if none is asked for.

    Raises:
        MapError: If there is no such storey, or one is asked for of a single plan.
    """
    place = read_place(plan, options)
    if isinstance(place, StoreysPlan):
        return place.one(storey or 0)
    if storey is not None:
        raise MapError(f"{plan}: storey is {storey}, but this is a single floor plan. Leave --storey out.")
    return place


@dataclass(frozen=True, kw_only=True)
class WorkOptions:
    """Who does the work."""

    workers: int | None = None
    """Processes at once; one on each available core if not given. No result depends on it."""
    cluster: str | None = None
    """Address of a dask scheduler whose workers do it instead; needs the extra `cluster`."""

    def __post_init__(self) -> None:
        check_numbers(self, workers=(1, MOST_WORKERS, "processes"))

    @property
    def count(self) -> int:
        """Processes on this machine."""
        return self.workers or len(os.sched_getaffinity(0))


def check_threads(threads: int | None, name: str = "workers") -> None:
    """See that a number of threads is one, if it is given.

    Raises:
        ValueError: If it is not.
    """
    if threads is not None:
        check_number(name, threads, 1, MOST_WORKERS, "threads", whole=True)


#: One process on each core.
ALL_CORES = WorkOptions()


def folder_for(out: Path | None, command: str) -> Path:
    """The folder asked for, or a new one under runs/ named by the time and the command. It is not made yet.

    Args:
        out: What was asked for.
        command: What will write there, such as "bench render".

    Raises:
        FolderError: If it cannot be written to, or holds the results of another command: said before the work
            rather than after it.
    """
    folder = out or Path("runs") / f"{datetime.now():%Y%m%d-%H%M%S}-{command.replace(' ', '-')}"
    check_folder(folder, command)
    return folder


@contextmanager
def results_in(out: Path | None, command: str) -> Iterator[Path]:
    """The same folder, made and claimed as long as the block lasts."""
    with run_folder(folder_for(out, command), command) as folder:
        yield folder


@contextmanager
def going_on(folder: Path) -> Iterator[None]:
    """Say how to go on if the work in the block is interrupted."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit) as error:
        if isinstance(error, KeyboardInterrupt) or error.code == SIGNALLED + signal.SIGTERM:
            console.print(
                f"Interrupted; what was finished is kept. Go on with the same command and --out {quote(str(folder))}",
                soft_wrap=True,
            )
        raise
