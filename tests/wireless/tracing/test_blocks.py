"""Links in blocks and threads: the same paths whatever the blocks are and however many work on them."""

import threading
from dataclasses import fields

import numpy as np
import pytest

from wireless.tracing import blocks
from wireless.tracing.table import Table
from wireless.tracing.tracer import Tracer, TracerConfig

BEND = (0.0, 0.0), (9.0, 0.0), (9.0, 3.0), (4.0, 3.0), (4.0, 7.0), (0.0, 7.0)


def points(count, seed):
    return np.random.default_rng(seed).uniform((0.1, 0.1, 0.4), (3.9, 6.9, 2.6), (count, 3))


@pytest.mark.parametrize("scene", ["plan", "space"])
def test_paths_do_not_depend_on_blocks_or_workers(extruded, ring, monkeypatch, scene):
    """Five transmitters and 23 receivers as one block, or as 18 blocks on 1, 2 and 5 threads: equal bit for bit.

    A transmitter or receiver that is given its neighbour's triangles, or a table put in another's place, shows.
    """

    def trace(workers):
        """By a tracer of its own, which has stored nothing."""
        return Tracer(extruded(ring(*BEND)), config=TracerConfig(scene=scene)).trace(tx, rx, workers=workers)

    tx, rx = points(5, 1), points(23, 2)
    whole = trace(1)
    monkeypatch.setattr(blocks, "BLOCK_TX", 2)
    monkeypatch.setattr(blocks, "BLOCK_RX", 4)
    assert len(np.unique(whole.link)) == 5 * 23
    for workers in (1, 2, 5, None):
        paths = trace(workers)
        for field in fields(paths):
            np.testing.assert_array_equal(getattr(paths, field.name), getattr(whole, field.name))


def empty(txs, rxs):
    """Tables without paths, for a block."""
    n_rx, no = rxs.stop - rxs.start, np.zeros(0)
    return [Table(np.zeros(n_rx, int), *[no] * 7) for _ in range(txs.start, txs.stop)]


def test_blocks_cover_each_link_once():
    """33 transmitters and 1025 receivers: the tables of each transmitter follow each other without a gap."""
    rows = blocks.trace_blocks(33, 1025, empty, workers=3)
    assert len(rows) == 33
    for row in rows:
        firsts, lengths = [first for _, first in row], [len(table.n_paths) for table, _ in row]
        assert firsts == [0, 512, 1024] and lengths == [512, 512, 1]


def test_few_links_are_traced_without_threads():
    """What fits in one block runs in the caller's own thread; more than that does not, if there are workers."""
    seen = set()

    def note(txs, rxs):
        seen.add(threading.current_thread())
        return empty(txs, rxs)

    blocks.trace_blocks(1, blocks.BLOCK_RX, note, workers=8)
    assert seen == {threading.current_thread()}
    seen.clear()
    blocks.trace_blocks(1, blocks.BLOCK_RX + 1, note, workers=8)
    assert seen and threading.current_thread() not in seen


def test_workers_must_be_some(extruded):
    """No worker would trace nothing, in silence."""
    with pytest.raises(ValueError, match="workers is 0, expected at least 1"):
        Tracer(extruded([[(0, 0), (1, 0)]])).trace(np.ones((1, 3)), np.ones((1, 3)), workers=0)
