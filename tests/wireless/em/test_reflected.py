"""What walls reflect at most, tabled: never less than they reflect, and seldom much more."""

import numpy as np
import pytest

from tests.wireless.em.test_layers import FIVE, THREE
from wireless.em.fields import _face_ratios
from wireless.em.fresnel import fresnel
from wireless.em.materials import WALLS, wall_row
from wireless.em.reflected import by_face, by_mirror, most_reflected

#: Most values of a row: a half-space has two, five layers ten.
WIDTH = 10


def row(material, frequency_hz, **layer):
    """Layers of a wall, filled up with zeros."""
    wall = wall_row(material, frequency_hz, **layer)
    return np.pad(wall, (0, WIDTH - len(wall)))


def walls(frequency_hz):
    """Shipped walls, others of three and five layers, half-spaces and a slab."""
    plain = [row(name, frequency_hz) for name in ("concrete", "glass", "metal")]
    slab = row("concrete", frequency_hz, thickness_m=0.05)
    layers = [row(material, frequency_hz) for material in (*WALLS, THREE, FIVE)]
    return np.array([*plain, slab, *layers])


@pytest.mark.parametrize("frequency_hz", [3.5e9, 28e9, 60e9])
def test_mirrors_are_never_stronger(frequency_hz):
    """5,000 angles a wall; in the median at most 10 % above, where they do not count as mirrors (measured 5 %)."""
    wavenumber, rng = 2 * np.pi * frequency_hz / 299792458.0, np.random.default_rng(1)
    every = walls(frequency_hz)
    most = most_reflected(every, wavenumber)
    for facet, wall in enumerate(every):
        above = []
        for cos_i in rng.uniform(0, 1, 5_000):
            te, tm, _, _ = fresnel(cos_i, wall, wavenumber)
            power, bound = (
                max(abs(te), abs(tm)) ** 2,
                by_mirror(most.mirror, most.row[facet], cos_i),
            )
            assert power <= bound
            if cos_i > 0.1:
                above.append(bound / power)
        if most.mirror[most.row[facet], -1] < 1:
            assert np.median(above) < 1.1


@pytest.mark.parametrize("bisector", [False, True])
def test_faces_are_never_stronger(bisector):
    """5,000 paths over an edge per wall: the largest singular value of what its face does (beyond near grazing)."""
    wavenumber, rng = 2 * np.pi * 28e9 / 299792458.0, np.random.default_rng(2)
    every = walls(28e9)
    most = most_reflected(every, wavenumber)
    for facet, wall in enumerate(every):
        for _ in range(5_000):
            gap = rng.uniform(np.pi, 2 * np.pi)
            phi, phi_source = rng.uniform(0, gap, 2)
            cos_b0 = rng.uniform(-1, 1)
            sin_b0 = np.sqrt(1 - cos_b0**2)
            sine = abs(np.cos((phi - phi_source) / 2)) if bisector else np.sin(min(phi, phi_source))
            if abs(sin_b0 * sine) < 0.07:
                continue
            bb, ff, bf = _face_ratios(phi, phi_source, cos_b0, sin_b0, wall, wavenumber, bisector)
            field = np.linalg.norm([[bb, bf], [-bf, ff]], 2)
            bound = by_face(most.apart, most.alike, most.row[facet], phi, phi_source, sin_b0, bisector)
            assert field <= bound + 1e-12


def test_walls_alike_share_a_row_and_very_many_are_mirrors():
    """Two facets of one wall have one row; a hundred different walls are not tabled."""
    wavenumber = 2 * np.pi * 28e9 / 299792458.0
    one, other = row("concrete", 28e9), row("glass", 28e9)
    most = most_reflected(np.array([one, other, one]), wavenumber)
    assert most.row[0] == most.row[2] != most.row[1]
    many = np.tile(one, (100, 1))
    many[:, 0] += np.arange(100) * 0.01
    most = most_reflected(many, wavenumber)
    assert most.mirror.shape[0] == 1
    assert (most.mirror == 1).all()
