"""Paths of whole grids of links, traced piece by piece into one file, so that a long run can be killed.

The links are cut into units: one transmitter and some receivers in a row. Each unit is written whole or not
at all, and a run goes on from the units that it finds, with the same result as if it had never stopped. When
the last one is there they are joined, by transmitter and receiver, to `paths.parquet`. The memory needed is
that of a few thousand links, however many there are.

A folder belongs to one grid: `settings.json` says of which, and other settings are refused (`wireless.run_folder`).
"""

import hashlib
import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
from itertools import groupby, product
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import trimesh
from jaxtyping import Float, Int

from wireless.blocks import BLOCK_RX, BLOCK_TX, available_cores
from wireless.paths import Paths
from wireless.raytrace import Tracer
from wireless.run_folder import alone, claim, whole

PATHS, UNITS = "paths.parquet", "units"
#: Receivers of a unit: what the tracer takes at once.
UNIT_RX = BLOCK_RX


def trace_grid(
    tracer: Tracer,
    tx: Float[np.ndarray, "n_tx 3"],
    rx: Float[np.ndarray, "n_rx 3"],
    folder: str | PathLike[str],
    *,
    about: Mapping[str, Any] | None = None,
    report: Callable[[int, int], None] | None = None,
    workers: int | None = None,
) -> Path:
    """Trace all links between transmitters and receivers into a folder, or the ones that are missing there.

    Args:
        tracer: The building.
        tx: Positions of transmitters [m].
        rx: Positions of receivers [m].
        folder: Where to; made if it is missing.
        about: What else the result depends on, above all the building (see `mesh_digest`): plain values that
            have to be the same when a run goes on.
        report: Told the number of links done and of all links, at first and whenever
            some are on disk.
        workers: Threads; None for one on each available core. The result does not depend on it.

    Returns:
        The file of all paths, for `Paths.read_parquet` or `read_transmitter`.

    Raises:
        DatasetError: If the folder holds paths of other settings, or another process is at work in it.
        ValueError: If positions are not what the tracer takes.
    """
    tx, rx = np.asarray(tx, float), np.asarray(rx, float)
    if not len(tx) or not len(rx):
        raise ValueError(f"{len(tx)} transmitters and {len(rx)} receivers make no link; give one of each.")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    units = _Units(folder / UNITS, len(tx), len(rx))
    report = report or (lambda done, total: None)
    with alone(folder):
        begun = (folder / PATHS).exists() or any(units.folder.glob("tx*.parquet"))
        claim(folder, _settings(tracer, tx, rx, dict(about or {})), begun=begun)
        if not (folder / PATHS).exists():
            units.trace(tracer, tx, rx, report, workers)
            units.join(tx, rx, folder / PATHS)
        shutil.rmtree(units.folder, ignore_errors=True)
    report(len(tx) * len(rx), len(tx) * len(rx))
    return folder / PATHS


def read_transmitter(path: str | PathLike[str], tx: int) -> Paths:
    """The paths of one transmitter out of a file of many, without reading the others.

    Args:
        path: What `trace_grid` or `Paths.write_parquet` wrote.
        tx: Number of the transmitter.

    Raises:
        DataError: If the file is not one of radio paths, or damaged.
    """
    return Paths.read_parquet(path, tx)


def mesh_digest(
    mesh: trimesh.Trimesh, materials: tuple[str, ...], face_material: Int[np.ndarray, "n_faces"]
) -> str:
    """A short text that changes with any vertex, face or material of a building."""
    seen = hashlib.sha256()
    for array in (mesh.vertices, mesh.faces, face_material):
        seen.update(np.ascontiguousarray(array, float).tobytes())
    seen.update("|".join(materials).encode())
    return seen.hexdigest()[:16]


class _Units:
    """The pieces that a grid is cut into, and the files that they are in."""

    def __init__(self, folder: Path, n_tx: int, n_rx: int):
        self.folder = folder
        self.n_tx, self.n_rx = n_tx, n_rx
        self.starts = range(0, n_rx, UNIT_RX)

    def path(self, tx: int, first: int) -> Path:
        return self.folder / f"tx{tx:04d}_rx{first:07d}.parquet"

    def end(self, first: int) -> int:
        """Where the receivers of a unit end."""
        return min(first + UNIT_RX, self.n_rx)

    def calls(self, most: int) -> Iterator[tuple[list[int], list[int]]]:
        """What is missing, as transmitters and neighbouring receivers (their starts) to be traced in one call.

        What receivers see does not depend on the transmitter, so that several share it.

        Args:
            most: Most units of receivers in a call.
        """

        def missing(first: int) -> list[int]:
            return [i for i in range(self.n_tx) if not self.path(i, first).exists()]

        for txs, group in groupby(self.starts, missing):
            firsts = list(group)
            for k, j in product(range(0, len(firsts), most), range(0, len(txs), BLOCK_TX)):
                yield txs[j : j + BLOCK_TX], firsts[k : k + most]

    def trace(
        self,
        tracer: Tracer,
        tx: Float[np.ndarray, "n_tx 3"],
        rx: Float[np.ndarray, "n_rx 3"],
        report: Callable[[int, int], None],
        workers: int | None,
    ) -> None:
        """Trace the units that have no file."""
        self.folder.mkdir(exist_ok=True)
        # Two units for each thread, so that none waits long for the slowest one.
        calls = list(self.calls(2 * (available_cores() if workers is None else max(1, workers))))
        total = self.n_tx * self.n_rx
        done = total - sum(len(txs) * (self.end(firsts[-1]) - firsts[0]) for txs, firsts in calls)
        report(done, total)
        for txs, firsts in calls:
            start = firsts[0]
            paths = tracer.trace(tx[txs], rx[start : self.end(firsts[-1])], workers=workers)
            for (j, i), first in product(enumerate(txs), firsts):
                end = self.end(first)
                mine = (paths.tx == j) & (paths.rx >= first - start) & (paths.rx < end - start)
                some = paths.select(mine)
                one = replace(
                    some,
                    tx_position=tx[i : i + 1],
                    rx_position=rx[first:end],
                    tx=np.zeros_like(some.tx),
                    rx=some.rx - (first - start),
                )
                with whole(self.path(i, first)) as partial:
                    one.write_parquet(partial)
                done += end - first
                report(done, total)

    def join(self, tx: Float[np.ndarray, "n_tx 3"], rx: Float[np.ndarray, "n_rx 3"], path: Path) -> None:
        """Put the paths of all units into one file, a unit at a time."""
        with whole(path) as partial:
            writer = None
            try:
                for i, first in product(range(self.n_tx), self.starts):
                    unit = Paths.read_parquet(self.path(i, first))
                    table = replace(
                        unit, tx_position=tx, rx_position=rx, tx=unit.tx + i, rx=unit.rx + first
                    ).to_table()
                    writer = writer or pq.ParquetWriter(partial, table.schema, compression="zstd")
                    writer.write_table(table)
            finally:
                if writer is not None:
                    writer.close()


def _settings(
    tracer: Tracer, tx: Float[np.ndarray, "n_tx 3"], rx: Float[np.ndarray, "n_rx 3"], about: dict[str, Any]
) -> dict[str, Any]:
    """All that the paths depend on, in JSON's own types."""
    settings = {
        **about,
        "frequency_hz": tracer.frequency_hz,
        **asdict(tracer.config),
        "tx_m": tx.tolist(),
        "receivers": len(rx),
        "receivers_per_unit": UNIT_RX,
        "receivers_sha256": hashlib.sha256(rx.tobytes()).hexdigest()[:16],
    }
    return json.loads(json.dumps(settings))
