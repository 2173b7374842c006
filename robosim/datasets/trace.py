"""Radio over a whole floor plan: traced paths, in formats of others too, and pictures.

The grid is traced into one file, `paths.parquet`, in units of one transmitter and some consecutive receivers. A unit is
written whole or not at all, so that a run resumes with the same result as an uninterrupted one. Complete units are
joined, by transmitter and receiver. The memory needed is that of a few thousand links. Worker processes make the
building from the plan and cache it; workers of a cluster need no common folder. The other files are made from
`paths.parquet`, one transmitter at a time.
"""

import hashlib
import io
import logging
import math
import shutil
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import lru_cache
from itertools import groupby, product
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from jaxtyping import Bool, Float, Int
from rich.console import Console

from robosim.datasets.link_units import (
    LinkPlan,
    csv_files,
    deepmimo_folder,
    deepmimo_paths,
    deepmimo_scene,
    link_progress,
    transmitters_file,
)
from robosim.datasets.standing import bodies_dict
from robosim.drawing.radio_pictures import choose_link, plot_coverage, plot_grid, plot_link
from robosim.radio.receivers import ReceiverGrid
from robosim.radio.scene import AnyPlace, RadioConfig, RadioSite, radio_site
from robosim.support.checks import check_some
from robosim.support.files import npz_bytes, whole_file, whole_folder, write_files, write_json, write_whole
from robosim.support.installation import package_version
from robosim.support.parts import to_dict
from robosim.support.reading import shown
from robosim.support.run_folder import run_folder
from robosim.support.tum import read_tum
from robosim.support.workers import Workers
from wireless.antennas.mounting import MountedArray
from wireless.coverage import CellState, CoverageMap, link_values
from wireless.formats.deepmimo_scenario import scenario_name
from wireless.motion.bodies import Bodies
from wireless.motion.impulse_responses import sample_channel
from wireless.paths import LinkCategory, Paths
from wireless.sounding.sounder import SoundingConfig
from wireless.tracing.blocks import BLOCK_RX, BLOCK_TX

#: Places of receivers [m].
Receivers = Float[np.ndarray, "n_rx 3"]
#: Places of transmitters [m].
Transmitters = Float[np.ndarray, "n_tx 3"]


logger = logging.getLogger(__name__)

PATHS, UNITS = "paths.parquet", "units"
#: Receivers of a unit, as many as the tracer handles at once.
UNIT_RX = BLOCK_RX


