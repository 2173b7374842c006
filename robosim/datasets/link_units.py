"""Units of a data set of links: one transmitter of one building, traced, sounded and estimated.

A unit depends on its own settings and seed alone, and one thread computes it: neither the number of workers nor the
order of units changes a byte. The worker process returns its files as bytes, those in formats of others included: CSV
files of mmwRobotNav and DeepMIMO v4 scenarios. The table of links is written last, so a unit with a table is complete.
"""

import gc
import io
import pickle
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import cloudpickle
import numpy as np
import pyarrow as pa
from jaxtyping import Float
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TaskID, TimeRemainingColumn
from rich.text import Text

from robosim.movers.mover import Body
from robosim.parts import ESTIMATOR, TERMINAL, EstimatorPart, TerminalPart
from robosim.radio.receivers import STEP_M, ReceiverGrid
from robosim.radio.scene import RadioConfig, RadioScene, RadioSite
from robosim.support.checks import SEED, Range, checked
from robosim.support.parts import Part, to_dict
from robosim.support.progress import text_column
from wireless.bands import check_bandwidth
from wireless.estimates import PathEstimates
from wireless.estimation.estimators import PathEstimator
from wireless.estimation.sage import SageEstimator
from wireless.formats.deepmimo_scenario import scenario_name, scene_files, transmitter_files
from wireless.formats.link_records import link_table, write_links
from wireless.formats.mmwrobotnav_csv import estimated_csv, traced_csv
from wireless.motion.blockage import find_blockage, weaken
from wireless.motion.bodies import people
from wireless.paths import Paths
from wireless.sounding.sounder import Rays, Sounder, SoundingConfig

#: Folder below which `deepmimo.load` looks for scenarios.
SCENARIOS = "deepmimo_scenarios"
#: Contents of files by their names.
Files = dict[str, bytes]


def csv_files(
    scene: RadioSite, grid: ReceiverGrid, paths: Paths, tx: int, estimates: PathEstimates | None = None
) -> Files:
    """`NAME_Tx_K.csv` with traced paths of a transmitter, and `NAME_Tx_K_beam_search.csv` with its estimates."""
    config, start = scene.config, f"{scene.name}_Tx_{tx + 1}"
    power = {"tx_power_dbm": config.tx_power_dbm, "threshold_db": config.threshold_db}
    files = {f"{start}.csv": traced_csv(paths, tx, grid.cell, grid.shape, **power)}
    if estimates is not None:
        state = paths.link_state(config.threshold_db)[tx]
        content = estimated_csv(estimates, grid.position, state, grid.cell, grid.shape)
        files[f"{start}_beam_search.csv"] = content
    return files


def transmitters_file(name: str, transmitters: Float[np.ndarray, "n 3"]) -> Files:
    """`NAME_tx_pos.csv`, the places of transmitters [m]."""
    rows = [f"{i},{x:.10g},{y:.10g},{z:.10g}" for i, (x, y, z) in enumerate(transmitters)]
    return {f"{name}_tx_pos.csv": ("\n".join([",x,y,z", *rows]) + "\n").encode("ascii")}


def deepmimo_folder(out: Path, name: str) -> Path:
    """Folder of the scenario of a building."""
    return out / SCENARIOS / scenario_name(name)


def deepmimo_paths(scene: RadioSite, paths: Paths, tx: int) -> Files:
    """Files of a transmitter in a scenario."""
    return transmitter_files(paths, tx, horizontal=scene.config.tracer.polarisation == "horizontal")


def deepmimo_scene(scene: RadioSite, n_tx: int, n_rx: int, n_rx_active: int) -> Files:
    """The other files of a scenario, which are written last: they complete it."""
    return scene_files(
        mesh=scene.mesh,
        materials=scene.whole.materials,
        face_material=np.asarray(scene.whole.face_material, np.int64),
        frequency_hz=scene.config.frequency_hz,
        config=scene.tracer.config,
        n_tx=n_tx,
        n_rx=n_rx,
        n_rx_active=n_rx_active,
    )


class LinkProgress:
    """Counts finished links and shows them in a bar."""

    def __init__(self, progress: Progress, bar: TaskID, out: Path) -> None:
        self._progress, self._bar, self._out = progress, bar, out
        self._start, self._done = time.perf_counter(), 0
        self._found: int | None = None

    def report(self, done: int, total: int) -> None:
        """Set the number of finished links; the first call gives those of earlier runs."""
        if self._found is None:
            self._found = done
            if done > 0:
                line = f"{self._out} holds {done} of the {total} links; resuming from there."
                self._progress.console.print(Text(line))
        self._done = done
        self._progress.update(self._bar, completed=done)

    def timing(self) -> dict[str, float]:
        """Number of links of this run, and seconds since its start."""
        return {"links": self._done - (self._found or 0), "seconds": time.perf_counter() - self._start}


