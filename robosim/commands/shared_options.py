"""Options that commands share: points, reading of plans, radio, output folders, worker processes."""

import inspect
import os
import signal
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from datetime import datetime
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from tyro.conf import OmitArgPrefixes

from robosim.commands.command_table import value_of
from robosim.commands.option_help import option_name
from robosim.commands.output import console
from robosim.parts import MaterialPart, ReaderPart
from robosim.plans.floorplan import FloorPlan, MapError, ReadingOptions
from robosim.plans.storey_plans import OneStorey, StoreysPlan
from robosim.support.checks import ADVANCED, FARTHEST, Range, checked, shown
from robosim.support.interrupt import SIGNALLED
from robosim.support.run_folder import check_folder, run_folder
from wireless.bands import band_named

if TYPE_CHECKING:
    from robosim.radio.scene import RadioConfig
    from wireless.sounding.sounder import SoundingConfig


@dataclass(frozen=True, kw_only=True)
class RadioOptions:
    """Which paths are traced."""

    frequency_ghz: float = 28.0
    """Carrier frequency [GHz]."""
    max_reflections: int = 3
    """Most reflections on a path without diffraction."""
    diffraction: bool = True
    """Whether edges diffract."""
    diffraction_reflections: Annotated[int, ADVANCED] = 1
    """Most reflections, before and after together, on a path with diffraction."""
    floor_ceiling: bool = False
    """Whether floor and ceiling reflect."""
    max_transmissions: Annotated[int | None, ADVANCED] = None
    """Most walls that a path passes; 2 below 10 GHz and none from there on if not given."""
    wall_passage: Annotated[Literal["wall", "face"], ADVANCED] = "wall"
    """What counts as a wall: both faces of a drawn wall together, or each face alone, as in the published grids."""
    wall_thickness: float | None = None
    """Thickness of walls of one --material, such as drywall [m]; half-spaces if not given."""
    wall_gap: Annotated[float, ADVANCED] = 0.0
    """Air between two layers of that thickness [m], such as 0.089 between plasterboards of 0.013; 0 for one layer."""
    scattering: float | None = None
    """How much walls scatter, coefficient S from 0 to 1; nothing if not given."""
    curved_walls: Annotated[bool, ADVANCED] = False
    """Whether round posts and curved walls of a plan reflect as such, instead of by the flat walls drawn for them."""
    tolerance: Annotated[float | None, ADVANCED] = None
    """Largest shift of walls that saves corners [m]; by default walls under staircases are straight, except in
    published grids; 0 keeps every cell."""
    max_paths: Annotated[int, ADVANCED] = 25
    """Most paths of a link; weaker ones are dropped."""
    material: MaterialPart = "partition"
    """Material of walls and furniture."""
    height: float = 1.5
    """Height of receivers, and of transmitters without one of their own [m]."""
    tx_power_dbm: float = 23.0
    """Transmit power [dBm]."""
    threshold_dbm: Annotated[float | None, ADVANCED] = None
    """Received power below which a path does not count for the link state [dBm]."""

    def config(self, polarisation: Literal["vertical", "horizontal", "both"] = "vertical") -> "RadioConfig":
        """The configuration of the simulator's radio."""
        from robosim.building.building import BuildingConfig
        from robosim.radio.scene import RadioConfig
        from wireless.tracing.tracer import TracerConfig

        return RadioConfig(
            frequency_hz=self.frequency_ghz * 1e9,
            height_m=self.height,
            tx_power_dbm=self.tx_power_dbm,
            threshold_dbm=self.threshold_dbm,
            tracer=TracerConfig(
                wall_thickness_m=self.wall_thickness,
                wall_gap_m=self.wall_gap,
                polarisation=polarisation,
                **{
                    name: getattr(self, name)
                    for name in vars(self).keys()
                    & TracerConfig.__dataclass_fields__.keys() - {"floor_ceiling"}
                },
                floor_ceiling=self.floor_ceiling or None,  # False: as the scene says
            ),
            building=BuildingConfig(
                tolerance_m=self.tolerance, wall_material=self.material, furniture_material=self.material
            ),
        )


#: As in the reference.
DEFAULT_RADIO = RadioOptions()


@dataclass(frozen=True, kw_only=True)
class WaveformOptions:
    """How links are sounded, besides transmit power."""

    bandwidth_mhz: float = 400.0
    """Bandwidth, and rate of complex samples [MHz]."""
    n_samples: int = 2048
    """Samples of the waveform, sent once in each beam."""
    loss_db: float = 6.0
    """Noise figure and other losses [dB]."""
    half_window: int = 5
    """Samples that are recorded before and after the strongest delay."""

    def config(self) -> "SoundingConfig":
        """The configuration of the sounding, at its default power."""
        from wireless.sounding.sounder import SoundingConfig

        return SoundingConfig(**vars(self))


#: As in the reference.
DEFAULT_WAVEFORM = WaveformOptions()


def of_band(name: str) -> dict[str, Any]:
    """Default values of arguments of commands in a radio band; ValueError if there is none of this name."""
    band = band_named(name)
    waveform = {field.name: getattr(band, field.name) for field in fields(WaveformOptions)}
    return {
        "radio": RadioOptions(frequency_ghz=band.frequency_hz / 1e9, tx_power_dbm=band.tx_power_dbm),
        "waveform": WaveformOptions(**waveform),
        "transmitter": band.transmitter,
        "receiver": band.receiver,
    }


def band_values(parameters: Mapping[str, inspect.Parameter], words: Sequence[str]) -> dict[str, Any]:
    """Defaults of arguments by `--band`, if it is among the words."""
    name = value_of("--band", words)
    return {} if name is None else {key: value for key, value in of_band(name).items() if key in parameters}


