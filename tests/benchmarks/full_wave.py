"""Laws of diffraction against a full-wave solution of lossy wedges: errors of strengths and of the field.

Ends 6 wavelengths from the edge, faces of 18 and more, three places of the source, an observer each 8 degrees,
24 nodes a wavelength (36 change the errors by less than 0.1 dB and 0.001 of the incident field).
"""

import numpy as np
from tyro.conf import OmitArgPrefixes

from tests.benchmarks.edge_laws import Faces, Wedges, laws
from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.results import Results
from tests.wireless.em.full_wave import diffracted, traced
from tests.wireless.em.plane_waves import reflection

MATERIALS = {"drywall": 2.94 - 0.0787j, "concrete": 5.24 - 0.402j}
SOURCES_DEG = (20.0, 55.0, 110.0)
RIVALS = ("nearer face (default)", "Luebbers' own angles", "bisector", "Holm", "perfect conductor")


def main(*, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Laws of diffraction against full waves at a wedge of drywall and of concrete; a minute.

    Args:
        options: Of every benchmark.
    """
    results = Results()
    for material, of_law in compared().items():
        for law, (shadow_db, lit_db, field) in of_law.items():
            results.add("full wave", law, f"{material}: shadow", shadow_db, "dB", digits=2)
            results.add("full wave", law, f"{material}: lit", lit_db, "dB", digits=1)
            if not np.isnan(field):
                results.add("full wave", law, f"{material}: field", 100 * field, "%", digits=1)
    return options.finish("full_wave", results)


def compared() -> dict[str, dict[str, tuple[float, float, float]]]:
    """For each material and law: errors of strength [dB] in the shadow and outside of it, and of the field."""
    rows: dict[str, dict[str, tuple[float, float, float]]] = {}
    for material, eps in MATERIALS.items():
        shadow: dict[str, list[float]] = {name: [] for name in RIVALS}
        lit: dict[str, list[float]] = {name: [] for name in RIVALS}
        field: dict[str, list[float]] = {name: [] for name in RIVALS}
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
