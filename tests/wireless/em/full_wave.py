"""A right-angled wedge of lossy material lit by a line source: the field by finite differences in time (FDTD).

Yee's scheme in two dimensions, electric field along the edge, lengths in wavelengths. The faces of the wedge lie on
nodes, where the material counts half and at the edge a quarter, so that nothing is a staircase. The grid is so large
that nothing comes back from its border before the record ends: the wedge is infinite. Diffraction is what is left of
the field after that of geometrical optics, which is computed alike: around one face alone, or in free space.

Reference: K. S. Yee, IEEE Trans. Antennas Propag. 14 (1966).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from wireless.em.fields import Wedge, diffract

#: Courant number, of at most 1 / sqrt(2).
COURANT = 0.7
#: Length of the pulse's rise, and half of its width, in periods.
RISE, WIDTH = 4.0, 1.2


@dataclass(frozen=True)
class Diffracted:
    """Field that the edge adds, over the incident field at the edge, and where."""

    field: np.ndarray
    phi: np.ndarray
    phi_source: float
    after: np.ndarray
    before: float


def diffracted(eps, source_deg, observer_deg, *, distance, per_wavelength):
    """Diffraction by the wedge that fills the quadrant below +x and right of -y, angles counted from +x.

    Args:
        eps: Complex relative permittivity, Im(eps) < 0.
        source_deg: Angle of the line source, less than 270.
        observer_deg: Angles of observers.
        distance: Of source and observers from the edge, in wavelengths.
        per_wavelength: Nodes in a wavelength.
    """
    lasts = 2 * distance + 2 * RISE + 4  # of the record, in periods
    half = int((lasts + 2 * distance) / 2 * per_wavelength) + 2
    place = distance * per_wavelength * np.exp(1j * np.radians([source_deg, *observer_deg]))
    nodes = np.rint(np.column_stack([place.real, place.imag])).astype(int)
    record = np.vstack([nodes[1:], [0, 0]]) + half
    axis = np.arange(-half, half + 1)
    right, below = np.heaviside(axis, 0.5)[:, None], np.heaviside(-axis, 0.5)[None]
    found = {
        name: _field(eps, filled, nodes[0] + half, record, per_wavelength, lasts)
        for name, filled in (
            ("wedge", right * below),
            ("face_0", below + 0 * right),
            ("face_n", right + 0 * below),
            ("free", 0 * right * below),
        )
    }
    angle = np.arctan2(nodes[:, 1], nodes[:, 0]) % (2 * np.pi)
    phi, phi_source = angle[1:], angle[0]
    optics = np.where(phi - phi_source < np.pi, found["free"][:-1], 0)
    optics = np.where(phi < np.pi - phi_source, found["face_0"][:-1], optics)
    optics = np.where(phi > 2 * np.pi - phi_source, found["face_n"][:-1], optics)
    lengths = np.linalg.norm(nodes, axis=1) / per_wavelength
    field = (found["wedge"][:-1] - optics) / found["free"][-1]
    return Diffracted(field, phi, float(phi_source), lengths[1:], float(lengths[0]))


def _field(eps, filled, source, record, per_wavelength, lasts):
    """Spectrum of the field at some nodes, at the frequency of the wave."""
    period = per_wavelength / COURANT
    real = 1 + filled * (eps.real - 1)
    loss = filled * -eps.imag * np.pi / period / real
    return _stepped(
        (1 - loss) / (1 + loss), COURANT / real / (1 + loss), source, record, int(lasts * period), period
    )


@njit
def _stepped(keep, drive, source, record, steps, period):
    """Yee's scheme: fields step by step, summed up at some nodes with the phase of the wave."""
    n, m = keep.shape
    e, hx, hy = np.zeros((n, m)), np.zeros((n, m)), np.zeros((n, m))
    total = np.zeros(len(record), np.complex128)
    for step in range(steps):
        for i in range(n - 1):
            for j in range(m - 1):
                hx[i, j] -= COURANT * (e[i, j + 1] - e[i, j])
                hy[i, j] += COURANT * (e[i + 1, j] - e[i, j])
        for i in range(1, n - 1):
            for j in range(1, m - 1):
                curl = hy[i, j] - hy[i - 1, j] - hx[i, j] + hx[i, j - 1]
                e[i, j] = keep[i, j] * e[i, j] + drive[i, j] * curl
        t = step / period
        e[source[0], source[1]] += np.exp(-(((t - RISE) / WIDTH) ** 2)) * np.sin(2 * np.pi * t)
        turn = np.exp(-2j * np.pi * t)
        for k in range(len(record)):
            total[k] += e[record[k, 0], record[k, 1]] * turn
    return total


@dataclass(frozen=True)
class Errors:
    """How far a law is from the full-wave field."""

    field: float
    """Root mean square of the error over the incident field at the edge."""
    shadow_db: float
    """Root mean square error of strength in the shadow [dB]; NaN if there is none."""


def errors(truth: Diffracted, coefficient: np.ndarray) -> Errors:
    """Errors of a diffraction coefficient D [sqrt(wavelengths)] in the sense of the uniform theory."""
    field = coefficient * np.exp(-2j * np.pi * truth.after) / np.sqrt(truth.after)
    off_db = 20 * np.log10(np.abs(field / truth.field))
    shadow = truth.phi - truth.phi_source > np.pi
    return Errors(
        float(np.sqrt(np.mean(np.abs(field - truth.field) ** 2))),
        float(np.sqrt(np.mean(off_db[shadow] ** 2))) if shadow.any() else float("nan"),
    )


def traced(truth: Diffracted, eps: complex, *, bisector: bool) -> np.ndarray:
    """What the tracer uses as D: vertical fields at an upright edge, level rays, wavelength 1."""
    wedge, faces = np.eye(3)[[2, 0, 1]], np.tile(np.array([eps, 0j]), (2, 1))
    found = np.empty(len(truth.phi), complex)
    for i, phi in enumerate(truth.phi):
        route = -np.array([np.cos(truth.phi_source), np.sin(truth.phi_source), 0.0])
        out = np.array([np.cos(phi), np.sin(phi), 0.0])
        field = np.zeros((2, 3), complex)
        field[0, 2] = field[1, 2] = 1.0
        legs_m = float(truth.before), float(truth.after[i])
        diffract(field, route, out, Wedge(wedge, 1.5, faces, bisector), 2 * np.pi, legs_m, np.zeros((4, 3)))
        found[i] = field[0, 2]
    return found