def trace_grid(
    plan: AnyPlace,
    config: RadioConfig,
    tx: Transmitters,
    rx: Receivers,
    folder: Path,
    *,
    bodies: Bodies | None = None,
    workers: int,
    cluster: str | None = None,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Trace the links that are missing in a folder; returns the file of all paths, for `Paths.read_parquet`.

    `report` is called with the numbers of finished and of all links, at first and after each unit.
    """

    def unit(tx: int, first: int) -> Path:
        return folder / UNITS / f"tx{tx:04d}_rx{first:07d}.parquet"

    def missing(first: int) -> list[int]:
        return [i for i in range(len(tx)) if not unit(i, first).exists()]

    total, starts = len(tx) * len(rx), range(0, len(rx), UNIT_RX)
    ends = {first: min(first + UNIT_RX, len(rx)) for first in starts}
    if not (folder / PATHS).exists():
        # The view from receivers does not depend on the transmitter, so that several transmitters share it.
        calls = [
            (txs[j : j + BLOCK_TX], first)
            for txs, group in groupby(starts, missing)
            for first, j in product(group, range(0, len(txs), BLOCK_TX))
        ]
        done = total - sum(len(txs) * (ends[first] - first) for txs, first in calls)
        report(done, total)
        site = LinkPlan.of(plan, tx, len(rx))
        with Workers(workers, cluster, what="links") as pool:
            arguments = [(site, config, txs, rx[first : ends[first]], bodies) for txs, first in calls]
            for number, tables in pool.run(_trace_unit, arguments):
                txs, first = calls[number]
                for i, table in zip(txs, tables, strict=True):
                    write_whole(unit(i, first), table)
                done += len(txs) * (ends[first] - first)
                report(done, total)
        with whole_file(folder / PATHS) as partial:
            _join(
                partial, {(i, first): unit(i, first) for i, first in product(range(len(tx)), starts)}, tx, rx
            )
    shutil.rmtree(folder / UNITS, ignore_errors=True)
    report(total, total)
    return folder / PATHS


def _join(file: Path, units: dict[tuple[int, int], Path], tx: Transmitters, rx: Receivers) -> None:
    """Join the paths of units, by transmitter and first receiver, in one file."""
    writer = None
    try:
        for (i, first), path in units.items():
            paths = Paths.read_parquet(path)
            paths = replace(paths, tx_position=tx, rx_position=rx, tx=paths.tx + i, rx=paths.rx + first)
            table = paths.to_table()
            writer = writer or pq.ParquetWriter(file, table.schema, compression="zstd")
            writer.write_table(table)
    finally:
        if writer is not None:
            writer.close()


@lru_cache(maxsize=1)
def _prepared(site: LinkPlan, config: RadioConfig) -> RadioSite:
    """The site of a plan, cached for the next unit of the same process."""
    return radio_site(site.plan, config)


def _trace_unit(
    site: LinkPlan, config: RadioConfig, txs: list[int], rx: Receivers, bodies: Bodies | None
) -> list[bytes]:
    """Paths from some transmitters to consecutive receivers, one file per transmitter."""
    paths = _prepared(site, config).trace(site.transmitters[txs], rx, workers=1, bodies=bodies)
    tables = []
    for j, tx in enumerate(txs):
        of_tx = paths.select(paths.tx == j)
        buffer = io.BytesIO()
        replace(of_tx, tx_position=site.transmitters[tx : tx + 1], tx=np.zeros_like(of_tx.tx)).write_parquet(
            buffer
        )
        tables.append(buffer.getvalue())
    return tables


#: Least distance of receiver and transmitter, half a wavelength at 28 GHz: ray optics does not hold below it [m].
APART_M = 0.005


def trace_plan(
    plan: AnyPlace,
    config: RadioConfig,
    out: Path,
    *,
    tx: tuple[tuple[float, ...], ...],
    grid_m: float = 0.15,
    bounds_m: tuple[float, ...] | None = None,
    rx: tuple[float, ...] | None = None,
    noise_dbm: float = SoundingConfig().noise_dbm,
    antennas: tuple[MountedArray, MountedArray] | None = None,
    bodies: Bodies | None = None,
    plots: bool = True,
    workers: int = 1,
    cluster: str | None = None,
    console: Console | None = None,
) -> dict[str, Any]:
    """Trace transmitters to a grid of receivers over a plan or scene, and write the results into a folder.

    The files: `paths.parquet`; a DeepMIMO scenario under `deepmimo_scenarios`; `NAME_Tx_K.csv` and `NAME_tx_pos.csv` in
    the format of mmwRobotNav; `coverage.parquet` and `coverage.npz` of `wireless.coverage.CoverageMap`; pictures of
    each transmitter, with rays to `rx` or to a receiver with many paths; `trace.json`, whose content is returned. After
    an interruption the same call resumes, to the same files.

    Noise [dBm] and antennas of transmitters and receivers are those of the coverage; None for isotropic ones. A grid
    over a scene can have bounds, a box x, y, x, y [m]. Bodies, such as people who stand, attenuate paths.

    Raises:
        ValueError: If a position or the grid does not fit.
        FolderError: If the folder belongs to other settings or another process works in it.
        MapError: If the plan has no free area.
    """
    out, console = Path(out), console or Console(quiet=True)
    with console.status("preparing the building ..."):
        scene = radio_site(plan, config)
    check_terminals(tx, () if rx is None else (rx,), scene.height_m)
    transmitters = _transmitters(scene, tx, console)
    given_rx = None if rx is None else scene.places((rx,), "rx")[0]
    grid = scene.grid(grid_m, bounds_m=bounds_m, tx=transmitters)
    with run_folder(out, "trace", _settings(scene, transmitters, grid) | bodies_dict(bodies)):
        with link_progress(console, len(transmitters) * len(grid.position), out) as progress:
            path = trace_grid(
                plan,
                config,
                transmitters,
                grid.position,
                out,
                bodies=bodies,
                workers=workers,
                cluster=cluster,
                report=progress.report,
            )
            timing = progress.timing()
        states, coverage = _write_formats(scene, transmitters, grid, path, out, antennas, noise_dbm, console)
        if plots:
            plot_coverage(out / "coverage.png", scene.section(grid), coverage, bodies)
            for i in range(len(transmitters)):
                with console.status(f"drawing transmitter {i + 1} of {len(transmitters)} ..."):
                    _plot(scene, grid, Paths.read_parquet(path, i), i, given_rx, out, bodies)
        result = {
            "plan": scene.name,
            "tx_m": transmitters,
            "receivers": len(grid.position),
            "links": len(transmitters) * len(grid.position),
            "states": {category.name.lower(): int(states[category]) for category in LinkCategory},
            "cells": {state.name.lower(): int((coverage.state == state).sum()) for state in CellState},
            "engine": scene.engine,
            "deepmimo": scenario_name(scene.name),
            "config": to_dict(config),
            **bodies_dict(bodies),
            "timing": {
                "seconds": round(timing["seconds"], 3),
                "traced": timing["links"],
                "links_per_s": round(timing["links"] / timing["seconds"], 1),
            },
        }
        write_json(out / "trace.json", result)
    return result


def trace_link(
    site: RadioSite,
    out: Path,
    *,
    tx: tuple[tuple[float, ...], ...],
    rx: tuple[tuple[float, ...], ...],
    bodies: Bodies | None = None,
    plots: bool = True,
    console: Console | None = None,
) -> Paths:
    """Trace transmitters to receivers; writes `paths.parquet`, and the rays of one link of each as a picture.

    With several receivers it is an instructive link; without `plots` there is no picture. Bodies attenuate paths.

    Raises:
        ValueError: If a position does not fit.
        FolderError: If the folder holds a grid.
    """
    out, console = Path(out), console or Console(quiet=True)
    check_terminals(tx, rx, site.height_m)
    with run_folder(out, "trace --rx"):
        transmitters = _transmitters(site, tx, console)
        paths = site.trace(transmitters, site.places(rx, "rx"), bodies=bodies)
        _explain_outage(site, transmitters, paths.rx_position, paths.count() > 0)
        with whole_file(out / "paths.parquet") as partial:
            paths.write_parquet(partial)
        for i in range(len(transmitters)) if plots else ():
            plot_link(out / f"rays_tx{i + 1}.png", site, paths, i, choose_link(paths, i), bodies)
    return paths


def trace_along(
    site: RadioSite,
    out: Path,
    *,
    tx: tuple[tuple[float, ...], ...],
    trajectory: Path,
    rate_hz: float,
    console: Console | None = None,
) -> int:
    """Sample the channel from each transmitter to a receiver that moves along a TUM trajectory.

    Writes `channel_txK.npz` for each, the arrays of `wireless.motion.impulse_responses.ImpulseResponses`; returns the
    number of samples.

    Raises:
        ValueError: If a position does not fit, or the trajectory has fewer than two poses.
        FileError: If the trajectory is damaged.
    """
    out, console = Path(out), console or Console(quiet=True)
    check_terminals(tx, (), site.height_m)
    time_s, poses = read_tum(trajectory)
    samples = 0
    with run_folder(out, "trace --along"):
        transmitters = _transmitters(site, tx, console)
        rx = site.places(tuple((x, y) for x, y, _ in poses.tolist()), f"{shown(trajectory)}: a pose")
        for i, position in enumerate(transmitters):
            channel = sample_channel(site.tracer, position, rx, time_s, rate_hz=rate_hz)
            if not channel.gain.any():
                _explain_outage(site, position[None], rx, np.zeros((1, len(rx)), bool))
            write_whole(out / f"channel_tx{i + 1}.npz", npz_bytes(vars(channel)))
            samples = len(channel.time_s)
    return samples


def check_terminals(
    tx: tuple[tuple[float, ...], ...], receivers: tuple[tuple[float, ...], ...], height_m: float
) -> None:
    """Raise ValueError if there is no transmitter, one is given twice, or a receiver is at one."""
    check_some("tx", tx, "at least one transmitter, such as --tx 2.0,1.5")
    places = [tuple([*place, height_m][:3]) for place in tx]
    for number, at in enumerate(places):
        if at in places[:number]:
            raise ValueError(f"tx {_point_text(at)} is given twice. Leave one of them out.")
        near = (rx for rx in receivers if math.dist(at, [*rx, height_m][:3]) < APART_M)
        if rx := next(near, None):
            raise ValueError(
                f"rx {_point_text(rx)} is where tx {_point_text(at)} is, and a path needs some length. Move one "
                f"of them by {1000 * APART_M:g} mm or more."
            )


def _point_text(at: tuple[float, ...]) -> str:
    return f"({', '.join(f'{value:g}' for value in at)}) m"


def _transmitters(
    site: RadioSite, tx: tuple[tuple[float, ...], ...], console: Console
) -> Float[np.ndarray, "n 3"]:
    """Places of transmitters [m], after a word on slow or incomplete traces from them."""
    transmitters = site.places(tx, "tx")
    for remark in site.remarks(transmitters):
        console.print(remark, style="yellow", highlight=False)
    return transmitters


def _explain_outage(
    site: RadioSite, tx: Transmitters, rx: Receivers, reached: Bool[np.ndarray, "n_tx n_rx"]
) -> None:
    """Warn of ends of links [m] without paths that are in solids or below the ground, each once."""
    reasons = (
        site.explain_missing_paths(place, rx, is_reached)
        for place, is_reached in zip(tx, reached, strict=True)
    )
    for reason in filter(None, dict.fromkeys(reasons)):
        logger.warning(f"{site.name}: {reason}")


def _settings(scene: RadioSite, transmitters: Float[np.ndarray, "n 3"], grid: ReceiverGrid) -> dict[str, Any]:
    """Everything that the paths depend on."""
    return {
        "plan": scene.name,
        "tolerance_m": scene.config.building.tolerance_m,
        "building_sha256": scene.digest,
        "version": package_version(),
        "frequency_hz": scene.config.frequency_hz,
        **asdict(scene.tracer.config),
        "tx_m": transmitters,
        "receivers": len(grid.position),
        "receivers_per_unit": UNIT_RX,
        "receivers_sha256": hashlib.sha256(grid.position.tobytes()).hexdigest()[:16],
    }


def _write_formats(
    scene: RadioSite,
    transmitters: Float[np.ndarray, "n 3"],
    grid: ReceiverGrid,
    path: Path,
    out: Path,
    antennas: tuple[MountedArray, MountedArray] | None,
    noise_dbm: float,
    console: Console,
) -> tuple[Int[np.ndarray, "5"], CoverageMap]:
    """Write the paths as a DeepMIMO scenario, as CSV files and as coverage.

    Returns:
        The number of links of each state, and the coverage.
    """
    config, name = scene.config, scene.name
    antennas = antennas or 2 * (MountedArray.polarised(config.tracer.polarisation),)
    links = []
    states = np.zeros(len(LinkCategory), np.int64)
    reached = np.zeros((len(transmitters), len(grid.position)), bool)
    with whole_folder(deepmimo_folder(out, name)) as folder, console.status("writing ...") as status:
        for i in range(len(transmitters)):
            status.update(f"writing transmitter {i + 1} of {len(transmitters)} ...")
            paths = Paths.read_parquet(path, i)
            states += np.bincount(paths.link_category(config.threshold_db)[i], minlength=len(LinkCategory))
            reached[i] = paths.count()[i] > 0
            write_files(folder, deepmimo_paths(scene, paths, i))
            write_files(out, csv_files(scene, grid, paths, i))
            paths = replace(paths, tx_position=transmitters[i : i + 1], tx=np.zeros_like(paths.tx))
            links.append(link_values(paths, *antennas, threshold_db=config.threshold_db))
        n_reached = int(reached.any(axis=0).sum())
        write_files(folder, deepmimo_scene(scene, len(transmitters), len(grid.position), n_reached))
    write_files(out, transmitters_file(name, transmitters))
    _explain_outage(scene, transmitters, grid.position, reached)
    coverage = CoverageMap.from_links(
        {key: np.concatenate([values[key] for values in links]) for key in links[0]},
        grid,
        tx_position=transmitters,
        tx_power_dbm=np.full(len(transmitters), config.tx_power_dbm),
        noise_dbm=noise_dbm,
        frequency_hz=config.frequency_hz,
        coherent=False,
    )
    with whole_file(out / "coverage.parquet") as partial:
        pq.write_table(coverage.to_table(), partial, compression="zstd")
    write_whole(out / "coverage.npz", npz_bytes(coverage.to_arrays()))
    return states, coverage


def _plot(
    scene: RadioSite,
    grid: ReceiverGrid,
    paths: Paths,
    tx: int,
    given_rx: Float[np.ndarray, "3"] | None,
    out: Path,
    bodies: Bodies | None,
) -> None:
    """Draw one transmitter, with the rays to a given receiver or to a chosen one."""
    if given_rx is None:
        link = paths, tx, choose_link(paths, tx)
    else:
        link = scene.trace(paths.tx_position[tx : tx + 1], given_rx[None], bodies=bodies), 0, 0
    plot_grid(
        out,
        f"_tx{tx + 1}",
        scene.section(grid),
        grid,
        paths,
        tx,
        link=link,
        bodies=bodies,
        tx_power_dbm=scene.config.tx_power_dbm,
        threshold_db=scene.config.threshold_db,
    )
