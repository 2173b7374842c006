"""Laws of diffraction against a full-wave solution of lossy wedges, once: a minute.

Ends 6 wavelengths from the edge, faces of 18 and more, three places of the source, an observer each 8 degrees,
24 nodes a wavelength (36 change the errors by less than 0.1 dB and 0.001 of the incident field).
"""

import numpy as np
import pytest

from tests.benchmarks.edge_laws import Faces, Wedges, laws
from tests.wireless.em.full_wave import diffracted, traced
from tests.wireless.em.plane_waves import reflection

MATERIALS = {"drywall": 2.94 - 0.0787j, "concrete": 5.24 - 0.402j}
SOURCES_DEG = (20.0, 55.0, 110.0)
RIVALS = ("nearer face (default)", "Luebbers' own angles", "bisector", "Holm", "perfect conductor")


def compared():
    """For each material and law: errors of strength [dB] in the shadow and outside of it, and of the field."""
    rows = {}
    for material, eps in MATERIALS.items():
        shadow, lit, field = ({name: [] for name in RIVALS} for _ in range(3))
        for source in SOURCES_DEG:
            truth = diffracted(eps, source, np.arange(6.0, 266.0, 8.0), distance=6.0, per_wavelength=24)
            same = np.ones(len(truth.phi))
            wedges = Wedges(
                n=1.5 * same,
                phi_source=truth.phi_source * same,
                phi=truth.phi,
                before_m=truth.before * same,
                after_m=truth.after,
            )
            half = Faces(
                te=lambda s, eps=eps: reflection(s, eps)[0],
                tm=lambda s, eps=eps: reflection(s, eps)[1],
                through=lambda s: 0j * s,
            )
            powers = laws(wedges, {"wall": half, "board": half, "half-space": half}, 2 * np.pi)
            hidden = wedges.bending_rad > 0
            for name in RIVALS:
                off_db = 10 * np.log10(powers[name] / truth.after / np.abs(truth.field) ** 2)
                shadow[name] += list(off_db[hidden])
                lit[name] += list(off_db[~hidden])
            for name, bisector in (("nearer face (default)", False), ("bisector", True)):
                got = traced(truth, eps, bisector=bisector)
                np.testing.assert_allclose(np.abs(got) ** 2, powers[name], rtol=1e-9)
                phased = got * np.exp(-2j * np.pi * truth.after) / np.sqrt(truth.after)
                field[name] += list(np.abs(phased - truth.field))
        rows[material] = {
            name: (
                float(np.sqrt(np.mean(np.square(shadow[name])))),
                float(np.median(np.abs(lit[name]))),
                float(np.sqrt(np.mean(np.square(field[name])))) if field[name] else np.nan,
            )
            for name in RIVALS
        }
    return rows


@pytest.fixture(scope="module")
def rows():
    return compared()


@pytest.mark.parametrize("material", MATERIALS)
def test_the_default_law_is_nearest_to_full_waves(rows, material):
    """In the shadow within 1 dB (root mean square; measured 0.96 and 0.95), the field within 3.5 % (2.8 and 3.2).

    That is of the incident one. Bisectors are off by 2.3 and 2.5 dB there, and by 3.9 and 3.8 %; no law is nearer by
    0.2 dB.
    """
    own = rows[material]["nearer face (default)"]
    assert own[0] < 1.05 and own[2] < 0.035
    assert rows[material]["bisector"][0] > 1.5 * own[0]
    assert rows[material]["bisector"][2] > 1.1 * own[2]
    assert min(row[0] for row in rows[material].values()) > own[0] - 0.2
