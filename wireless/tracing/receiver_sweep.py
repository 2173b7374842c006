"""Which chains of patches and edges of a transmitter may reach a receiver: one sweep over both tables.

Each row takes some ten operations. Loops read and write so few arrays that the compiler makes them handle several
numbers at once, and go over so few rows for each receiver in turn that these stay in the processor's cache. More is
found rather than less: what rounding does is allowed for (`WIDER_M`), and paths are laid out exactly later. Edges are
left out where the wall that hid them from the receiver before hides them again: next to each other, most are hidden.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_types import Point
from wireless.geometry.occlusion import Tree, covers
from wireless.geometry.space import Panes
from wireless.tracing.reachable import WIDER_M, EdgeChains, OpenChains

#: Room for numbers of rows.
Work = Float[np.ndarray, "3 n"]
#: Numbers of rows.
Numbers = Int[np.ndarray, " n"]


#: Rows that are looked at for each receiver in turn: they stay in the processor's cache.
_ROWS = 256


class Hits(NamedTuple):
    """Rows that receivers may get paths from, by receiver."""

    start: Int[np.ndarray, " r1"]
    """Where each receiver's begin, and an end."""
    row: Int[np.ndarray, " h"]
    """Rows, rising for each receiver."""


@compiled
def _in_windows(
    column: Float[np.ndarray, "14 c"], first: int, last: int, p: Point, work: Work, numbers: Numbers
) -> int:
    """Chains from first to last whose window is between image and receiver, or almost; their number."""
    n, size, px, py, pz = 0, last - first, p[0], p[1], p[2]
    share, margin = work[0], work[1]
    nx, ny, nz = column[3, first:last], column[4, first:last], column[5, first:last]
    level, off = column[6, first:last], column[7, first:last]
    for c in range(size):
        a, b = off[c], nx[c] * px + ny[c] * py + nz[c] * pz - level[c]
        # On one side of the patch: no number, nor what is made of it.
        share[c] = a / (a - b) if a * b <= WIDER_M * abs(a) else np.nan
        margin[c] = np.inf
    for i in range(3):
        image, low, high, x = (
            column[i, first:last],
            column[8 + i, first:last],
            column[11 + i, first:last],
            p[i],
        )
        for c in range(size):
            at = image[c] + share[c] * (x - image[c])
            below, above = at - low[c], high[c] - at
            least = below if below < above else above
            margin[c] = margin[c] if margin[c] < least else least
    for c in range(size):
        if margin[c] >= 0:
            numbers[n] = first + c
            n += 1
    return n


@compiled
def _past_edges(
    column: Float[np.ndarray, "9 q"], first: int, last: int, p: Point, work: Work, numbers: Numbers
) -> int:
    """Edges from first to last that are met where the ray leaves for a point at its angle of arrival; their number."""
    n, size, px, py, pz = 0, last - first, p[0], p[1], p[2]
    ox, oy, oz = column[0, first:last], column[1, first:last], column[2, first:last]
    ax, ay, az = column[3, first:last], column[4, first:last], column[5, first:last]
    length, place, off = column[6, first:last], column[7, first:last], column[8, first:last]
    along, distance, margin = work[0], work[1], work[2]
    for q in range(size):
        along[q] = (px - ox[q]) * ax[q] + (py - oy[q]) * ay[q] + (pz - oz[q]) * az[q]
    for q in range(size):
        x, y, z, w = px - ox[q], py - oy[q], pz - oz[q], along[q]
        distance[q] = np.sqrt(abs(x * x + y * y + z * z - w * w))
    for q in range(size):
        d, w = distance[q], along[q]
        slack = WIDER_M * (d + off[q])
        low = place[q] * d + w * off[q] + slack
        high = slack - (place[q] - length[q]) * d - (w - length[q]) * off[q]
        margin[q] = low if low < high else high
    for q in range(size):
        if margin[q] >= 0:
            numbers[n] = first + q
            n += 1
    return n


