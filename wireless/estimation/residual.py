"""Residual of a measurement after paths are subtracted, and its products with their curves.

These sums run over the whole tensor for each path again and again, so it is laid out as processors want it: real and
imaginary parts apart, in the precision of the measurement itself, delay by delay; at each delay ports of the receiver,
ports of the transmitter, receive arrays, transmit arrays, the last fastest. A path is then the product of its pulse
(complex, one number a delay) and its pattern (all the rest): signatures of both ends times the size that it has in each
pair of arrays.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float32

from robosim.support.compiled import compiled

#: A measurement as `laid_out` makes it.
Tensor = Float32[np.ndarray, "window 2 pattern"]
#: One delay of it.
Pattern = Float32[np.ndarray, "2 pattern"]
#: The signature of a delay.
Pulse = Complex[np.ndarray, " window"]


class Layout(NamedTuple):
    """How many numbers of each kind a tensor has."""

    rx_ports: int
    """Ports of a receive array, as far as level waves excite them."""
    tx_ports: int
    """Likewise at the transmitter."""
    rx_arrays: int
    tx_arrays: int


@compiled
def laid_out(tensor: Complex[np.ndarray, "rx window tx"], layout: Layout) -> Tensor:
    """A measurement in the order above; its own dimensions are array by array, there port by port."""
    n_rx, n_tx, rx_arrays, tx_arrays = layout
    x = np.empty((tensor.shape[1], 2, tensor.shape[0] * tensor.shape[2]), np.float32)
    for w in range(tensor.shape[1]):
        i = 0
        for r in range(n_rx):
            for t in range(n_tx):
                for a in range(rx_arrays):
                    for b in range(tx_arrays):
                        value = tensor[a * n_rx + r, w, b * n_tx + t]
                        x[w, 0, i], x[w, 1, i] = value.real, value.imag
                        i += 1
    return x


@compiled
def pattern_of(
    rx: Complex[np.ndarray, " rx"],
    tx: Complex[np.ndarray, " tx"],
    size: Complex[np.ndarray, " pairs"],
    layout: Layout,
    pattern: Pattern,
) -> None:
    """Signatures of both ends times the size in each pair of arrays go to `pattern`."""
    n_rx, n_tx, rx_arrays, tx_arrays = layout
    i = 0
    for r in range(n_rx):
        for t in range(n_tx):
            for a in range(rx_arrays):
                for b in range(tx_arrays):
                    c, d = rx[a * n_rx + r], tx[b * n_tx + t] * size[a * tx_arrays + b]
                    pattern[0, i] = c.real * d.real - c.imag * d.imag
                    pattern[1, i] = c.real * d.imag + c.imag * d.real
                    i += 1


@compiled
def along_late(
    x: Tensor, pattern: Pattern, late: Pulse, inside: bool, pairs: int
) -> Complex[np.ndarray, "window pairs"]:
    """The tensor contracted with a pattern: one column for each pair of arrays."""
    square = _square(pattern)
    scale = 1 / np.sqrt(square) if square > 0 else 0.0
    v = np.empty((len(x), pairs), np.complex128)
    energy = np.zeros(pairs)
    real, imaginary = np.empty(x.shape[2], np.float32), np.empty(x.shape[2], np.float32)
    if inside:
        for i in range(0, x.shape[2], pairs):
            for p in range(pairs):
                energy[p] += float(pattern[0, i + p]) ** 2 + float(pattern[1, i + p]) ** 2
    for w in range(len(x)):
        for i in range(x.shape[2]):
            real[i] = pattern[0, i] * x[w, 0, i] + pattern[1, i] * x[w, 1, i]
            imaginary[i] = pattern[0, i] * x[w, 1, i] - pattern[1, i] * x[w, 0, i]
        n = x.shape[2]
        # Ports are added by halves as long as there are two: long sums of arrays once more.
        while n % (2 * pairs) == 0 and n > 4 * pairs:
            n //= 2
            for i in range(n):
                real[i] += real[n + i]
                imaginary[i] += imaginary[n + i]
        for p in range(pairs):
            re, im = late[w].real * energy[p], late[w].imag * energy[p]
            for i in range(p, n, pairs):
                re += real[i]
                im += imaginary[i]
            v[w, p] = complex(re * scale, im * scale)
    return v


@compiled
def without_late(x: Tensor, late: Pulse, pattern: Pattern, pulse: Pulse, inside: bool) -> Pattern:
    """The tensor contracted with a pulse of unit norm."""
    z = np.zeros((2, x.shape[2]), np.float32)
    total, common = 0.0, 0j
    for w in range(len(x)):
        total += late[w].real ** 2 + late[w].imag ** 2
        common += np.conj(late[w]) * pulse[w]
    scale = 1 / np.sqrt(total) if total > 0 else 0.0
    for w in range(len(x)):
        real, imaginary = np.float32(late[w].real * scale), np.float32(late[w].imag * scale)
        for i in range(x.shape[2]):
            z[0, i] += real * x[w, 0, i] + imaginary * x[w, 1, i]
            z[1, i] += real * x[w, 1, i] - imaginary * x[w, 0, i]
    if inside:
        real, imaginary = np.float32(common.real * scale), np.float32(common.imag * scale)
        for i in range(x.shape[2]):
            z[0, i] += real * pattern[0, i] - imaginary * pattern[1, i]
            z[1, i] += real * pattern[1, i] + imaginary * pattern[0, i]
    return z


@compiled
def take_off(x: Tensor, late: Pulse, pattern: Pattern) -> None:
    """Take a path off the tensor."""
    for w in range(len(x)):
        real, imaginary = np.float32(late[w].real), np.float32(late[w].imag)
        for i in range(x.shape[2]):
            x[w, 0, i] -= real * pattern[0, i] - imaginary * pattern[1, i]
            x[w, 1, i] -= real * pattern[1, i] + imaginary * pattern[0, i]


@compiled
def exchange(x: Tensor, late: Pulse, pattern: Pattern, new_late: Pulse, new_pattern: Pattern) -> None:
    """Put a path back and take off what it has become."""
    for w in range(len(x)):
        real, imaginary = np.float32(late[w].real), np.float32(late[w].imag)
        new_real, new_imaginary = np.float32(new_late[w].real), np.float32(new_late[w].imag)
        for i in range(x.shape[2]):
            back = real * pattern[0, i] - imaginary * pattern[1, i]
            off = new_real * new_pattern[0, i] - new_imaginary * new_pattern[1, i]
            x[w, 0, i] += back - off
            back = real * pattern[1, i] + imaginary * pattern[0, i]
            off = new_real * new_pattern[1, i] + new_imaginary * new_pattern[0, i]
            x[w, 1, i] += back - off


@compiled
def energy_of(x: Tensor) -> float:
    """Squares of all numbers, added."""
    sums = np.zeros(x.shape[2], np.float32)
    for w in range(len(x)):
        for i in range(x.shape[2]):
            sums[i] += x[w, 0, i] * x[w, 0, i] + x[w, 1, i] * x[w, 1, i]
    total = 0.0
    for value in sums:
        total += float(value)
    return total


@compiled
def _square(pattern: Pattern) -> float:
    total = 0.0
    for row in pattern:
        for value in row:
            total += float(value) * float(value)
    return total
