"""Inner loops of the direct draw of measurements.

The window lies around the delay whose strongest cell (one receive array in one beam) has the most energy.
Delays fall in three kinds. Those where paths might make the strongest cell are drawn in full: candidates.
Those where paths are too weak to be seen are noise, independent and alike, so that only the strongest cell of
all needs to be drawn, from its exact law. At the rest paths are seen but cannot win, whatever the noise: they
are drawn only if they fall in the window. A window that lies in noise is drawn given its strongest cell.

Neglected are paths whose strongest cell is below `FAINT` of the noise's amplitude.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from robosim.support.compiled import compiled

#: Amplitude [of the noise] of the strongest cell below which a path cannot be seen at a delay.
FAINT = 0.2
#: Amplitude over noise below which a path is left out altogether.
NOTHING = 1e-3
#: Delays before and after paths that are looked at one by one.
MARGIN = 8


class Candidates(NamedTuple):
    """Delays that are looked at one by one."""

    first: Int[np.ndarray, " links"]
    """Delay of the first of them."""
    kind: Int[np.ndarray, "links zone"]
    """0 for beyond the last, or noise; 1 for seen but too weak to win; 2 for candidates."""
    n_noise: Int[np.ndarray, " links"]
    """Number of delays that are noise; 0 if noise cannot win."""


@compiled
def _pulse(x: float, n: int) -> complex:
    """Periodic sinc: the waveform's correlation with itself."""
    turn = np.sin(np.pi * x / n)
    size = 1.0 if abs(turn) < 1e-12 else np.sin(np.pi * x) / (n * turn)
    return size * np.exp(-1j * np.pi * x / n)


@compiled
def _signal(
    delay: float,
    tau: Float[np.ndarray, " rays"],
    reach: Float[np.ndarray, " rays"],
    a: Complex[np.ndarray, "rays n_basis"],
    b: Complex[np.ndarray, "rays beams"],
    n: int,
) -> Complex[np.ndarray, "n_basis beams"]:
    """Return the contribution of paths at a delay."""
    shifted = np.zeros((a.shape[1], len(tau)), np.complex64)
    for p in range(len(tau)):
        if reach[p] > NOTHING:
            size = _pulse(delay - tau[p], n)
            for r in range(a.shape[1]):
                shifted[r, p] = a[p, r] * size
    return np.dot(shifted, b)


@compiled
def _strongest(cells: Complex[np.ndarray, "n_basis beams"], ports: int) -> float:
    """Energy of the strongest cell."""
    best = 0.0
    for first in range(0, cells.shape[0], ports):
        for k in range(cells.shape[1]):
            energy = 0.0
            for r in range(first, first + ports):
                energy += cells[r, k].real ** 2 + cells[r, k].imag ** 2
            best = max(best, energy)
    return best


@compiled
def find_candidates(
    tau: Float[np.ndarray, "links rays"],
    reach: Float[np.ndarray, "links rays"],
    a: Complex[np.ndarray, "links rays n_basis"],
    b: Complex[np.ndarray, "links rays beams"],
    ports: int,
    noise_reach: float,
    n: int,
) -> Candidates:
    """Which delays paths may win at, be seen at, or leave to noise."""
    longest = 0.0
    for i in range(len(tau)):
        least, largest = np.inf, -np.inf
        for p in range(tau.shape[1]):
            if reach[i, p] > NOTHING:
                least, largest = min(least, tau[i, p]), max(largest, tau[i, p])
        longest = max(longest, largest - least)
    zone = min(int(longest) + 2 * MARGIN + 3, n)
    first, n_noise = np.zeros(len(tau), np.int64), np.zeros(len(tau), np.int64)
    kind, bound = np.zeros((len(tau), zone), np.int64), np.empty(zone)
    for i in range(len(tau)):
        last = -1
        n_noise[i] = n
        for p in range(tau.shape[1]):
            if reach[i, p] > NOTHING:
                low, high = int(np.floor(tau[i, p])) - MARGIN, int(np.ceil(tau[i, p])) + MARGIN
                first[i] = low if last < first[i] else min(first[i], low)
                last = max(last, high)
        size = min(last - first[i] + 1, kind.shape[1])
        if size <= 0:
            continue
        for j in range(size):
            bound[j] = 0.0
            for p in range(tau.shape[1]):
                if reach[i, p] > NOTHING:
                    bound[j] += reach[i, p] * abs(_pulse(first[i] + j - tau[i, p], n))
        top = first[i] + np.argmax(bound[:size])
        sure = np.sqrt(_strongest(_signal(top, tau[i], reach[i], a[i], b[i], n), ports)) - noise_reach
        for j in range(size):
            if bound[j] + noise_reach >= sure and bound[j] > FAINT:
                kind[i, j] = 2
            elif bound[j] > FAINT:
                kind[i, j] = 1
            if kind[i, j] > 0:
                n_noise[i] -= 1
        if sure > noise_reach:
            n_noise[i] = 0
    return Candidates(first, kind, n_noise)


