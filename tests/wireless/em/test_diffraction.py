"""Diffraction against Sommerfeld's exact half-plane, the exact wedge as a series, and its own continuity."""

import numpy as np
import pytest
from scipy.constants import speed_of_light
from scipy.special import fresnel, jv, modfresnelm

from wireless.em.diffraction import transition_over_root, wedge_terms
from wireless.em.fields import Wedge, diffract
from wireless.paths import Interaction
from wireless.tracing.tracer import Tracer, TracerConfig

CARRIER_HZ = 28e9
K = 2 * np.pi * CARRIER_HZ / speed_of_light


def half_plane(rho, phi, phi_source, soft):
    """Total field of a unit plane wave at a conducting half-plane by Sommerfeld (1896), phase 0 at the edge.

    u = e^(j pi/4) / sqrt(pi) [G(-a-) e^(j k rho cos b-) -+ G(-a+) e^(j k rho cos b+)], G(a) = integral of
    e^(-j t^2) from a to infinity, a = sqrt(2 k rho) cos(b / 2).
    """
    total = 0
    for sign, beta in ((1, phi - phi_source), (-1 if soft else 1, phi + phi_source)):
        a = np.sqrt(2 * K * rho) * np.cos(beta / 2)
        tail = np.where(
            a < 0, modfresnelm(np.abs(a))[0], np.sqrt(np.pi) * np.exp(-0.25j * np.pi) - modfresnelm(a)[0]
        )
        total = total + sign * tail * np.exp(1j * K * rho * np.cos(beta))
    return np.exp(0.25j * np.pi) / np.sqrt(np.pi) * total


def wedge_series(rho, phi, phi_source, n, soft):
    """Total field of a unit plane wave at a conducting wedge, by eigenfunctions: the exact solution.

    u = 4 / n sum of [1/2 if m = 0] e^(j pi m / 2n) J_(m/n)(k rho) sin or cos (m phi / n) (m phi' / n).
    """
    m = np.arange(int(n * (K * rho + 60)))
    radial = np.where(m == 0, 0.5, 1.0) * np.exp(0.5j * np.pi * m / n) * jv(m / n, K * rho)
    wave = np.sin if soft else np.cos
    return 4 / n * (radial * wave(m * phi / n) * wave(m * phi_source / n)).sum()


def utd_total(rho, phi, phi_source, n, soft):
    """Geometrical optics and UTD of the same plane wave: L = rho, spreading 1 / sqrt(rho)."""
    sign = -1 if soft else 1
    total = 0j
    if abs(phi - phi_source) < np.pi:
        total += np.exp(1j * K * rho * np.cos(phi - phi_source))
    if phi + phi_source < np.pi:
        total += sign * np.exp(1j * K * rho * np.cos(phi + phi_source))
    if phi + phi_source > (2 * n - 1) * np.pi:
        total += sign * np.exp(1j * K * rho * np.cos(2 * n * np.pi - phi - phi_source))
    direct, on_0, on_n = wedge_terms(phi, phi_source, n, K, rho, 1.0, 1e-12)
    return total + (direct + sign * (on_0 + on_n)) * np.exp(-1j * K * rho) / np.sqrt(rho)


def test_transition_function_is_its_integral():
    """F(t^2) / t against the Fresnel integrals of SciPy: 5e-9 at most (measured 3e-9), table and series."""
    t = np.concatenate([np.linspace(0.0, 7.999, 401), np.linspace(8.0, 30.0, 50)])
    s, c = fresnel(t * np.sqrt(2 / np.pi))
    tail = np.sqrt(np.pi / 2) * ((0.5 - c) - 1j * (0.5 - s))
    got = np.array([transition_over_root(float(x)) for x in t])
    np.testing.assert_allclose(got[t < 5], (2j * np.exp(1j * t**2) * tail)[t < 5], rtol=5e-9, atol=0)
    np.testing.assert_allclose(got, 2j * np.exp(1j * t**2) * modfresnelm(t)[0], rtol=5e-9, atol=0)


@pytest.mark.parametrize("soft", [True, False])
@pytest.mark.parametrize("phi_source", [0.4, 1.5, 2.9])
def test_half_plane_is_exact(soft, phi_source):
    """For a half-plane UTD of a plane wave is Sommerfeld's solution: equal to 1e-8 at any distance and angle."""
    for rho in (0.0005, 0.01, 0.3, 20.0):
        for phi in np.linspace(0.01, 2 * np.pi - 0.01, 61):
            exact = half_plane(rho, phi, phi_source, soft)
            assert abs(utd_total(rho, phi, phi_source, 2.0, soft) - exact) < 1e-8


@pytest.mark.parametrize("soft", [True, False])
@pytest.mark.parametrize("n", [1.5, 1.75, 1.2])
def test_wedge_meets_the_exact_series(soft, n):
    """Eigenfunction series of a conducting wedge, 8 wavelengths away: within 0.1 % of the incident field."""
    rho = 8 * 2 * np.pi / K
    for phi_source in (0.3, 1.1, 2.0):
        for phi in np.linspace(0.05, n * np.pi - 0.05, 43):
            exact = wedge_series(rho, phi, phi_source, n, soft)
            assert abs(utd_total(rho, phi, phi_source, n, soft) - exact) < 1e-3


def at_edge(tracer, tx, rx):
    """Sum of all gains (theta, theta), per receiver."""
    paths = tracer.trace(np.atleast_2d(tx), rx)
    total = np.zeros((len(rx), 2, 2), complex)
    np.add.at(total, paths.rx, paths.gain)
    return total


