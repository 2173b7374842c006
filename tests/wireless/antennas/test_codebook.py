"""Codebooks and the reference's terminals."""

import numpy as np
import pytest

from wireless.antennas.arrays import Platform, uniform_array
from wireless.antennas.codebook import Terminal, terminal_named


@pytest.mark.parametrize(("name", "ports", "beams", "step_deg"), [("gnb", 16, 48, 7.5), ("ue", 8, 24, 15.0)])
def test_terminals_are_the_references(name, ports, beams, step_deg):
    """Ports, beams and steps in azimuth as published; each array sends a third of the beams."""
    terminal = terminal_named(name)
    assert len(terminal.platform.array) == ports
    assert terminal.n_beams == beams
    degrees = np.sort(np.rad2deg(terminal.beam_rad))
    np.testing.assert_allclose(degrees, -180 + step_deg * np.arange(beams), atol=1e-9)
    np.testing.assert_array_equal(np.bincount(terminal.beam_array), [beams // 3] * 3)


@pytest.mark.parametrize("name", ["gnb", "ue"])
def test_beams_reach_the_directivity_where_they_point(name):
    """At its own azimuth a beam has the array's directivity, the most of the nearest array."""
    terminal = terminal_named(name)
    got = np.abs(np.diagonal(terminal.beam_response(terminal.beam_rad))) ** 2
    np.testing.assert_allclose(got, terminal.platform.directivity(terminal.beam_rad).max(axis=1), rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(terminal.weight, axis=1), 1, rtol=1e-12)


def test_beams_are_narrow_and_ordered():
    """The best of all beams of an isotropic-element terminal at any azimuth is one of the two nearest."""
    terminal = Terminal(platform=Platform(array=uniform_array(8, element="3gpp")), n_beams=48)
    azimuth = np.linspace(-np.pi, np.pi, 1000)
    best = np.argmax(np.abs(terminal.beam_response(azimuth)), axis=1)
    off = (terminal.beam_rad[best] - azimuth + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(np.rad2deg(off)).max() < 7.5


def test_bad_terminals_are_named():
    """The message says what is known."""
    with pytest.raises(ValueError, match=r"'bs'. Known: gnb, ue"):
        terminal_named("bs")
    with pytest.raises(ValueError, match="n_beams is 2"):
        Terminal(platform=Platform(array=uniform_array(2)), n_beams=2)
    blind = Terminal(platform=Platform(array=uniform_array(2), face_rad=(0.0,)), n_beams=4)
    with pytest.raises(ValueError, match="no array radiates towards"):
        blind.beam_response(np.zeros(1))