@contextmanager
def link_progress(console: Console, total: int, out: Path) -> Iterator[LinkProgress]:
    """A bar while links are traced."""
    bars = (SpinnerColumn(), text_column("{task.description}"), BarColumn(bar_width=24), MofNCompleteColumn())
    columns = (*bars, TimeRemainingColumn())
    with Progress(*columns, console=console, refresh_per_second=4, speed_estimate_period=600) as progress:
        yield LinkProgress(progress, progress.add_task("links", total=total), out)


Format = Literal["mmwrobotnav", "deepmimo"]
Headings = Literal["fixed", "random"]
#: Links that are sounded at once, in 50 MB; results depend on it.
CHUNK_LINKS = 512
#: Links that are traced at once, a row group of the table: memory does not grow with the building.
_BLOCK_LINKS = 32 * CHUNK_LINKS
#: Number of the random numbers of people in a unit, and their least distance from a receiver [m].
_PEOPLE, _FROM_RECEIVER_M = 1, 0.3
LINKS = "links"
MMWROBOTNAV = "mmwrobotnav"


@dataclass(frozen=True, kw_only=True)
@checked
class LinkSetConfig:
    """Content of a data set."""

    tx_per_plan: Annotated[int, Range(1, 10_000, "transmitters")] = 10
    """Transmitters in each building, at random places."""
    grid_m: Annotated[float, STEP_M] = 0.15
    """Step between receivers [m]."""
    seed: Annotated[int, SEED] = 0
    """Seed of places, phases and noise."""
    estimator: EstimatorPart = "sage"
    """Path estimator, of `robosim.parts.ESTIMATOR`."""
    tx: TerminalPart = "gnb"
    """Terminal of the transmitter, of `robosim.parts.TERMINAL`."""
    rx: TerminalPart = "ue"
    """Terminal of the receiver."""
    headings: Headings = "fixed"
    """Headings of receivers: fixed, as published, or random, as of a moving robot."""
    people: Annotated[int, Range(0, 1000, "people")] = 0
    """Mean number of people in each building, at random places for each link; states are those of the building."""
    formats: tuple[Format, ...] = ()
    """Additional formats."""
    radio: RadioConfig = field(default_factory=RadioConfig)
    """How links are traced."""
    sounding: SoundingConfig = field(default_factory=SoundingConfig)
    """How links are sounded; the power is that of `radio`."""

    def __post_init__(self) -> None:
        sounding = replace(self.sounding, tx_power_dbm=self.radio.tx_power_dbm)
        object.__setattr__(self, "sounding", sounding)
        check_bandwidth(sounding.bandwidth_mhz, self.radio.frequency_hz)


@dataclass(frozen=True)
class LinkPlan:
    """A plan, storey or scene with its transmitters; equal if names and plans are equal."""

    name: str
    """Name of the plan."""
    digest: str
    """Digest of the plan, see `FloorPlan.digest`."""
    packed: bytes = field(compare=False, repr=False)
    """The plan, pickled and compressed: a data set has thousands, and each unit is sent its own."""
    transmitters: Float[np.ndarray, "n 3"] = field(compare=False)
    """Places of transmitters [m]."""
    n_rx: int = field(compare=False)
    """Number of receivers."""

    @classmethod
    def of(cls, plan: Any, transmitters: Float[np.ndarray, "n 3"], n_rx: int) -> "LinkPlan":
        """A plan, storey or scene with places of transmitters [m] and a number of receivers."""
        digest = plan.digest() if callable(plan.digest) else plan.digest
        return cls(plan.name, digest, zlib.compress(cloudpickle.dumps(plan)), transmitters, n_rx)

    @property
    def plan(self) -> Any:
        """The plan, storey or scene."""
        return pickle.loads(zlib.decompress(self.packed))


def stream(seed: int, digest: str, *key: int) -> np.random.Generator:
    """Random numbers of a plan, or of a unit of it."""
    return np.random.default_rng(np.random.SeedSequence([seed, int(digest, 16)], spawn_key=key))


def unit_path(out: Path, name: str, tx: int) -> Path:
    """File of the links of a unit; transmitters count from 0, files from 1."""
    return out / LINKS / f"{name}_Tx_{tx + 1}.parquet"


def make_unit(site: LinkPlan, tx: int, config: LinkSetConfig) -> Files:
    """Trace, sound and estimate all links of a transmitter; files by paths below the data set's, links last."""
    buffer, files = io.BytesIO(), Files()
    write_links(buffer, _tables(site, tx, config, files))
    return {**files, unit_path(Path(), site.name, tx).as_posix(): buffer.getvalue()}


