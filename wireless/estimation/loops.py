"""Inner loops of the likelihood estimator: detect a path, refine it, take it off, refine all in turn.

The tensor X (receive dimension, delay, transmit dimension) holds, for each pair of a receive and a transmit
array, the outer product of a path's three curves (`wireless.estimation.climb`) times a factor whose size is
that of the path and whose phase is free. Detection looks in the residual for the largest match over a grid of
arrivals and departures, at each delay and in the middle between neighbours, in each pair of arrays. Refinement
climbs along delay, arrival and departure in turn with all pairs. After each new path, all are refined in turn,
each with the others taken off (space-alternating expectation maximisation), until the residual settles.
Reference: B. H. Fleury et al., Channel parameter estimation in mobile radio environments using the SAGE
algorithm, IEEE JSAC 17 (1999).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Float32, Int

from robosim.support.compiled import compiled
from wireless.estimation.climb import Curve, Spot, climb, place
from wireless.estimation.look import best_look
from wireless.estimation.residual import (
    Layout,
    along_late,
    energy_of,
    exchange,
    laid_out,
    pattern_of,
    take_off,
    without_late,
)

#: Most rounds of refining all paths after each new one.
ROUNDS = 60
#: A round is the last if it lowers the residual's energy by no more than this [of noise in one entry], plus
#: this share of it: close paths come apart slowly but steadily, and what no path explains stays.
SETTLED, SETTLED_SHARE = 0.05, 0.005
#: Share for paths beyond the requested number, which only must not disturb the others; a path with less than this
#: part of the strongest path's energy ends the search.
SETTLED_ROUGHLY, FAINT = 0.03, 1e-3


class Curves(NamedTuple):
    """Signatures of a path along each coordinate, and the grid on which paths are first looked for."""

    rx: Curve
    """Receive signature by azimuth, array by array."""
    tx: Curve
    """Transmit signature by azimuth, array by array."""
    late: Curve
    """Pulse by delay."""
    rx_grid: Complex[np.ndarray, "rx_arrays rx_looks ports"]
    """Unit signatures of each receive array at the azimuths first looked at, conjugate; 0 for none."""
    tx_grid: Complex[np.ndarray, "tx_arrays tx_looks ports"]
    """Likewise at the transmitter."""
    rx_start: Float[np.ndarray, "rx_arrays rx_looks"]
    """Where these lie on the curve [intervals]."""
    tx_start: Float[np.ndarray, "tx_arrays tx_looks"]
    """Likewise at the transmitter."""
    layout: Layout
    """Numbers of ports and arrays."""
    late_step: float
    """Intervals of the delay's curve to a sample."""
    late_zero: float
    """Where on the delay's curve the first delay of the window lies [intervals]."""


class Scratch(NamedTuple):
    """Room for one path: where it is on its curves, its pattern, and both before it was refined."""

    rx: Spot
    tx: Spot
    late: Spot
    old_late: Complex[np.ndarray, " window"]
    pattern: Float32[np.ndarray, "2 pattern"]
    old_pattern: Float32[np.ndarray, "2 pattern"]


@compiled
def _detect(x: Float32[np.ndarray, "window 2 pattern"], curves: Curves, at: Float[np.ndarray, "3"]) -> None:
    """Delay, arrival and departure (in intervals) of the best match on the grid go to `at`."""
    late, a, k, b, j = best_look(x, curves.layout, curves.rx_grid, curves.tx_grid)
    at[0] = curves.late_zero + late * curves.late_step
    at[1], at[2] = curves.rx_start[a, k], curves.tx_start[b, j]


@compiled
def _unit(c: Complex[np.ndarray, " dims"]) -> float:
    """Return the inverse of the norm; 0 for a zero vector."""
    total = 0.0
    for value in c:
        total += value.real**2 + value.imag**2
    return 1 / np.sqrt(total) if total > 0 else 0.0


