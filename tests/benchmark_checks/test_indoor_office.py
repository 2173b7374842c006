"""Statistics of offices: path loss of the standard, and exponents of links whose law is known."""

import numpy as np
import pytest

from tests.benchmarks.indoor_office import TRACED, fit_exponent, standard_loss_db, trace_office


def test_standard_loss_db_has_the_values_of_table_7_4_1_1():
    """At 10 m and 28 GHz 78.6 dB in line of sight and 91.6 dB without; at 1 m the larger of both laws."""
    assert standard_loss_db(np.array([10.0]), 28, "line of sight") == pytest.approx(78.643, abs=1e-3)
    assert standard_loss_db(np.array([10.0]), 28, "no line of sight") == pytest.approx(91.634, abs=1e-3)
    near = standard_loss_db(np.array([1.0]), 28, "no line of sight")
    assert near == pytest.approx(32.4 + 20 * np.log10(28), abs=1e-9)


def test_fit_exponent_recovers_a_law_and_its_shadowing():
    """61.4 dB at 1 m and 28 GHz, exponent 2.5, shadowing of 3 dB; no interval of a single office."""
    rng = np.random.default_rng(0)
    offices = []
    for _ in range(30):
        distance_m = rng.uniform(2, 30, 100)
        loss_db = 61.384 + 25 * np.log10(distance_m) + rng.normal(0, 3, 100)
        offices.append(np.stack([np.ones(100), distance_m, loss_db, *np.zeros((3, 100))]))
    exponent, spread, shadowing_db = fit_exponent(offices, 28)
    assert exponent == pytest.approx(2.5, abs=0.02) and shadowing_db == pytest.approx(3.0, abs=0.15)
    assert spread is not None and spread[0] < 2.5 < spread[1] < spread[0] + 0.1
    assert fit_exponent(offices[:1], 28)[1] is None


def test_trace_office_has_free_space_as_the_largest_loss_in_line_of_sight():
    """Powers of paths add up, so that other paths only lower the loss."""
    links = trace_office(3, 28, next(iter(TRACED)))
    sight = links[:, links[0] == 1]
    free_db = 61.384 + 20 * np.log10(sight[1])
    assert sight.shape[1] > 5 and (sight[2] < free_db + 1e-2).all() and (sight[2] > free_db - 6).all()
