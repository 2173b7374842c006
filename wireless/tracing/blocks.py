"""Links traced in blocks, several at a time: memory stays bounded, and all cores work.

A block is some transmitters and some receivers. Blocks do not depend on the number of workers, and no link
depends on its block, so that results are the same bit for bit however many there are. Threads suffice, since
the inner loops let go of the interpreter lock (`robosim.support.compiled`). A set of links that fits in
one block is traced at once: a single link pays for no threads.
"""

import itertools
import os
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from robosim.support.compiled import delayed_signals
from wireless.tracing.table import Table

T = TypeVar("T")

#: Transmitters and receivers of a block. A block of a detailed plan takes some 50 MB while it is traced.
BLOCK_TX, BLOCK_RX = 16, 512

#: For each transmitter, tables of receivers in a row and the first one's number.
Rows = list[list[tuple[Table, int]]]


def available_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_threads(
    run: Callable[..., T], *parts: Sequence[Any], workers: int | None, stop: Callable[[], None] | None = None
) -> list[T]:
    """Results of a function for each of some parts in turn.

    Args:
        run: The function.
        parts: Its arguments, a sequence for each.
        workers: Threads; None for one on each available core.
        stop: Called if a part fails, or at Ctrl-C: the pool waits for its threads, which need not finish their parts.
    """
    threads = min(available_cores() if workers is None else workers, len(parts[0]))
    if threads <= 1:
        return list(map(run, *parts))
    with ThreadPoolExecutor(threads) as pool:
        try:
            return list(pool.map(run, *parts))
        except BaseException:
            if stop is not None:
                stop()
            raise


def trace_blocks(
    n_tx: int, n_rx: int, trace: Callable[[slice, slice], Iterable[Table]], workers: int | None = None
) -> Rows:
    """Trace all links."""
    blocks = [
        (slice(i, min(i + BLOCK_TX, n_tx)), slice(j, min(j + BLOCK_RX, n_rx)))
        for i, j in itertools.product(range(0, n_tx, BLOCK_TX), range(0, n_rx, BLOCK_RX))
    ]

    stopped = threading.Event()

    def run(block: tuple[slice, slice]) -> list[Table]:
        tables: list[Table] = []
        traced = iter(trace(*block))
        while len(tables) < block[0].stop - block[0].start and not stopped.is_set():
            with delayed_signals():  # once, not for each of the loops that a short link calls
                table = next(traced)
                used = int(table.n_paths.sum())
                tables.append(Table(table.n_paths, *(column[:used].copy() for column in table[1:])))
        return tables

    done = in_threads(run, blocks, workers=workers, stop=stopped.set)
    rows: Rows = [[] for _ in range(n_tx)]
    for (txs, rxs), tables in zip(blocks, done, strict=True):
        for i, table in zip(range(txs.start, txs.stop), tables, strict=True):
            rows[i].append((table, rxs.start))
    return rows