@compiled
def _by_arrival(
    z: Float32[np.ndarray, "2 pattern"], tx: Complex[np.ndarray, " tx"], layout: Layout
) -> Complex[np.ndarray, "rx tx_arrays"]:
    """A pattern contracted with the departure of unit norm: one column for each transmit array."""
    n_rx, n_tx, rx_arrays, tx_arrays = layout
    v = np.empty((rx_arrays * n_rx, tx_arrays), np.complex128)
    scale, pairs = _unit(tx), rx_arrays * tx_arrays
    for r in range(n_rx):
        for a in range(rx_arrays):
            for b in range(tx_arrays):
                i = r * n_tx * pairs + a * tx_arrays + b
                re, im = 0.0, 0.0
                for t in range(b * n_tx, (b + 1) * n_tx):
                    c, z_re, z_im = tx[t], z[0, i], z[1, i]
                    re += c.real * z_re + c.imag * z_im
                    im += c.real * z_im - c.imag * z_re
                    i += pairs
                v[a * n_rx + r, b] = complex(re * scale, im * scale)
    return v


@compiled
def _by_departure(
    z: Float32[np.ndarray, "2 pattern"], rx: Complex[np.ndarray, " rx"], layout: Layout
) -> Complex[np.ndarray, "tx rx_arrays"]:
    """A pattern contracted with the arrival of unit norm: one column for each receive array."""
    n_rx, n_tx, rx_arrays, tx_arrays = layout
    v = np.empty((tx_arrays * n_tx, rx_arrays), np.complex128)
    scale, pairs = _unit(rx), rx_arrays * tx_arrays
    for t in range(n_tx):
        for a in range(rx_arrays):
            for b in range(tx_arrays):
                i = t * pairs + a * tx_arrays + b
                re, im = 0.0, 0.0
                for r in range(a * n_rx, (a + 1) * n_rx):
                    c, z_re, z_im = rx[r], z[0, i], z[1, i]
                    re += c.real * z_re + c.imag * z_im
                    im += c.real * z_im - c.imag * z_re
                    i += n_tx * pairs
                v[b * n_tx + t, a] = complex(re * scale, im * scale)
    return v


@compiled
def _refine(
    x: Float32[np.ndarray, "window 2 pattern"],
    curves: Curves,
    at: Float[np.ndarray, "3"],
    look: int,
    s: Scratch,
    size: Complex[np.ndarray, " pairs"],
    inside: bool,
) -> float:
    """Climb along delay, arrival and departure in turn; `look` steps around at first."""
    # Complex sizes of the path in each pair of arrays, of one absolute value, go to `size`; its energy is returned. A
    # path that is `inside` is off the tensor, and counts as in it.
    late = s.late.point
    v = along_late(x, s.pattern, late, inside, len(size))
    for k in range(len(late)):
        s.old_late[k] = late[k]
    at[0] = climb(curves.late, v, at[0], 2 * look, s.late)
    z = without_late(x, late, s.pattern, s.old_late, inside)
    for again in range(2):
        n_steps = 2 * look if again == 0 else 0
        v = _by_arrival(z, s.tx.point, curves.layout)
        at[1] = climb(curves.rx, v, at[1], n_steps, s.rx)
        v = _by_departure(z, s.rx.point, curves.layout)
        at[2] = climb(curves.tx, v, at[2], n_steps, s.tx)
    energy = _sizes(v, curves, s, size)
    # Number by number: for rows numba would compile a message for shapes that differ, too.
    for k in range(s.pattern.shape[1]):
        s.old_pattern[0, k], s.old_pattern[1, k] = s.pattern[0, k], s.pattern[1, k]
    pattern_of(s.rx.point, s.tx.point, size, curves.layout, s.pattern)
    return energy


