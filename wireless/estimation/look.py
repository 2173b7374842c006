"""The first look for a path: the best match of a residual over a grid of delays, arrivals and departures."""

import numpy as np
from jaxtyping import Complex64, Float32

from robosim.support.compiled import compiled
from wireless.estimation.residual import Layout


@compiled
def best_look(
    x: Float32[np.ndarray, "window 2 pattern"],
    layout: Layout,
    rx_grid: Complex64[np.ndarray, "rx_arrays rx_looks ports"],
    tx_grid: Complex64[np.ndarray, "tx_arrays tx_looks ports"],
) -> tuple[float, int, int, int, int]:
    """Delay in samples of the window, receive array and its look, transmit array and its look, that match best.

    Delays in the middle between samples are tried too.

    Args:
        x: The residual (`wireless.estimation.residual`).
        layout: Its order.
        rx_grid: Unit signatures of each receive array at the azimuths looked at, conjugate; 0 for none.
        tx_grid: Likewise at the transmitter.
    """
    n_rx, n_tx, rx_arrays, tx_arrays = layout
    n_late, n_looks = len(x), rx_grid.shape[1]
    wide = n_looks * n_late
    seen = np.empty((tx_arrays * n_tx, 2, wide), np.float32)
    mine = np.empty((n_rx, 2, n_tx * tx_arrays * n_late), np.float32)
    combined = np.empty((2, mine.shape[2]), np.float32)
    match = np.empty((2, wide), np.float32)
    power = np.empty(2 * wide, np.float32)
    as_whole = power.view(np.int32)
    best, best_indices = np.float32(-1.0), (0.0, 0, 0, 0, 0)
    for a in range(rx_arrays):
        for r in range(n_rx):
            for t in range(n_tx):
                for b in range(tx_arrays):
                    i = ((r * n_tx + t) * rx_arrays + a) * tx_arrays + b
                    to = (b * n_tx + t) * n_late
                    for w in range(n_late):
                        mine[r, 0, to + w], mine[r, 1, to + w] = x[w, 0, i], x[w, 1, i]
        for k in range(n_looks):
            combined[:] = 0
            for r in range(n_rx):
                real, imaginary = rx_grid[a, k, r].real, rx_grid[a, k, r].imag
                for i in range(mine.shape[2]):
                    combined[0, i] += real * mine[r, 0, i] - imaginary * mine[r, 1, i]
                    combined[1, i] += real * mine[r, 1, i] + imaginary * mine[r, 0, i]
            for t in range(len(seen)):
                for w in range(n_late):
                    seen[t, 0, k * n_late + w] = combined[0, t * n_late + w]
                    seen[t, 1, k * n_late + w] = combined[1, t * n_late + w]
        for b in range(tx_arrays):
            for j in range(tx_grid.shape[1]):
                match[:] = 0
                for t in range(n_tx):
                    real, imaginary = tx_grid[b, j, t].real, tx_grid[b, j, t].imag
                    received = seen[b * n_tx + t]
                    for i in range(wide):
                        match[0, i] += real * received[0, i] - imaginary * received[1, i]
                        match[1, i] += real * received[1, i] + imaginary * received[0, i]
                for i in range(wide):
                    power[i] = match[0, i] * match[0, i] + match[1, i] * match[1, i]
                for i in range(wide - 1):
                    re, im = match[0, i] + match[0, i + 1], match[1, i] + match[1, i + 1]
                    power[wide + i] = np.float32(0.5) * (re * re + im * im)
                # Behind the last delay of one look comes the first of the next.
                for k in range(n_looks):
                    power[wide + (k + 1) * n_late - 1] = 0
                # Numbers that are not negative are in the order of their bits, which processors compare side by side.
                largest = np.int32(-1)
                for value in as_whole:
                    largest = max(largest, value)
                if np.array([largest]).view(np.float32)[0] > best:
                    place = 0
                    while as_whole[place] != largest:
                        place += 1
                    best = power[place]
                    half = 0.5 if place >= wide else 0.0
                    place %= wide
                    best_indices = (place % n_late + half, a, place // n_late, b, j)
    return best_indices
