"""Inner loops of the likelihood estimator: detect a path, refine it, take it off, refine all in turn.

The tensor X (receive dimension, delay, transmit dimension) holds, for each pair of a receive and a transmit
array, the outer product of a path's three curves (`wireless.estimation.climb`) times a factor whose size is
that of the path and whose phase is free. Detection looks in the residual for the largest match over a grid of
arrivals and departures, at each delay and half-way between neighbours, in each pair of arrays. Refinement
climbs along delay, arrival and departure in turn with all pairs. After each new path, all are refined in turn,
each with the others taken off (space-alternating expectation maximisation), until the residual settles.
Reference: B. H. Fleury et al., Channel parameter estimation in mobile radio environments using the SAGE
algorithm, IEEE JSAC 17 (1999).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from wireless.estimation.climb import climb, place
from wireless.support.compiled import compiled

#: Most rounds of refining all paths after each new one.
ROUNDS = 60
#: A round is the last if it lowers the residual's energy by no more than this [of noise in one entry], plus
#: this share of it: close paths come apart slowly but steadily, and what no path explains stays.
SETTLED, SETTLED_SHARE = 0.05, 0.005
#: Paths beyond those asked for only have to be out of the way: this share will do, and one that has less than this
#: part of the strongest one's energy ends the search.
SETTLED_ROUGHLY, FAINT = 0.03, 1e-3


class Curves(NamedTuple):
    """What a path looks like along each coordinate, and the grid on which paths are first looked for."""

    rx: Complex[np.ndarray, "rx_nodes rx"]
    """Receive signature by azimuth."""
    tx: Complex[np.ndarray, "tx_nodes tx"]
    """Transmit signature by azimuth."""
    late: Complex[np.ndarray, "delay_nodes window"]
    """Pulse by delay."""
    rx_part: Int[np.ndarray, " rx_arrays1"]
    """Where each receive array's dimensions begin, and an end."""
    tx_part: Int[np.ndarray, " tx_arrays1"]
    """Likewise at the transmitter."""
    rx_grid: Complex[np.ndarray, "rx_arrays rx_looks ports"]
    """Unit signatures of each receive array at the azimuths first looked at, conjugate; 0 for none."""
    tx_grid: Complex[np.ndarray, "tx_arrays tx_looks ports"]
    """Likewise at the transmitter."""
    rx_start: Float[np.ndarray, "rx_arrays rx_looks"]
    """Where these lie on the curve [intervals]."""
    tx_start: Float[np.ndarray, "tx_arrays tx_looks"]
    """Likewise at the transmitter."""
    late_step: float
    """Intervals of the delay's curve to a sample."""
    late_zero: float
    """Where on the delay's curve the first delay of the window lies [intervals]."""
    rx_step: float
    """Intervals of the receive curve between azimuths first looked at."""
    tx_step: float
    """Likewise at the transmitter."""


class Scratch(NamedTuple):
    """Room for one path's curves and their slopes."""

    rx: Complex[np.ndarray, " rx"]
    tx: Complex[np.ndarray, " tx"]
    late: Complex[np.ndarray, " window"]
    rx_slope: Complex[np.ndarray, " rx"]
    tx_slope: Complex[np.ndarray, " tx"]
    late_slope: Complex[np.ndarray, " window"]