def _tables(site: LinkPlan, tx: int, config: LinkSetConfig, files: Files) -> Iterator[pa.Table]:
    """Yield the links of a transmitter block by block, and add the files of other formats to `files`."""
    scene, grid = prepare_site(site, config.radio, config.grid_m)
    rng, n_rx = stream(config.seed, site.digest, tx), len(grid.position)
    people_rng = stream(config.seed, site.digest, tx, _PEOPLE)
    feet = grid.position * (1, 1, 0) + (0, 0, scene.floor_m)
    heading = rng.uniform(-np.pi, np.pi, n_rx) if config.headings == "random" else np.zeros(n_rx)
    # Each other format has one file for all links of a transmitter.
    block = n_rx if config.formats else _BLOCK_LINKS
    for first in range(0, n_rx, block):
        rows = slice(first, first + block)
        paths = scene.trace(site.transmitters[tx : tx + 1], grid.position[rows], workers=1)
        received = paths
        if config.people:
            received = _among_people(paths, feet[rows], config.people, people_rng, feet)
        rays = Rays.from_paths(received, rx_heading_rad=heading[rows])
        estimates = _estimate(rays, config, rng).turned(rx_heading_rad=heading[rows])
        paths = replace(paths, tx_position=site.transmitters, tx=paths.tx + tx)
        if "mmwrobotnav" in config.formats:
            files |= _below(Path(MMWROBOTNAV) / site.name, csv_files(scene, grid, paths, tx, estimates))
        if "deepmimo" in config.formats:
            files |= _below(deepmimo_folder(Path(), site.name), deepmimo_paths(scene, paths, tx))
        yield link_table(
            paths,
            tx,
            estimates,
            grid.cell[rows],
            plan=site.name,
            rx_heading_rad=heading[rows],
            threshold_db=config.radio.threshold_db,
            first_rx=first,
            all_rx=n_rx,
        )


def _among_people(
    paths: Paths,
    receivers: Float[np.ndarray, "n 3"],
    mean: int,
    rng: np.random.Generator,
    feet: Float[np.ndarray, "n_all 3"],
) -> Paths:
    """Paths weakened by people, up to twice the mean for each of the receivers on the floor, at places of `feet`."""
    factor = np.ones(len(paths), complex)
    ends = np.searchsorted(paths.rx, np.arange(len(receivers) + 1))
    for k, (first, last) in enumerate(pairwise(ends.tolist())):
        places = feet[rng.integers(len(feet), size=int(rng.integers(2 * mean + 1)))]
        places = places[np.hypot(*(places - receivers[k])[:, :2].T) > _FROM_RECEIVER_M]
        if last > first and len(places):
            link = paths.select(np.arange(first, last))
            factor[first:last] = find_blockage(link, people(places, radius_m=Body.radius_m)).factor
    return weaken(paths, factor)[0]


def _below(folder: Path, files: Files) -> Files:
    return {(folder / name).as_posix(): content for name, content in files.items()}


@lru_cache(maxsize=1)
def prepare_site(site: LinkPlan, config: RadioConfig, grid_m: float) -> tuple[RadioScene, ReceiverGrid]:
    """The building and its receivers, cached for the next unit of the same process."""
    # Meshes and tracers refer to each other: those of earlier buildings would stay until Python looks for them.
    gc.collect()
    scene = RadioScene(site.plan, config)
    return scene, scene.grid(grid_m)


@lru_cache(maxsize=1)
def _receiver(estimator: Part, tx: Part, rx: Part, sounding: SoundingConfig) -> tuple[Sounder, PathEstimator]:
    """The sounder and the estimator, cached for the next unit."""
    sounder = Sounder(TERMINAL.make(tx, field="tx"), TERMINAL.make(rx, field="rx"), sounding)
    path_estimator: PathEstimator = ESTIMATOR.make(estimator, sounder, field="estimator")
    if isinstance(path_estimator, SageEstimator):
        path_estimator.workers = 1
    return sounder, path_estimator


def _estimate(rays: Rays, config: LinkSetConfig, rng: np.random.Generator) -> PathEstimates:
    """Estimated paths of links."""
    sounder, estimator = _receiver(config.estimator, config.tx, config.rx, config.sounding)
    parts = []
    for start in range(0, len(rays), CHUNK_LINKS):
        tensor = sounder.measure(rays[start : start + CHUNK_LINKS], rng, workers=1)
        parts.append(estimator.estimate(tensor))
    return PathEstimates(
        **{name: np.concatenate([getattr(p, name) for p in parts]) for name in vars(parts[0])}
    )


def plain_config(config: LinkSetConfig) -> dict[str, Any]:
    """The configuration in plain values."""
    return {**to_dict(config), "chunk_links": CHUNK_LINKS}
