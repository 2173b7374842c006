"""Fast marching: the first time at which a front that leaves one cell reaches every other.

The front's speed differs from cell to cell; cells of speed zero stop it. Cells are accepted by rising time, each
from its accepted neighbours, by upwind differences of second order where two cells in a row are accepted, else
of first. Errors are about a third of a cell on open floor, from the corner of the source.

Compiled at its first use (some seconds) and cached on disk. The tests compare with eikonalfm; it is not used here
because it ends the process on Ctrl-C.

Reference: Sethian, Fast marching methods, SIAM Review 41(2), 1999.
"""

import numpy as np
from jaxtyping import Bool, Float

from robosim.support.compiled import compiled


def march(
    speed: Float[np.ndarray, "ny nx"] | Bool[np.ndarray, "ny nx"], source: tuple[int, int], cell_m: float
) -> Float[np.ndarray, "ny nx"]:
    """Time of the front's arrival at the centre of each cell.

    Args:
        speed: Speed in each cell, 0 where the front cannot go; in the source it is above 0. True is 1.
        source: Row and column of the cell that the front leaves at time 0.
        cell_m: Side of a cell [m].

    Returns:
        Times, inf where the front never comes.

    Raises:
        ValueError: If the source lies outside, or the front cannot leave it.
    """
    ny, nx = speed.shape
    row, column = source
    if not (0 <= row < ny and 0 <= column < nx):
        raise ValueError(f"source is {source}, expected a cell of the {ny} x {nx} grid.")
    if not speed[row, column] > 0:
        raise ValueError(f"The speed in the source {source} is {speed[row, column]}, expected more than 0.")
    # A rim that stops the front avoids bounds checks in the loop.
    padded = np.zeros((ny + 4, nx + 4), speed.dtype)
    padded[2:-2, 2:-2] = speed
    time = np.full(padded.shape, np.inf)
    _march(padded.ravel(), float(cell_m), time.ravel(), (row + 2) * (nx + 4) + column + 2, nx + 4)
    return time[2:-2, 2:-2]


@compiled
def _upwind(time: np.ndarray, i: int, step: int) -> tuple[float, float]:
    """Weight and time of the upwind difference along an axis; weight 0 if no neighbour is accepted."""
    before, after = time[i - step], time[i + step]
    if after < before:
        step = -step
        before = after
    if before == np.inf:
        return 0.0, 0.0
    far = time[i - 2 * step]
    if far <= before:
        return 2.25, (4.0 * before - far) / 3.0
    return 1.0, before


@compiled
def _rise(heap: np.ndarray, times: np.ndarray, place: np.ndarray, at: int) -> None:
    """Move an entry of the heap up to where its time belongs."""
    cell, time = heap[at], times[at]
    while at > 0:
        parent = (at - 1) >> 1
        if times[parent] <= time:
            break
        heap[at], times[at] = heap[parent], times[parent]
        place[heap[at]] = at
        at = parent
    heap[at], times[at] = cell, time
    place[cell] = at


@compiled
def _sink(heap: np.ndarray, times: np.ndarray, place: np.ndarray, size: int) -> None:
    """Move the heap's first entry down to where its time belongs."""
    cell, time, at = heap[0], times[0], 0
    while True:
        child = 2 * at + 1
        if child >= size:
            break
        if child + 1 < size and times[child + 1] < times[child]:
            child += 1
        if times[child] >= time:
            break
        heap[at], times[at] = heap[child], times[child]
        place[heap[at]] = at
        at = child
    heap[at], times[at] = cell, time
    place[cell] = at


@compiled
def _march(speed: np.ndarray, cell_m: float, time: np.ndarray, source: int, width: int) -> None:
    """The march on flat arrays with a rim of two cells; `time` becomes that of accepted cells, infinite at first."""
    heap = np.empty(len(time), np.int32)  # a binary heap of cells by time
    times = np.empty(len(time))  # of its entries, contiguous in memory
    place = np.full(len(time), -1, np.int32)  # where a cell stands in it
    heap[0], times[0], place[source], size = source, 0.0, 0, 1
    while size:
        here = heap[0]
        time[here] = times[0]
        size -= 1
        if size:
            heap[0], times[0] = heap[size], times[size]
            _sink(heap, times, place, size)
        for step in (-width, -1, 1, width):
            i = here + step
            if time[i] < np.inf or not speed[i] > 0:
                continue
            t = _arrival(time, cell_m / speed[i], i, width)
            if place[i] < 0:
                heap[size], place[i] = i, size
                size += 1
            elif times[place[i]] <= t:
                continue
            times[place[i]] = t
            _rise(heap, times, place, place[i])


@compiled
def _arrival(time: np.ndarray, cost: float, i: int, width: int) -> float:
    """Time of the front at a cell, from its accepted neighbours."""
    ay, ty = _upwind(time, i, width)
    ax, tx = _upwind(time, i, 1)
    # Solve ay (t - ty)^2 + ax (t - tx)^2 = cost^2 for the later t.
    a, b = ay + ax, ay * ty + ax * tx
    inside = b * b - a * (ay * ty * ty + ax * tx * tx - cost * cost)
    if inside >= 0:
        return (b + np.sqrt(inside)) / a
    # Neighbours too far apart for one plane front: it comes along one axis.
    return min(ty + cost / np.sqrt(ay), tx + cost / np.sqrt(ax))