@compiled
def _detect(x: Complex[np.ndarray, "rx window tx"], curves: Curves, at: Float[np.ndarray, "3"]) -> None:
    """Delay, arrival and departure (in intervals) of the best match on the grid go to `at`."""
    n_late = x.shape[1]
    flat = x.astype(np.complex64).reshape(x.shape[0], -1)
    best = -1.0
    for a in range(len(curves.rx_part) - 1):
        seen = np.dot(curves.rx_grid[a], flat[curves.rx_part[a] : curves.rx_part[a + 1]])
        seen = seen.reshape(-1, x.shape[2])
        for b in range(len(curves.tx_part) - 1):
            part = np.ascontiguousarray(seen[:, curves.tx_part[b] : curves.tx_part[b + 1]].T)
            match = np.dot(curves.tx_grid[b], part)
            for j in range(match.shape[0]):
                for k in range(match.shape[1] // n_late):
                    row = match[j, k * n_late : (k + 1) * n_late]
                    for i in range(n_late):
                        m = row[i]
                        one = m.real**2 + m.imag**2
                        two = 0.0
                        if i < n_late - 1:
                            p = m + row[i + 1]
                            two = 0.5 * (p.real**2 + p.imag**2)
                        if max(one, two) > best:
                            best = max(one, two)
                            half = 0.5 if two > one else 0.0
                            at[0] = curves.late_zero + (i + half) * curves.late_step
                            at[1], at[2] = curves.rx_start[a, k], curves.tx_start[b, j]


@compiled
def _unit(c: Complex[np.ndarray, " dims"]) -> float:
    """One over the norm; 0 if there is none."""
    total = 0.0
    for value in c:
        total += value.real**2 + value.imag**2
    return 1 / np.sqrt(total) if total > 0 else 0.0


@compiled
def _along_late(x: Complex[np.ndarray, "rx window tx"], curves: Curves, s: Scratch) -> np.ndarray:
    """The tensor contracted with arrival and departure: one column for each pair of arrays."""
    n_late, n_tx = x.shape[1], len(curves.tx_part) - 1
    scale = _unit(s.rx) * _unit(s.tx)
    flat = x.reshape(x.shape[0], -1)
    v = np.zeros((n_late, (len(curves.rx_part) - 1) * n_tx), np.complex128)
    for a in range(len(curves.rx_part) - 1):
        # Arrival first, over all else at once: these long sums of arrays are what processors do side by side.
        seen = np.zeros(flat.shape[1], np.complex128)
        for r in range(curves.rx_part[a], curves.rx_part[a + 1]):
            weight = np.conj(s.rx[r]) * scale
            for i in range(flat.shape[1]):
                seen[i] += weight * flat[r, i]
        for w in range(n_late):
            row = seen[w * x.shape[2] : (w + 1) * x.shape[2]]
            for b in range(n_tx):
                for t in range(curves.tx_part[b], curves.tx_part[b + 1]):
                    v[w, a * n_tx + b] += np.conj(s.tx[t]) * row[t]
    return v


@compiled
def _without_late(x: Complex[np.ndarray, "rx window tx"], s: Scratch) -> Complex[np.ndarray, "rx tx"]:
    """The tensor contracted with the delay's curve of unit norm."""
    scale = _unit(s.late)
    z = np.zeros((x.shape[0], x.shape[2]), np.complex128)
    for r in range(x.shape[0]):
        for w in range(x.shape[1]):
            weight = np.conj(s.late[w]) * scale
            for t in range(x.shape[2]):
                z[r, t] += weight * x[r, w, t]
    return z


@compiled
def _contracted(
    z: Complex[np.ndarray, "dims other"], c: Complex[np.ndarray, " other"], part: Int[np.ndarray, " parts1"]
) -> Complex[np.ndarray, "dims parts"]:
    """A matrix contracted with each part of a curve, taken at unit norm."""
    scale = _unit(c)
    v = np.zeros((z.shape[0], len(part) - 1), np.complex128)
    for d in range(z.shape[0]):
        for g in range(len(part) - 1):
            for t in range(part[g], part[g + 1]):
                v[d, g] += np.conj(c[t]) * scale * z[d, t]
    return v


@compiled
def _refine(
    x: Complex[np.ndarray, "rx window tx"],
    curves: Curves,
    at: Float[np.ndarray, "3"],
    look: int,
    s: Scratch,
    size: Complex[np.ndarray, " pairs"],
) -> float:
    """Climb along delay, arrival and departure in turn; `look` steps around at first.

    Complex sizes of the path in each pair of arrays, of one absolute value, go to `size`; its energy is returned.
    """
    v = _along_late(x, curves, s)
    whole = np.array([0, x.shape[1]])
    at[0] = climb(
        curves.late, False, whole, v, at[0], 0.25 * curves.late_step, 2 * look, s.late, s.late_slope
    )
    z = _without_late(x, s)
    for again in range(2):
        n_steps = 2 * look if again == 0 else 0
        v = _contracted(z, s.tx, curves.tx_part)
        at[1] = climb(
            curves.rx, True, curves.rx_part, v, at[1], 0.25 * curves.rx_step, n_steps, s.rx, s.rx_slope
        )
        v = _contracted(z.T, s.rx, curves.rx_part)
        at[2] = climb(
            curves.tx, True, curves.tx_part, v, at[2], 0.25 * curves.tx_step, n_steps, s.tx, s.tx_slope
        )
    return _sizes(v, curves, s, size)


@compiled
def _sizes(
    v: Complex[np.ndarray, "tx rx_arrays"], curves: Curves, s: Scratch, size: Complex[np.ndarray, " pairs"]
) -> float:
    """Sizes and energy of a path, from the tensor contracted with delay and arrival at unit norm."""
    n_tx = len(curves.tx_part) - 1
    unit = _unit(s.tx)
    total = 0.0
    for i in range(len(size)):
        q = 0j
        for t in range(curves.tx_part[i % n_tx], curves.tx_part[i % n_tx + 1]):
            q += np.conj(s.tx[t]) * v[t, i // n_tx]
        q *= unit
        total += abs(q)
        size[i] = q / abs(q) if abs(q) > 0 else 0j
    norm = unit * _unit(s.late) * _unit(s.rx)
    for i in range(len(size)):
        size[i] *= total * norm
    return total * total


@compiled
def _add(
    x: Complex[np.ndarray, "rx window tx"],
    curves: Curves,
    s: Scratch,
    size: Complex[np.ndarray, " pairs"],
    sign: float,
) -> None:
    """Add a path to the tensor, or take it off."""
    n_tx = len(curves.tx_part) - 1
    flat = x.reshape(x.shape[0], -1)
    sent = np.empty((x.shape[1], x.shape[2]), np.complex128)
    for a in range(len(curves.rx_part) - 1):
        for b in range(n_tx):
            for w in range(x.shape[1]):
                factor = sign * size[a * n_tx + b] * s.late[w]
                for t in range(curves.tx_part[b], curves.tx_part[b + 1]):
                    sent[w, t] = factor * s.tx[t]
        row = sent.reshape(-1)
        for r in range(curves.rx_part[a], curves.rx_part[a + 1]):
            weight = s.rx[r]
            for i in range(len(row)):
                flat[r, i] += weight * row[i]


@compiled
def _energy(x: Complex[np.ndarray, "rx window tx"]) -> float:
    total = 0.0
    for value in x.flat:
        total += value.real**2 + value.imag**2
    return total


@compiled
def _round(
    x: Complex[np.ndarray, "rx window tx"],
    curves: Curves,
    n: int,
    at: Float[np.ndarray, "paths 3"],
    size: Complex[np.ndarray, "paths pairs"],
    energy: Float[np.ndarray, " paths"],
    s: list[Scratch],
) -> None:
    """Refine each path once with the others taken off; x is the residual before and after."""
    for p in range(n):
        _add(x, curves, s[p], size[p], 1.0)
        energy[p] = _refine(x, curves, at[p], 0, s[p], size[p])
        _add(x, curves, s[p], size[p], -1.0)


@compiled
def _settle(
    x: Complex[np.ndarray, "rx window tx"],
    curves: Curves,
    n: int,
    at: Float[np.ndarray, "paths 3"],
    size: Complex[np.ndarray, "paths pairs"],
    energy: Float[np.ndarray, " paths"],
    s: list[Scratch],
    share: float,
) -> None:
    """Refine all paths in turn until a round lowers the residual by no more than a share of it."""
    before = _energy(x)
    for _ in range(ROUNDS if n > 1 else 0):
        _round(x, curves, n, at, size, energy, s)
        after = _energy(x)
        if before - after < SETTLED + share * after:
            break
        before = after


@compiled
def _scratch(curves: Curves) -> Scratch:
    n, m, w = curves.rx.shape[1], curves.tx.shape[1], curves.late.shape[1]
    return Scratch(
        np.zeros(n, np.complex128),
        np.zeros(m, np.complex128),
        np.zeros(w, np.complex128),
        np.zeros(n, np.complex128),
        np.zeros(m, np.complex128),
        np.zeros(w, np.complex128),
    )


@compiled
def _start(curves: Curves, at: Float[np.ndarray, "3"], s: Scratch) -> None:
    """Put the curves of a path where it was detected."""
    place(curves.late, False, at[0], s.late, s.late_slope)
    place(curves.rx, True, at[1], s.rx, s.rx_slope)
    place(curves.tx, True, at[2], s.tx, s.tx_slope)


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
        curves: What paths look like.
        threshold: Energy that a path must have with all others taken off.
        wanted: Paths asked for; of further ones faint ones are not looked for.
        at: Where delay, arrival and departure of paths go, in intervals of their curves.
        energy: Where their energies go.
        seen: Where the squared norms go of their receive and transmit signatures together.
        count: Where their numbers go.
    """
    most = at.shape[1]
    pairs = (len(curves.rx_part) - 1) * (len(curves.tx_part) - 1)
    size = np.zeros((most, pairs), np.complex128)
    s = [_scratch(curves) for _ in range(most)]
    for i in range(len(tensor)):
        x = tensor[i].astype(np.complex128)
        n = 0
        while n < most:
            _detect(x, curves, at[i, n])
            _start(curves, at[i, n], s[n])
            _refine(x, curves, at[i, n], 2, s[n], size[n])
            energy[i, n] = _refine(x, curves, at[i, n], 0, s[n], size[n])
            if energy[i, n] < threshold or (n >= wanted and energy[i, n] < FAINT * energy[i, :n].max()):
                break
            _add(x, curves, s[n], size[n], -1.0)
            n += 1
            share = SETTLED_SHARE if n <= wanted else SETTLED_ROUGHLY
            _settle(x, curves, n, at[i], size, energy[i], s, share)
        count[i] = n
        for p in range(n):
            seen[i, p] = 1 / (_unit(s[p].rx) * _unit(s[p].tx)) ** 2
