"""Trees of boxes: things sorted so that those in some place are found without looking at all of them.

Cuts are where a ray is least likely to meet both sides: the chance that it meets a box is as its surface (J. D.
MacDonald and K. S. Booth, Heuristics for ray tracing using space subdivision, Visual Computer 6 (1990) 153). They are
looked for between 16 bins of centres along each axis (I. Wald, On fast construction of SAH-based bounding volume
hierarchies, IEEE Symposium on Interactive Ray Tracing, 2007).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_types import Points

LEAF = 4


#: Trees of boxes are halved from this depth on; stacks have room for 64 boxes.
_DEEP = 32


class Boxes(NamedTuple):
    """Boxes of things, each with two boxes inside or a few things."""

    low: Float[np.ndarray, "b 3"]
    """Lowest corner of each box [m]."""
    high: Float[np.ndarray, "b 3"]
    """Highest corner of each box [m]."""
    child: Int[np.ndarray, "b 2"]
    """Two boxes; or -1 minus the first thing, and the number of things."""
    number: Int[np.ndarray, " n"]
    """Number of each thing before it was sorted into boxes."""


def make_boxes(low: Points, high: Points) -> Boxes:
    """Sort things, by their bounds, into boxes, each of two boxes or a few things."""
    if not len(low):
        return Boxes(np.zeros((1, 3)), np.zeros((1, 3)), np.array([[-1, 0]]), np.empty(0, np.int64))
    return _cut(np.ascontiguousarray(low, float), np.ascontiguousarray(high, float))


@compiled
def _best_cut(low: Points, high: Points, members: Int[np.ndarray, " m"], side: Int[np.ndarray, " m"]) -> int:
    """Where to cut some things in two: how many come first, 0 if there is no cut; `side` is 0 for these, else 1."""
    bins, best, axis, at = 16, np.inf, -1, 0
    count, box = np.empty(bins, np.int64), np.empty((bins, 6))
    below, grown = np.empty(bins), np.empty(6)
    least, scale = np.empty(3), np.zeros(3)
    for i in range(3):
        least[i], greatest = np.inf, -np.inf
        for t in members:
            centre = low[t, i] + high[t, i]
            least[i], greatest = min(least[i], centre), max(greatest, centre)
        if greatest - least[i] <= 1e-12:
            continue
        scale[i] = bins * (1 - 1e-9) / (greatest - least[i])
        count[:] = 0
        box[:, :3], box[:, 3:] = np.inf, -np.inf
        for t in members:
            k = int((low[t, i] + high[t, i] - least[i]) * scale[i])
            count[k] += 1
            for j in range(3):
                box[k, j], box[k, 3 + j] = min(box[k, j], low[t, j]), max(box[k, 3 + j], high[t, j])
        # From the last bin down, then from the first up.
        for up in range(2):
            grown[:3], grown[3:], number = np.inf, -np.inf, 0
            for step in range(bins - 1):
                k = step if up else bins - 1 - step
                number += count[k]
                for j in range(3):
                    grown[j], grown[3 + j] = min(grown[j], box[k, j]), max(grown[3 + j], box[k, 3 + j])
                x, y, z = grown[3] - grown[0], grown[4] - grown[1], grown[5] - grown[2]
                cost = number * (x * y + y * z + z * x) if number else np.inf
                if not up:
                    below[k] = cost
                elif number and cost + below[k + 1] < best:
                    best, axis, at = cost + below[k + 1], i, k
    if axis < 0:
        return 0
    first = 0
    for m in range(len(members)):
        t = members[m]
        k = int((low[t, axis] + high[t, axis] - least[axis]) * scale[axis])
        side[m] = 1 if k > at else 0
        first += 1 - side[m]
    return first


@compiled
def _cut(low: Points, high: Points) -> Boxes:
    """Boxes of one or more things."""
    n = len(low)
    number, side = np.arange(n), np.empty(n, np.int64)
    box_low, box_high = np.empty((2 * n, 3)), np.empty((2 * n, 3))
    child = np.zeros((2 * n, 2), np.int64)
    # First and last of what a box holds, its parent, which half of it, and how deep it lies.
    waiting = np.empty((128, 5), np.int64)
    waiting[0, 0], waiting[0, 1], waiting[0, 2], waiting[0, 3], waiting[0, 4] = 0, n, -1, 0, 0
    depth, count = 1, 0
    while depth > 0:
        depth -= 1
        first, last, parent, which, level = waiting[depth]
        me = count
        count += 1
        for i in range(3):
            box_low[me, i], box_high[me, i] = np.inf, -np.inf
            for j in range(first, last):
                box_low[me, i] = min(box_low[me, i], low[number[j], i])
                box_high[me, i] = max(box_high[me, i], high[number[j], i])
        if parent >= 0:
            child[parent, which] = me
        if last - first <= LEAF:
            child[me, 0], child[me, 1] = -1 - first, last - first
            continue
        members = number[first:last].copy()
        # Cuts far from the middle make a tree deep: from some depth on it is halved.
        size = _best_cut(low, high, members, side[first:last]) if level < _DEEP else 0
        if size > 0:
            left, other = first, first + size
            for m in range(len(members)):
                if side[first + m] == 0:
                    number[left] = members[m]
                    left += 1
                else:
                    number[other] = members[m]
                    other += 1
        else:
            size, axis = (last - first) // 2, 0
            for i in range(3):
                if box_high[me, i] - box_low[me, i] > box_high[me, axis] - box_low[me, axis]:
                    axis = i
            centre = low[members, axis] + high[members, axis]
            number[first:last] = members[np.argsort(centre, kind="mergesort")]
        half = first + size
        waiting[depth, 0], waiting[depth, 1], waiting[depth, 2], waiting[depth, 3] = first, half, me, 0
        waiting[depth + 1, 0], waiting[depth + 1, 1] = half, last
        waiting[depth + 1, 2], waiting[depth + 1, 3] = me, 1
        waiting[depth, 4], waiting[depth + 1, 4] = level + 1, level + 1
        depth += 2
    return Boxes(box_low[:count].copy(), box_high[:count].copy(), child[:count].copy(), number)