@compiled
def _in_view(
    panes: Panes, tree: Tree, edges: EdgeChains, rx: Point, first: int, work: Work, numbers: Numbers, n: int
) -> int:
    """Keep the edges, of n, whose rays meet the patch next to the receiver, if any, and are not covered; their number.

    What covered a row from the receiver before is tried alone: mostly it covers it from the next receiver too.
    """
    # Places along the edges and distances from them are in `work`, from the first edge on (`_past_edges`).
    plane, low, high, n_left = panes.plane, panes.low, panes.high, 0
    far, column, cover, p, margin_m = (
        edges.far,
        edges.column,
        edges.cover,
        (rx[0], rx[1], rx[2]),
        WIDER_M + tree.near_m,
    )
    for j in range(n):
        q, inside = numbers[j], True
        patch = far[q, 0]
        if patch < 0 and cover[q] < 0:
            numbers[n_left] = q
            n_left += 1
            continue
        along, distance, off = work[0, q - first], work[1, q - first], column[8, q]
        total = distance + off
        share = (column[7, q] * distance + along * off) / total if total > 0 else 0.0
        x = column[0, q] + share * column[3, q]
        y = column[1, q] + share * column[4, q]
        z = column[2, q] + share * column[5, q]
        if patch >= 0:
            u, v, w, level = plane[patch, 0], plane[patch, 1], plane[patch, 2], plane[patch, 3]
            a = u * x + v * y + w * z - level
            b = u * rx[0] + v * rx[1] + w * rx[2] - level
            if a * b > 0 and abs(a) > WIDER_M and abs(b) > WIDER_M:
                continue
            if abs(b - a) > WIDER_M:
                f = b / (b - a)
                x, y, z = rx[0] + f * (x - rx[0]), rx[1] + f * (y - rx[1]), rx[2] + f * (z - rx[2])
                inside = (
                    low[patch, 0] - WIDER_M <= x <= high[patch, 0] + WIDER_M
                    and low[patch, 1] - WIDER_M <= y <= high[patch, 1] + WIDER_M
                    and low[patch, 2] - WIDER_M <= z <= high[patch, 2] + WIDER_M
                )
        if inside and (cover[q] < 0 or not covers(tree, cover[q], p, (x, y, z), margin_m)):
            numbers[n_left] = q
            n_left += 1
    return n_left


@compiled
def _by_receiver(receiver: Int[np.ndarray, " h"], row: Int[np.ndarray, " h"], n_rx: int) -> Hits:
    """Hits in their order, sorted by receiver."""
    start, place, sorted_row = np.zeros(n_rx + 1, np.int64), np.empty(n_rx, np.int64), np.empty_like(row)
    for r in receiver:
        start[r + 1] += 1
    for r in range(n_rx):
        place[r] = start[r]
        start[r + 1] += start[r]
    for h in range(len(row)):
        sorted_row[place[receiver[h]]] = row[h]
        place[receiver[h]] += 1
    return Hits(start, sorted_row)


@compiled
def chains_at(chains: OpenChains, rx: Float[np.ndarray, "r 3"]) -> Hits:
    """Chains of patches that may reach each receiver."""
    receiver, hit, count = np.empty(4096, np.int64), np.empty(4096, np.int64), 0
    numbers, work, direct, column = np.empty(_ROWS, np.int64), np.empty((3, _ROWS)), 0, chains.column
    while direct < len(chains.order) and chains.order[direct] == 0:
        direct += 1
    for first in range(0, len(chains.order), _ROWS):
        last = min(first + _ROWS, len(chains.order))
        for r in range(len(rx)):
            n = 0
            for c in range(first, min(last, direct)):
                numbers[n] = c
                n += 1
            n += _in_windows(column, max(first, direct), last, rx[r], work, numbers[n:])
            if count + n > len(hit):
                receiver, hit = np.concatenate((receiver, receiver)), np.concatenate((hit, hit))
            receiver[count : count + n], hit[count : count + n] = r, numbers[:n]
            count += n
    return _by_receiver(receiver[:count], hit[:count], len(rx))


@compiled
def edges_at(
    panes: Panes, tree: Tree, edges: EdgeChains, rx: Point, hit: Int[np.ndarray, " q"]
) -> Int[np.ndarray, " h"]:
    """Rows of edges that may reach a receiver, rising; `hit` has room for all rows."""
    work, count, n_edges = np.empty((3, _ROWS)), 0, len(edges.far)
    for first in range(0, n_edges, _ROWS):
        numbers = hit[count:]
        n = _past_edges(edges.column, first, min(first + _ROWS, n_edges), rx, work, numbers)
        count += _in_view(panes, tree, edges, rx, first, work, numbers, n)
    return hit[:count]
