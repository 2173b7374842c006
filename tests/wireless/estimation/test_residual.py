"""The estimator's passes over a residual, compared with plain sums in double precision."""

import numpy as np
import pytest

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

#: Ports and arrays that differ in all four numbers, so that none can be mistaken for another.
LAYOUT = Layout(rx_ports=4, tx_ports=3, rx_arrays=2, tx_arrays=5)
WINDOW = 7
#: Single precision, over sums of a hundred numbers.
BOUND = 2e-6


def drawn(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


@pytest.fixture
def path(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Curves of a path at receiver, transmitter and over delay, and its sizes in pairs of arrays."""
    n_rx, n_tx = LAYOUT.rx_ports * LAYOUT.rx_arrays, LAYOUT.tx_ports * LAYOUT.tx_arrays
    return (
        drawn(rng, n_rx),
        drawn(rng, n_tx),
        drawn(rng, WINDOW),
        drawn(rng, LAYOUT.rx_arrays * LAYOUT.tx_arrays),
    )


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def whole(path: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """The tensor of a path alone: receive dimension, delay, transmit dimension."""
    rx, tx, late, size = path
    sizes = size.reshape(LAYOUT.rx_arrays, LAYOUT.tx_arrays)
    sizes = sizes.repeat(LAYOUT.rx_ports, axis=0).repeat(LAYOUT.tx_ports, axis=1)
    return np.einsum("r,w,t,rt->rwt", rx, late, tx, sizes)


def pattern(path: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    rx, tx, _, size = path
    out = np.empty((2, len(rx) * len(tx)), np.float32)
    pattern_of(rx, tx, size, LAYOUT, out)
    return out


def close(found: np.ndarray, expected: np.ndarray) -> None:
    assert np.abs(found - expected).max() < BOUND * np.abs(expected).max()


def test_a_path_is_its_pulse_times_its_pattern(path):
    real, imaginary = pattern(path)
    x = laid_out(whole(path), LAYOUT)
    close(x[:, 0] + 1j * x[:, 1], path[2][:, None] * (real + 1j * imaginary))


def test_contractions_agree_with_plain_sums(path, rng):
    rx, tx, late, size = path
    tensor = drawn(rng, len(rx), WINDOW, len(tx))
    x, own = laid_out(tensor, LAYOUT), pattern(path)
    parts = tensor.reshape(LAYOUT.rx_arrays, LAYOUT.rx_ports, WINDOW, LAYOUT.tx_arrays, LAYOUT.tx_ports)
    split_rx, split_tx = rx.reshape(LAYOUT.rx_arrays, -1), tx.reshape(LAYOUT.tx_arrays, -1)
    expected = np.einsum("arwbt,ar,bt->wab", parts, split_rx.conj(), split_tx.conj()).reshape(WINDOW, -1)
    expected = expected * size.conj() / np.sqrt((own.astype(float) ** 2).sum())
    close(along_late(x, own, late, False, len(size)), expected)

    pulse = late / np.linalg.norm(late)
    z = without_late(x, late, own, late, False)
    plain = np.einsum("rwt,w->rt", tensor, pulse.conj())
    close(z, laid_out(plain[:, None], LAYOUT)[0])


def test_a_path_that_is_off_counts_as_in(path, rng):
    tensor, own = drawn(rng, len(path[0]), WINDOW, len(path[1])), pattern(path)
    x, late, other = laid_out(tensor, LAYOUT), path[2], drawn(rng, WINDOW)
    having = laid_out(tensor + whole(path), LAYOUT)
    pairs = len(path[3])
    close(along_late(x, own, late, True, pairs), along_late(having, own, late, False, pairs))
    close(without_late(x, other, own, late, True), without_late(having, other, own, late, False))


def test_paths_are_taken_off_and_exchanged(path, rng):
    tensor, own = drawn(rng, len(path[0]), WINDOW, len(path[1])), pattern(path)
    other = tuple(drawn(rng, len(part)) for part in path)
    x = laid_out(tensor + whole(path), LAYOUT)
    take_off(x, path[2], own)
    close(x, laid_out(tensor, LAYOUT))
    exchange(x, path[2], own, other[2], pattern(other))
    close(x, laid_out(tensor + whole(path) - whole(other), LAYOUT))
    assert energy_of(x) == pytest.approx((np.abs(tensor + whole(path) - whole(other)) ** 2).sum(), rel=BOUND)


@pytest.mark.parametrize("between", [False, True])
def test_the_best_look_is_that_of_all_looks(rng, between):
    tensor = drawn(rng, LAYOUT.rx_ports * LAYOUT.rx_arrays, WINDOW, LAYOUT.tx_ports * LAYOUT.tx_arrays)
    if between:
        tensor[:, 3] = tensor[:, 4] = 1.5 * tensor[:, 4]
    rx_grid = drawn(rng, LAYOUT.rx_arrays, 6, LAYOUT.rx_ports).astype(np.complex64)
    tx_grid = drawn(rng, LAYOUT.tx_arrays, 5, LAYOUT.tx_ports).astype(np.complex64)
    parts = tensor.reshape(LAYOUT.rx_arrays, LAYOUT.rx_ports, WINDOW, LAYOUT.tx_arrays, LAYOUT.tx_ports)
    match = np.einsum("arwbt,akr,bjt->wakbj", parts, rx_grid, tx_grid)
    power = np.zeros((2 * WINDOW - 1, *match.shape[1:]))
    power[::2] = np.abs(match) ** 2
    power[1::2] = np.abs(match[1:] + match[:-1]) ** 2 / 2
    late, *look = np.unravel_index(power.argmax(), power.shape)
    assert (late % 2 == 1) == between
    assert best_look(laid_out(tensor, LAYOUT), LAYOUT, rx_grid, tx_grid) == (late / 2, *look)