def test_traced_half_plane_is_sommerfeld(extruded):
    """A metal sheet, a transmitter 900 m away: paths add up to the exact field of a plane wave, to 0.2 %."""
    tracer = Tracer(
        extruded([[(0.0, 0.0), (8.0, 0.0)]]), materials=("metal",), config=TracerConfig(max_reflections=1)
    )
    phi_source, far, rho = 1.1, 900.0, 0.03
    phi = np.linspace(0.05, 2 * np.pi - 0.05, 60)
    rx = np.column_stack([rho * np.cos(phi), rho * np.sin(phi), np.full(60, 1.5)])
    got = at_edge(tracer, far * np.array([np.cos(phi_source), np.sin(phi_source), 1.5 / far]), rx)[:, 0, 0]
    incident = np.exp(-1j * K * far) / (2 * K * far)
    exact = np.array([half_plane(rho, p, phi_source, True) for p in phi])
    assert np.abs(got / incident - exact).max() < 2e-3


@pytest.mark.parametrize("material", ["metal", "drywall", "concrete"])
@pytest.mark.parametrize("rise_m", [0.0, 1.7])
def test_field_is_continuous_across_shadow_and_reflection_boundaries(extruded, material, rise_m):
    """Paths appear and vanish where a receiver crosses a boundary, their sum does not jump: below 0.1 dB."""
    mesh = extruded([[(0.0, 0.0), (50.0, 0.0)], [(0.0, 0.0), (0.0, -50.0)]], high=4.0)
    tracer = Tracer(mesh, materials=(material,), config=TracerConfig(diffraction_reflections=0))
    source = np.radians(40.0)
    tx = np.array([3.0 * np.cos(source), 3.0 * np.sin(source), 1.0])
    both_faces = np.radians(120.0)
    tx_both = np.array([3.0 * np.cos(both_faces), 3.0 * np.sin(both_faces), 1.0])
    for position, boundaries in ((tx, (180 + 40, 180 - 40)), (tx_both, (180 - 120, 360 - 120))):
        for boundary in boundaries:
            angle = np.radians(boundary) + np.array([-1, 1]) * 1e-6 / 2
            rx = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), np.full(2, 1.0 + rise_m)])
            before, after = at_edge(tracer, position, rx)
            count = tracer.trace(position[None], rx).count()[0]
            assert count[0] != count[1]
            assert np.abs(after - before).max() < (10 ** (0.1 / 20) - 1) * np.abs(before).max()


@pytest.mark.parametrize("rise_m", [0.0, 1.7])
@pytest.mark.parametrize("source_deg", [40.0, 120.0])
def test_the_bisector_law_keeps_what_must_hold(extruded, rise_m, source_deg):
    """Faces that reflect at half the angle between the rays: continuous and reciprocal."""
    mesh = extruded([[(0.0, 0.0), (50.0, 0.0)], [(0.0, 0.0), (0.0, -50.0)]], high=4.0)
    bisector, nearer = (
        Tracer(mesh, config=TracerConfig(diffraction_reflections=0, max_reflections=1, diffraction_law=law))
        for law in ("bisector", "nearer_face")
    )
    source = np.radians(source_deg)
    tx = np.array([3.0 * np.cos(source), 3.0 * np.sin(source), 1.0])
    boundaries = (220, 140) if source_deg == 40 else (60, 240)
    for boundary in boundaries:
        angle = np.radians(boundary) + np.array([-1, 1]) * 1e-6 / 2
        rx = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), np.full(2, 1.0 + rise_m)])
        before, after = at_edge(bisector, tx, rx)
        assert np.abs(after - before).max() < (10 ** (0.1 / 20) - 1) * np.abs(before).max()
    angle = np.radians(np.array([20.0, 75.0, 110.0, 190.0, 255.0]))
    rx = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), np.full(5, 1.0 + rise_m)])
    forth = bisector.trace(tx[None], rx)
    for i in range(5):
        back = bisector.trace(rx[i : i + 1], tx[None])
        np.testing.assert_allclose(back.power, forth.power[forth.rx == i], rtol=1e-9)
    other = nearer.trace(tx[None], rx)
    bent = [
        p.power[np.argsort(p.rx)][(p.order == 1) & (p.interaction[:, 0] == Interaction.DIFFRACTION)]
        for p in (forth, other)
    ]
    assert np.abs(10 * np.log10(bent[0] / bent[1])).max() > 1


@pytest.mark.parametrize("slant_deg", [90.0, 50.0])
def test_both_laws_are_one_for_a_perfect_conductor(slant_deg):
    """Faces that reflect all at any angle: the same field within 1e-8 by either law (measured 3e-11)."""
    wedge, faces = np.eye(3)[[2, 0, 1]], np.tile(np.array([1 - 1e22j, 0j]), (2, 1))
    up, work = np.cos(np.radians(slant_deg)), np.zeros((4, 3))
    for phi_source in (0.3, 1.9):
        for phi in np.linspace(0.1, 1.5 * np.pi - 0.1, 23):
            level = np.sin(np.radians(slant_deg))
            route = np.array([-level * np.cos(phi_source), -level * np.sin(phi_source), up])
            out = np.array([level * np.cos(phi), level * np.sin(phi), up])
            both = []
            for bisector in (True, False):
                field = np.zeros((2, 3), complex)
                field[0] = np.cross(route, [0.3, 0.5, 0.8])
                field[1] = np.cross(route, field[0])
                diffract(field, route, out, Wedge(wedge, 1.5, faces, bisector), K, (3.0, 2.0), work)
                both.append(field)
            assert np.abs(both[0] - both[1]).max() < 1e-8 * np.abs(both[1]).max()
