"""Paths of whole grids of links, traced in units into one file, so that an interrupted run can be resumed.

A unit is one transmitter and some consecutive receivers. It is written whole or not at all, and a run traces the
missing units, with the same result as an uninterrupted one. Complete units are joined, by transmitter and receiver, to
`paths.parquet`. The memory needed is that of a few thousand links.

Worker processes make the building from the plan and cache it for their next units; those of a cluster need no common
folder.
"""

import io
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import groupby, product
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from jaxtyping import Float

from robosim.datasets.link_units import Site, prepare_site
from robosim.plans.floorplan import FloorPlan
from robosim.plans.storey_plans import OneStorey
from robosim.radio.scene import RadioConfig
from robosim.support.files import whole_file, write_whole
from robosim.support.workers import Workers
from wireless.paths import Paths
from wireless.tracing.blocks import BLOCK_RX, BLOCK_TX

PATHS, UNITS = "paths.parquet", "units"
#: Receivers of a unit, as many as the tracer handles at once.
UNIT_RX = BLOCK_RX


class LinkGrid:
    """All links between transmitters and the receivers on a grid over a plan."""

    def __init__(
        self,
        plan: FloorPlan | OneStorey,
        config: RadioConfig,
        grid_m: float,
        tx: Float[np.ndarray, "n_tx 3"],
        rx: Float[np.ndarray, "n_rx 3"],
    ) -> None:
        """Define the links; `rx` are the positions [m] of a `receiver_grid`, `grid_m` apart."""
        self._site = Site(plan.digest(), plan, tx, len(rx))
        self._config, self._grid_m = config, grid_m
        self._tx, self._rx = tx, rx
        self._starts = range(0, len(rx), UNIT_RX)

    def trace(
        self,
        folder: Path,
        *,
        workers: int,
        cluster: str | None = None,
        report: Callable[[int, int], None] = lambda done, total: None,
    ) -> Path:
        """Trace the links that are missing in a folder; returns the file of all paths, for `Paths.read_parquet`.

        `report` is called with the numbers of finished and of all links, at first and after each unit.
        """
        total = len(self._tx) * len(self._rx)
        if not (folder / PATHS).exists():
            calls = list(self._missing(folder / UNITS))
            done = total - sum(len(txs) * (self._end(first) - first) for txs, first in calls)
            report(done, total)
            arguments = [
                (self._site, self._config, self._grid_m, txs, first, self._end(first)) for txs, first in calls
            ]
            with Workers(workers, cluster, what="links") as pool:
                for number, tables in pool.run(_trace_unit, arguments):
                    txs, first = calls[number]
                    for i, table in zip(txs, tables, strict=True):
                        write_whole(self._unit(folder / UNITS, i, first), table)
                    done += len(txs) * (self._end(first) - first)
                    report(done, total)
            self._join(folder)
        shutil.rmtree(folder / UNITS, ignore_errors=True)
        report(total, total)
        return folder / PATHS

    def _unit(self, folder: Path, tx: int, first: int) -> Path:
        return folder / f"tx{tx:04d}_rx{first:07d}.parquet"

    def _end(self, first: int) -> int:
        """Index after the last receiver of a unit."""
        return min(first + UNIT_RX, len(self._rx))

    def _missing(self, folder: Path) -> Iterator[tuple[list[int], int]]:
        """Missing units as transmitters and first receiver of each call.

        The view from receivers does not depend on the transmitter, so that several share it.
        """

        def missing(first: int) -> list[int]:
            return [i for i in range(len(self._tx)) if not self._unit(folder, i, first).exists()]

        for txs, group in groupby(self._starts, missing):
            for first, j in product(group, range(0, len(txs), BLOCK_TX)):
                yield txs[j : j + BLOCK_TX], first

    def _join(self, folder: Path) -> None:
        """Join the paths of all units in one file."""
        with whole_file(folder / PATHS) as partial:
            writer = None
            try:
                for i, first in product(range(len(self._tx)), self._starts):
                    unit = Paths.read_parquet(self._unit(folder / UNITS, i, first))
                    table = replace(
                        unit, tx_position=self._tx, rx_position=self._rx, tx=unit.tx + i, rx=unit.rx + first
                    ).to_table()
                    writer = writer or pq.ParquetWriter(partial, table.schema, compression="zstd")
                    writer.write_table(table)
            finally:
                if writer is not None:
                    writer.close()


def _trace_unit(
    site: Site, config: RadioConfig, grid_m: float, txs: list[int], first: int, end: int
) -> list[bytes]:
    """Paths from some transmitters to consecutive receivers, one file per transmitter."""
    scene, grid = prepare_site(site, config, grid_m)
    paths = scene.tracer.trace(site.transmitters[txs], grid.position[first:end], workers=1)
    tables = []
    for j, tx in enumerate(txs):
        some = paths.select(paths.tx == j)
        buffer = io.BytesIO()
        replace(some, tx_position=site.transmitters[tx : tx + 1], tx=np.zeros_like(some.tx)).write_parquet(
            buffer
        )
        tables.append(buffer.getvalue())
    return tables