@compiled
def _copy(cells: Complex[np.ndarray, "n_basis beams"], to: Complex[np.ndarray, "n_basis beams"]) -> None:
    """Copy an array into another; `to[:] = cells` would compile a message for shapes that differ, too."""
    for r in range(cells.shape[0]):
        for k in range(cells.shape[1]):
            to[r, k] = cells[r, k]


@compiled
def _add_noise(cells: Complex[np.ndarray, "n_basis beams"], rng: np.random.Generator) -> None:
    """Add white noise of unit variance."""
    for r in range(cells.shape[0]):
        for k in range(cells.shape[1]):
            noise = complex(rng.standard_normal(), rng.standard_normal())
            cells[r, k] += np.complex64(np.sqrt(0.5) * noise)


@compiled
def _noise_below(
    cells: Complex[np.ndarray, "n_basis beams"], ports: int, limit: float, rng: np.random.Generator
) -> None:
    """Fill with noise, given that no cell exceeds an energy."""
    cells[:] = 0
    _add_noise(cells, rng)
    if _strongest(cells, ports) <= limit:
        return
    for first in range(0, cells.shape[0], ports):
        for k in range(cells.shape[1]):
            cell = cells[first : first + ports, k : k + 1]
            while _strongest(cell, ports) > limit:
                cell[:] = 0
                _add_noise(cell, rng)


@compiled
def _window_in_noise(
    out: Complex[np.ndarray, "window n_basis beams"], ports: int, rival: float, rng: np.random.Generator
) -> None:
    """A window around the strongest cell of noise, whose energy is given."""
    for w in range(len(out)):
        _noise_below(out[w], ports, rival, rng)
    first = ports * rng.integers(0, out.shape[1] // ports)
    k = rng.integers(0, out.shape[2])
    cell = out[len(out) // 2, first : first + ports, k : k + 1]
    cell[:] = 0
    _add_noise(cell, rng)
    cell *= np.float32(np.sqrt(rival / _strongest(cell, ports)))


@compiled
def draw_windows(
    tau: Float[np.ndarray, "links rays"],
    reach: Float[np.ndarray, "links rays"],
    a: Complex[np.ndarray, "links rays n_basis"],
    b: Complex[np.ndarray, "links rays beams"],
    ports: int,
    rival: Float[np.ndarray, " links"],
    candidates: Candidates,
    n: int,
    rng: np.random.Generator,
    out: Complex[np.ndarray, "links window n_basis beams"],
) -> None:
    """Draw the windows of links into place; arguments as of `find_candidates`, and what it found.

    Args:
        tau: Delays of paths.
        reach: Amplitude of each path's strongest cell.
        a: Amplitudes of paths at the receiver.
        b: Responses of the beams.
        ports: Dimensions of one receive array.
        rival: Energy of the strongest cell of all delays that are noise; 0 for none.
        candidates: Delays that are looked at.
        n: Samples of the waveform.
        rng: Source of noise.
        out: Where windows go.
    """
    half, (first, kind, n_noise) = out.shape[1] // 2, candidates
    zone = kind.shape[1]
    for i in range(len(tau)):
        top, best = -1, rival[i]
        n_candidates = 0
        for j in range(zone):
            if kind[i, j] == 2:
                n_candidates += 1
        drawn = np.empty((n_candidates, out.shape[2], out.shape[3]), np.complex64)
        place = np.full(zone, -1, np.int64)
        n_drawn = 0
        for j in range(zone):
            if kind[i, j] == 2:
                _copy(_signal(first[i] + j, tau[i], reach[i], a[i], b[i], n), drawn[n_drawn])
                _add_noise(drawn[n_drawn], rng)
                energy = _strongest(drawn[n_drawn], ports)
                place[j] = n_drawn
                n_drawn += 1
                if energy > best:
                    top, best = j, energy
        if top < 0:
            _window_in_noise(out[i], ports, best, rng)
            continue
        for w in range(out.shape[1]):
            j = top + w - half
            inside = 0 <= j < zone
            if inside and place[j] >= 0:
                _copy(drawn[place[j]], out[i, w])
            elif inside and kind[i, j] == 0 and n_noise[i] > 0:
                _noise_below(out[i, w], ports, best, rng)
            else:
                _copy(_signal(first[i] + j, tau[i], reach[i], a[i], b[i], n), out[i, w])
                _add_noise(out[i, w], rng)