@compiled
def _sizes(
    v: Complex[np.ndarray, "tx rx_arrays"], curves: Curves, s: Scratch, size: Complex[np.ndarray, " pairs"]
) -> float:
    """Sizes and energy of a path, from the tensor contracted with delay and arrival at unit norm."""
    n_tx, ports = curves.layout.tx_arrays, curves.layout.tx_ports
    unit = _unit(s.tx.point)
    total = 0.0
    for i in range(len(size)):
        q = 0j
        for t in range(i % n_tx * ports, (i % n_tx + 1) * ports):
            q += np.conj(s.tx.point[t]) * v[t, i // n_tx]
        q *= unit
        total += abs(q)
        size[i] = q / abs(q) if abs(q) > 0 else 0j
    norm = unit * _unit(s.late.point) * _unit(s.rx.point)
    for i in range(len(size)):
        size[i] *= total * norm
    return total * total


@compiled
def _round(
    x: Float32[np.ndarray, "window 2 pattern"],
    curves: Curves,
    n: int,
    at: Float[np.ndarray, "paths 3"],
    size: Complex[np.ndarray, "paths pairs"],
    energy: Float[np.ndarray, " paths"],
    s: list[Scratch],
) -> None:
    """Refine each path once with the others taken off; x is the residual before and after."""
    for p in range(n):
        energy[p] = _refine(x, curves, at[p], 0, s[p], size[p], True)
        exchange(x, s[p].old_late, s[p].old_pattern, s[p].late.point, s[p].pattern)


@compiled
def _settle(
    x: Float32[np.ndarray, "window 2 pattern"],
    curves: Curves,
    n: int,
    at: Float[np.ndarray, "paths 3"],
    size: Complex[np.ndarray, "paths pairs"],
    energy: Float[np.ndarray, " paths"],
    s: list[Scratch],
    share: float,
) -> None:
    """Refine all paths in turn until a round lowers the residual by no more than a share of it."""
    before = energy_of(x)
    for _ in range(ROUNDS if n > 1 else 0):
        _round(x, curves, n, at, size, energy, s)
        after = energy_of(x)
        if before - after < SETTLED + share * after:
            break
        before = after


@compiled
def _scratch(curves: Curves) -> Scratch:
    n, m, w = curves.rx.table.shape[1], curves.tx.table.shape[1], curves.late.table.shape[1]
    return Scratch(
        Spot(np.zeros(n, np.complex128), np.zeros(n, np.complex128)),
        Spot(np.zeros(m, np.complex128), np.zeros(m, np.complex128)),
        Spot(np.zeros(w, np.complex128), np.zeros(w, np.complex128)),
        np.zeros(w, np.complex128),
        np.zeros((2, n * m), np.float32),
        np.zeros((2, n * m), np.float32),
    )


@compiled
def _start(curves: Curves, at: Float[np.ndarray, "3"], s: Scratch) -> None:
    """Put the curves of a path where it was detected."""
    alike = np.ones(curves.layout.rx_arrays * curves.layout.tx_arrays, np.complex128)
    place(curves.late, at[0], s.late)
    place(curves.rx, at[1], s.rx)
    place(curves.tx, at[2], s.tx)
    pattern_of(s.rx.point, s.tx.point, alike, curves.layout, s.pattern)


@compiled
def _most(energy: Float[np.ndarray, " paths"]) -> float:
    """The largest of at least one."""
    largest = energy[0]
    for value in energy:
        largest = max(largest, value)
    return largest


@compiled
def find_paths(
    tensor: Complex[np.ndarray, "links rx window tx"],
    curves: Curves,
    threshold: float,
    wanted: int,
    at: Float[np.ndarray, "links paths 3"],
    energy: Float[np.ndarray, "links paths"],
    seen: Float[np.ndarray, "links paths"],
    count: Int[np.ndarray, " links"],
) -> None:
    """Paths of links, in the order found.

    Args:
        tensor: Measurements in the dimensions of the curves.
        curves: Signatures of paths.
        threshold: Energy that a path must have with all others taken off.
        wanted: Requested number of paths; further ones that are faint are not searched for.
        at: Where delay, arrival and departure of paths go, in intervals of their curves.
        energy: Where their energies go.
        seen: Where the squared norms go of their receive and transmit signatures together.
        count: Where their numbers go.
    """
    n_max = at.shape[1]
    size = np.zeros((n_max, curves.layout.rx_arrays * curves.layout.tx_arrays), np.complex128)
    s = [_scratch(curves) for _ in range(n_max)]
    for i in range(len(tensor)):
        x = laid_out(tensor[i], curves.layout)
        n = 0
        while n < n_max:
            _detect(x, curves, at[i, n])
            _start(curves, at[i, n], s[n])
            _refine(x, curves, at[i, n], 2, s[n], size[n], False)
            energy[i, n] = _refine(x, curves, at[i, n], 0, s[n], size[n], False)
            if energy[i, n] < threshold or (n >= wanted and energy[i, n] < FAINT * _most(energy[i, :n])):
                break
            take_off(x, s[n].late.point, s[n].pattern)
            n += 1
            share = SETTLED_SHARE if n <= wanted else SETTLED_ROUGHLY
            _settle(x, curves, n, at[i], size, energy[i], s, share)
        count[i] = n
        for p in range(n):
            seen[i, p] = 1 / (_unit(s[p].rx.point) * _unit(s[p].tx.point)) ** 2
