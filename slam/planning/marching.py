"""Fast marching: the first time at which a front that leaves one cell reaches every other.

The front's speed differs from cell to cell; cells of speed zero stop it. Cells are accepted by rising time, each
from its accepted neighbours, by upwind differences of second order where two cells in a row are accepted, else
of first. Errors are about a third of a cell on open floor, from the corner of the source.

Compiled at its first use (some seconds) and cached on disk. The tests compare with eikonalfm; it is not used here
because it ends the process on Ctrl-C.

Reference: Sethian, Fast marching methods, SIAM Review 41(2), 1999.
"""

import numpy as np
from jaxtyping import Bool, Float, UInt32

from robosim.support.compiled import compiled

#: Places of cells that are not in the heap: not reached yet, and accepted or of no speed.
_AHEAD, _CLOSED = -1, -2
#: Indices are unsigned: numba checks signed ones for negative values at each access.
ZERO, ONE, TWO = (np.uint64(value) for value in (0, 1, 2))


def march(
    speed: Float[np.ndarray, "ny nx"] | Bool[np.ndarray, "ny nx"],
    source: tuple[int, int],
    cell_m: float,
    order: UInt32[np.ndarray, " cells"] | None = None,
) -> Float[np.ndarray, "ny nx"]:
    """Time of the front's arrival at the centre of each cell.

    Args:
        speed: Speed in each cell, 0 where the front cannot go; in the source it is above 0. True is 1.
        source: Row and column of the cell that the front leaves at time 0.
        cell_m: Side of a cell [m].
        order: Takes the flat indices of the cells of finite times, by rising time and then by index, if given.

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
    time, width = np.full(padded.shape, np.inf), nx + 4
    start = (row + 2) * width + column + 2
    accepted = np.empty(0, np.uint32) if order is None else order
    _march(padded.ravel(), float(cell_m), time.ravel(), start, np.uint64(width), accepted)
    accepted -= 4 * (accepted // width) + 2 * nx + 2  # without the rim
    return time[2:-2, 2:-2]


@compiled
def _upwind(time: np.ndarray, i: np.uint64, step: np.uint64) -> tuple[float, float]:
    """Weight and time of the upwind difference along an axis; weight 0 if no neighbour is accepted."""
    before, after = time[i - step], time[i + step]
    if after < before:
        before, far = after, time[i + TWO * step]
    elif before < np.inf:
        far = time[i - TWO * step]
    else:
        return 0.0, 0.0
    if far <= before:
        return 2.25, (4.0 * before - far) / 3.0
    return 1.0, before


@compiled
def _rise(
    heap: np.ndarray, times: np.ndarray, place: np.ndarray, at: np.uint64, cell: np.uint64, time: float
) -> None:
    """Put a cell into the heap at an entry, or above it where its time belongs."""
    while at > ZERO:
        parent = (at - ONE) >> ONE
        if times[parent] <= time:
            break
        heap[at], times[at] = heap[parent], times[parent]
        place[heap[at]] = at
        at = parent
    heap[at], times[at] = cell, time
    place[cell] = at


@compiled
def _sink(heap: np.ndarray, times: np.ndarray, place: np.ndarray, size: np.uint64) -> None:
    """Put the entry behind the heap's last one into the place of the first, or below it where its time belongs."""
    cell, time, at, child = heap[size], times[size], ZERO, ONE
    times[size] = np.inf
    while child < size:
        # A sum instead of a branch, which no processor can predict.
        child += np.uint64(times[child + ONE] < times[child])
        if times[child] >= time:
            break
        heap[at], times[at] = heap[child], times[child]
        place[heap[at]] = at
        at = child
        child = TWO * at + ONE
    heap[at], times[at] = cell, time
    place[cell] = at


@compiled
def _march(
    speed: np.ndarray, cell_m: float, time: np.ndarray, source: int, width: np.uint64, accepted: np.ndarray
) -> None:
    """The march on flat arrays with a rim of two cells; `time` becomes that of accepted cells, infinite at first.

    These cells go to `accepted` by time, and by index where times are equal, unless it is empty.
    """
    heap = np.empty(len(time), np.uint32)  # a binary heap of cells by time
    times = np.empty(len(time))  # of its entries, contiguous in memory
    place = np.empty(len(time), np.int32)  # where a cell stands in it
    for k in range(len(time)):
        place[k] = _AHEAD if speed[k] > 0 else _CLOSED
    heap[0], times[0], place[source], size, count = source, 0.0, 0, ONE, 0
    while size > ZERO:
        here, now, at = np.uint64(heap[0]), times[0], count
        time[here], place[here] = now, _CLOSED
        # By differences of second order a cell may be a little earlier than those before it.
        while at > 0:
            before = accepted[at - 1]
            if time[before] < now or (time[before] == now and before < here):
                break
            accepted[at] = before
            at -= 1
        if len(accepted):
            accepted[at] = here
            count += 1
        size -= ONE
        if size > ZERO:
            _sink(heap, times, place, size)
        for i in (here - width, here - ONE, here + ONE, here + width):
            entry = place[i]
            if entry == _CLOSED:
                continue
            t = _arrival(time, cell_m / speed[i], i, width)
            if entry == _AHEAD:
                _rise(heap, times, place, size, i, t)
                size += ONE
            elif t < times[entry]:
                _rise(heap, times, place, np.uint64(entry), i, t)


@compiled
def _arrival(time: np.ndarray, cost: float, i: np.uint64, width: np.uint64) -> float:
    """Time of the front at a cell, from its accepted neighbours."""
    ay, ty = _upwind(time, i, width)
    ax, tx = _upwind(time, i, ONE)
    # Solve ay (t - ty)^2 + ax (t - tx)^2 = cost^2 for the later t.
    a, b = ay + ax, ay * ty + ax * tx
    inside = b * b - a * (ay * ty * ty + ax * tx * tx - cost * cost)
    if inside >= 0:
        return (b + np.sqrt(inside)) / a
    # Neighbours too far apart for one plane front: it comes along one axis.
    return min(ty + cost / np.sqrt(ay), tx + cost / np.sqrt(ax))
