"""Diffraction coefficient D of the edge of a lossy wedge by the uniform theory of diffraction (UTD).

A wedge leaves open an angle n pi; angles phi' of the source and phi of the observer are counted from its
0-face through open space. With b- = phi - phi' and b+ = phi + phi' the field behind the edge is made of terms
    T(y) = cot(y / 2n) F(2 k L sin^2(u / 2)),  y = pi +- b,  u = y modulo 2 pi n, the nearest to 0,
    D = -e^(-j pi/4) / (2 n sqrt(2 pi k) sin b0) [T(pi+b-) + T(pi-b-) + R_n T(pi+b+) + R_0 T(pi-b+)],
where F is the transition function and L the distance parameter. Each u is the angle to one shadow boundary,
positive on its lit side; there cot diverges while F vanishes, and the product jumps by what geometrical
optics loses. R_0 and R_n are the reflection coefficients of the two faces (Luebbers), so that the sum is
continuous across reflection boundaries too. They are taken at the smaller of the two angles to the face,
which on the boundaries is the angle of incidence and makes the whole reciprocal, as Luebbers' own choice is
not.

Left out: second-order diffraction, slope diffraction, creeping and surface waves, rough edges.
References: R. G. Kouyoumjian and P. H. Pathak, Proc. IEEE 62 (1974), equations 25 to 29; R. J. Luebbers, IEEE
Trans. Antennas Propag. 32 (1984).
"""

import numpy as np
from scipy.special import wofz

from robosim.support.compiled import compiled

#: F(t^2) / t is tabled for t up to here, in these steps; four-point interpolation errs by 3e-9 at most.
_END, _STEP = 8.0, 0.01
_TABLE = (
    np.sqrt(np.pi) * np.exp(0.25j * np.pi) * wofz(1j * np.exp(0.25j * np.pi) * np.arange(-1, 803) * _STEP)
)


@compiled
def transition_over_root(t: float) -> complex:
    """F(t^2) / t, where F is the transition function of UTD and t >= 0; sqrt(pi) e^(j pi/4) at 0.

    F(x) = 2 j sqrt(x) e^(jx) (integral of e^(-j tau^2) from sqrt(x) to infinity): a table of the Faddeeva
    function, beyond it the asymptotic series.
    """
    if t >= _END:
        q = 0.5j / (t * t)
        return (1 + q * (1 + q * (3 + q * (15 + q * (105 + q * 945))))) / t
    i = int(t / _STEP)
    w = t / _STEP - i
    return (
        -w * (w - 1) * (w - 2) / 6 * _TABLE[i]
        + (w + 1) * (w - 1) * (w - 2) / 2 * _TABLE[i + 1]
        - (w + 1) * w * (w - 2) / 2 * _TABLE[i + 2]
        + (w + 1) * w * (w - 1) / 6 * _TABLE[i + 3]
    )


@compiled
def boundary_term(y: float, n: float, kl: float, tie_rad: float) -> complex:
    """cot(y / 2n) F, finite everywhere; within tie_rad of the boundary it takes the lit side.

    Args:
        y: pi plus or minus phi -+ phi' [rad].
        n: Open angle of the wedge over pi.
        kl: Wavenumber times distance parameter.
        tie_rad: Angle below which an observer counts as on the boundary, and so as lit.
    """
    u = y - 2 * np.pi * n * np.round(y / (2 * np.pi * n))
    root = np.sqrt(2 * kl)
    if abs(u) <= tie_rad:
        return n * root * transition_over_root(0.0)
    t = root * abs(np.sin(u / 2))
    return t * transition_over_root(t) / np.tan(u / (2 * n))


@compiled
def wedge_terms(
    phi: float, phi_source: float, n: float, k: float, distance_m: float, sin_b0: float, tie_rad: float
) -> tuple[complex, complex, complex]:
    """Parts of the diffraction coefficient [sqrt(m)].

    Args:
        phi: Angle of the observer from the 0-face, in [0, n pi].
        phi_source: Angle of the source from the 0-face.
        n: Open angle over pi, in (1, 2].
        k: Wavenumber [1/m].
        distance_m: L = s s' sin^2(b0) / (s + s') for a spherical wave.
        sin_b0: Sine of the angle between ray and edge.
        tie_rad: See `boundary_term`.

    Returns:
        The part without reflection, the part to be multiplied by R_0 and that by R_n: soft and hard
        coefficients of a perfect conductor are first -+ (second + third).
    """
    kl = k * distance_m
    factor = -np.exp(-0.25j * np.pi) / (2 * n * np.sqrt(2 * np.pi * k) * sin_b0)
    minus, plus = phi - phi_source, phi + phi_source
    incident = boundary_term(np.pi + minus, n, kl, tie_rad) + boundary_term(np.pi - minus, n, kl, tie_rad)
    return (
        factor * incident,
        factor * boundary_term(np.pi - plus, n, kl, tie_rad),
        factor * boundary_term(np.pi + plus, n, kl, tie_rad),
    )


@compiled
def edge_bound(
    phi: float, phi_source: float, gap: float, wavenumber: float, before_m: float, after_m: float
) -> float:
    """Bound of the power diffracted by an edge: |F| <= 1, |R| <= 1, terms as on their boundaries.

    A ray that meets the edge at a slant is farther away and weaker, by its sine in all.

    Args:
        phi: Angle of the observer from the 0-face.
        phi_source: Angle of the source from there.
        gap: Open angle of the wedge [rad].
        wavenumber: 2 pi over the wavelength [1/m].
        before_m: Distance of the source from the line of the edge, unfolded.
        after_m: Distance of the observer from it.
    """
    n = gap / np.pi
    limit = n * np.sqrt(2 * np.pi * wavenumber * before_m * after_m / (before_m + after_m))
    total = 0.0
    for sign in (-1.0, 1.0):
        for beta in (phi - phi_source, phi + phi_source):
            tangent = abs(np.tan((np.pi + sign * beta) / (2 * n)))
            total += min(limit, 1 / tangent if tangent > 0 else limit)
    amplitude = 1.02 * total / (2 * n * np.sqrt(2 * np.pi * wavenumber)) / (2 * wavenumber)
    return amplitude * amplitude / (before_m * after_m * (before_m + after_m))


@compiled
def close_edge_bound(
    phi: float,
    phi_source: float,
    gap: float,
    wavenumber: float,
    before_m: float,
    after_m: float,
    sin_b0: float,
    faces: tuple[float, float],
) -> float:
    """Closer bound of that power, by the transition functions and the largest reflection of the faces.

    Args:
        phi: Angle of the observer from the 0-face.
        phi_source: Angle of the source from there.
        gap: Open angle of the wedge [rad].
        wavenumber: 2 pi over the wavelength [1/m].
        before_m: Length of the ray before the edge, unfolded.
        after_m: Length of the ray behind it.
        sin_b0: Sine of the angle between ray and edge.
        faces: Most of a field that 0-face and n-face reflect.
    """
    together = before_m + after_m
    distance_m = before_m * after_m / together * sin_b0 * sin_b0
    parts = wedge_terms(phi, phi_source, gap / np.pi, wavenumber, distance_m, sin_b0, 0.0)
    sum_of_parts = abs(parts[0]) + faces[0] * abs(parts[1]) + faces[1] * abs(parts[2])
    amplitude = 1.02 * sum_of_parts / (2 * wavenumber)
    return amplitude * amplitude / (before_m * after_m * together)
