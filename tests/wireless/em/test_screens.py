"""Screens against SciPy's Fresnel integrals, Kirchhoff's integral, and the formula of TR 38.901."""

import cmath
import math

import numpy as np
import pytest
from scipy.special import fresnel

from wireless.em.screens import edge_share


def shares(v, phases=True):
    return np.array([edge_share(float(one), phases) for one in np.atleast_1d(v)])


def test_edges_are_fresnel_integrals():
    """g(v) = e^(j pi/4) / sqrt(2) (C(v) - j S(v)), to 5e-9 (measured 1e-9), on both sides."""
    v = np.concatenate([np.linspace(-12, 12, 2401), [-300.0, 300.0]])
    s, c = fresnel(v)
    assert np.abs(shares(v) - cmath.exp(0.25j * math.pi) / math.sqrt(2) * (c - 1j * s)).max() < 5e-9


@pytest.mark.parametrize("v", [-3.0, -0.78, 0.0, 1.0, 2.4, 8.0])
def test_half_plane_loss_is_that_of_the_recommendation(v):
    """J(v) = -20 lg(sqrt((1 - C - S)^2 + (C - S)^2) / 2), ITU-R P.526 equation 30: 0.01 dB (measured 1e-7)."""
    s, c = fresnel(v)
    expected = -20 * math.log10(math.hypot(1 - c - s, c - s) / 2)
    assert -20 * math.log10(abs(0.5 - shares(v)[0])) == pytest.approx(expected, abs=0.01)


def test_model_b_is_half_of_each_edge_on_the_line():
    """An edge on the path takes half of the amplitude, 6.02 dB, and model B has no ripple: its loss rises with v."""
    v = np.linspace(-20, 20, 401)
    loss = -20 * np.log10(0.5 - shares(v, phases=False).real)
    assert loss[200] == pytest.approx(20 * math.log10(2))
    assert (np.diff(loss) > 0).all() and (loss > 0).all()