#: Threads and processes of a command.
THREADS, PROCESSES = Range(1, 1024, "threads"), Range(1, 1024, "processes")


def _numbers(
    n_min: int, n_max: int, metavar: str
) -> tyro.constructors.PrimitiveConstructorSpec[tuple[float, ...]]:
    """Parse comma-separated numbers such as 3.2,-4.5."""

    def parse(words: list[str]) -> tuple[float, ...]:
        try:
            values = tuple(float(word) for word in words[0].split(","))
        except ValueError:
            values = ()
        if not (n_min <= len(values) <= n_max and all(abs(value) <= FARTHEST for value in values)):
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


# None is part of the annotated type: of a union, tyro prints the error of every member.
XY = Annotated[tuple[float, ...] | None, _numbers(2, 2, "X,Y")]
Box = Annotated[tuple[float, ...] | None, _numbers(4, 4, "X,Y,X,Y")]
Pose = Annotated[tuple[float, ...] | None, _numbers(3, 3, "X,Y,YAW")]
#: A name and a place.
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
@checked
class PlanOptions(ReadingOptions):
    """How to read floor plans that lack information."""

    reader: ReaderPart = "auto"
    """Reader of the file: auto chooses by the ending; module:Name is your own."""
    furnishings: Path | None = None
    """YAML file of additional furnishings: tables, shelves, any mesh."""


#: How a command reads plans, behind --help-all.
Reading = Annotated[OmitArgPrefixes[PlanOptions], ADVANCED]
#: For plans that need no options.
NO_OPTIONS = PlanOptions()


def read(plan: str, options: PlanOptions = NO_OPTIONS) -> FloorPlan:
    """The floor plan of a name or file."""
    from robosim.plans.files import read_plan
    from robosim.plans.formats.furnishing_file import read_furnishings

    stated = {field.name: getattr(options, field.name) for field in fields(ReadingOptions)}
    floor_plan = read_plan(plan, reader=options.reader, **stated)
    if options.furnishings is None:
        return floor_plan
    return replace(floor_plan, furnishings=floor_plan.furnishings + read_furnishings(options.furnishings))


def read_place(plan: str, options: PlanOptions = NO_OPTIONS) -> FloorPlan | StoreysPlan:
    """The floor plan, or the building of several storeys, of a name or file."""
    from robosim.plans.storey_plans import is_storeys
    from robosim.plans.storeys_file import read_storeys
    from robosim.support.reading import expanded

    file = expanded(plan)
    if not is_storeys(file):
        return read(plan, options)
    for field in fields(options):
        if getattr(options, field.name) != field.default:
            raise MapError(
                f"{plan}: {option_name(field.name, field.type)} is for single floor plans. Set it in the files "
                "of the storeys, such as 'furnishings: room.yaml' in their ROS maps."
            )
    return read_storeys(file)


def read_storey(plan: str, storey: int | None, options: PlanOptions = NO_OPTIONS) -> FloorPlan | OneStorey:
    """The floor plan of a name or file, or one storey of a building of several; the lowest by default.

    Raises:
        MapError: If there is no such storey, or the plan is a single one and a storey is given.
    """
    place = read_place(plan, options)
    if isinstance(place, StoreysPlan):
        return place.storey(storey or 0)
    if storey is not None:
        raise MapError(f"{plan}: storey is {storey}, but this is a single floor plan. Leave --storey out.")
    return place


@dataclass(frozen=True, kw_only=True)
@checked
class WorkOptions:
    """Worker processes."""

    workers: Annotated[int | None, PROCESSES] = None
    """Processes at once; by default one for each available core. Results do not depend on it."""
    cluster: str | None = None
    """Address of a dask scheduler whose workers are used instead; needs the extra `cluster`."""

    @property
    def count(self) -> int:
        """Processes on this machine."""
        return self.workers or len(os.sched_getaffinity(0))


#: Which processes a command works in.
Work = OmitArgPrefixes[WorkOptions]
#: One process on each core.
ALL_CORES = WorkOptions()


def output_folder(out: Path | None, command: str) -> Path:
    """The output folder of a command, checked before the work begins and not made yet.

    Args:
        out: The folder that was given; None for a new one under runs/, named by time and command.
        command: The command, such as "train mapper".

    Raises:
        FolderError: If the folder cannot be written to, or holds the results of another command.
    """
    folder = out or Path("runs") / f"{datetime.now():%Y%m%d-%H%M%S}-{command.replace(' ', '-')}"
    check_folder(folder, command)
    return folder


@contextmanager
def results_folder(out: Path | None, command: str) -> Iterator[Path]:
    """Make the output folder of a command, and lock it as long as the block lasts."""
    with run_folder(output_folder(out, command), command) as folder:
        yield folder


@contextmanager
def training(out: Path | None, network: str, **options: Any) -> Iterator[tuple[Path, str]]:
    """Output folder of `robosim train NETWORK`, and the command as typed with its options, for the card."""
    words = [f"robosim train {network}"]
    for name, value in options.items():
        option = name.replace("_", "-")
        is_switch = isinstance(value, bool)
        words.append(f"--{'' if value else 'no-'}{option}" if is_switch else f"--{option} {value}")
    folder = output_folder(out, f"train {network}")
    with resume_hint(folder):
        yield folder, " ".join(words)


@contextmanager
def resume_hint(folder: Path) -> Iterator[None]:
    """Print how to resume if the work in the block is interrupted."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit) as error:
        if isinstance(error, KeyboardInterrupt) or error.code == SIGNALLED + signal.SIGTERM:
            console.print(
                f"Interrupted; finished parts are saved. Resume with the same command and --out {quote(str(folder))}",
                soft_wrap=True,
            )
        raise
