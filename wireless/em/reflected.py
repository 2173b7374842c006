"""How much walls reflect at most, tabled over the angle of incidence: bounds that cost no root and no exponential.

Most paths over an edge are too weak for their link's list, which is found out sooner by what their walls reflect at
most than by their fields. A bin of the table holds the largest of 17 samples and as much more as neighbours differ, so
that it is above what is between them too. Nearer to grazing than `_GRAZING`, where all walls reflect nearly everything
and layers ring, it is 1, as it is for walls whose layers ring faster than samples can follow.

With s = (r_te + r_tm) / 2 and d = (r_tm - r_te) / 2 a face at an edge turns fields in the coordinates of the edge
(`wireless.em.fields.diffract`) by d diag(1, -1) + s (u, v; -v, u), which is a mirror and a turn: together they leave
at most |d| + |s| hypot(u, v).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from robosim.support.compiled import compiled
from wireless.em.fresnel import fresnel

#: Bins over the cosine of the angle of incidence, and samples in each.
_BINS, _SAMPLES = 512, 16
#: Cosine of the angle of incidence below which all is 1.
_GRAZING = 1 / 16
#: Most phase that layers may turn from one sample to the next [rad].
_PHASE_RAD = 0.1
#: Most walls that are tabled; of more, each counts as a mirror.
_MOST_WALLS = 64


class Reflected(NamedTuple):
    """Largest specular reflection of facets."""

    row: Int[np.ndarray, " f"]
    """Row of each facet in the tables."""
    mirror: Float[np.ndarray, "k n"]
    """The larger of |r_te| and |r_tm|."""
    apart: Float[np.ndarray, "k n"]
    """|d|."""
    alike: Float[np.ndarray, "k n"]
    """|s| over the squared sine of the angle of incidence, which it vanishes with."""


def most_reflected(walls: Complex[np.ndarray, "f l"], wavenumber: float) -> Reflected:
    """Tables of walls by facet."""
    rows = np.ascontiguousarray(walls)
    rows = rows.view(np.dtype((np.void, rows.strides[0]))).ravel()
    _, first, row = np.unique(rows, return_index=True, return_inverse=True)
    if len(first) > _MOST_WALLS:
        first, row = first[:0], np.zeros(len(walls), np.int64)
    shape = max(len(first), 1), _BINS
    tables = np.ones(shape), np.ones(shape), np.zeros(shape)
    for k, facet in enumerate(first):
        thick_m = walls[facet, 1::2].real.sum()
        if 2 * wavenumber * thick_m <= _PHASE_RAD * _BINS * _SAMPLES:
            begin = int(np.ceil(_GRAZING * _BINS))
            for table, samples in zip(tables, _sampled(walls[facet], wavenumber), strict=True):
                table[k, begin:] = _largest(samples)[begin:]
    return Reflected(row.astype(np.int64), *tables)


@compiled
def _sampled(wall: Complex[np.ndarray, " l"], wavenumber: float) -> Float[np.ndarray, "3 n"]:
    """Sample the tabled reflection, from grazing incidence to incidence along the normal."""
    n = _BINS * _SAMPLES
    result = np.ones((3, n + 1))
    for j in range(n + 1):
        cos_i = min(j / n, 1 - 1e-6)  # along the normal s over the sine is a limit
        te, tm, _, _ = fresnel(cos_i, wall, wavenumber)
        result[0, j] = max(abs(te), abs(tm))
        result[1, j] = abs(tm - te) / 2
        result[2, j] = abs(tm + te) / 2 / (1 - cos_i * cos_i)
    return result


def _largest(samples: Float[np.ndarray, " n"]) -> Float[np.ndarray, " b"]:
    """The largest of each bin, both its ends included, and as much more as samples differ there."""
    at = np.arange(_BINS)[:, None] * _SAMPLES + np.arange(_SAMPLES + 1)
    binned = samples[at]
    return np.asarray(1.0001 * (binned.max(axis=1) + np.abs(np.diff(binned, axis=1)).max(axis=1)))


@compiled
def by_mirror(mirror: Float[np.ndarray, "k n"], row: int, cos_i: float) -> float:
    """Most of the power that a wall reflects, of the better polarisation."""
    return mirror[row, min(int(cos_i * _BINS), _BINS - 1)] ** 2


@compiled
def by_face(
    apart: Float[np.ndarray, "k n"],
    alike: Float[np.ndarray, "k n"],
    row: int,
    phi: float,
    phi_source: float,
    sin_b0: float,
    bisector: bool,
) -> float:
    """Most of a field that a face at an edge reflects, see `wireless.em.fields.diffract`.

    Args:
        apart: Tables, see `Reflected`.
        alike: The same.
        row: That of the face's wall.
        phi: Angle of the observer from the face.
        phi_source: Angle of the source from it.
        sin_b0: Sine of the angle between ray and edge.
        bisector: At which angle faces reflect.
    """
    sine = abs(np.cos((phi - phi_source) / 2)) if bisector else np.sin(min(phi, phi_source))
    cos_i, cos2_b0 = min(abs(sin_b0 * sine), 1.0), max(1 - sin_b0 * sin_b0, 0.0)
    place = min(int(cos_i * _BINS), _BINS - 1)
    u = 2 * cos2_b0 * sine * sine - (1 - cos_i * cos_i)
    v = sine * (np.cos(phi_source) - np.cos(phi))
    return apart[row, place] + alike[row, place] * np.sqrt(u * u + cos2_b0 * v * v)
