"""Field of a line source next to a homogeneous cylinder, exactly.

With a source on the x axis at the distance s from the axis of a cylinder of the radius a, the field at (r, phi) is
    H0(k |r - s|) - sum over n of b_n Hn(k s) Hn(k r) e^(j n phi)
in Hankel functions of the second kind (time factor e^(j omega t)), where b_n keeps the field and its tangential
derivative continuous at r = a:
    b_n = (Jn(ka) - q_n Jn'(ka)) / (Hn(ka) - q_n Hn'(ka)),   q_n = m Jn(k1 a) / Jn'(k1 a),
with k1 = k sqrt(eps), and m = 1 / sqrt(eps) if the electric field is parallel to the axis, sqrt(eps) if the magnetic
field is. Reference: Balanis, Advanced Engineering Electromagnetics, 2nd ed., sections 11.5 and 11.6.
"""

import numpy as np
from jaxtyping import Complex, Float
from scipy.special import h2vp, hankel2, jv, jve, jvp

#: Orders beyond the size of the cylinder in radians, in units of its cube root, and at least.
MORE, LEAST = 12.0, 20


def cylinder_field(
    radius: float,
    eps: complex,
    source: float | Float[np.ndarray, " n"],
    observers: Float[np.ndarray, "n 2"],
    *,
    parallel: bool,
) -> Complex[np.ndarray, " n"]:
    """Field over that without the cylinder, lengths as 2 pi / wavelength times metres.

    Args:
        radius: Radius of the cylinder.
        eps: Relative permittivity, with a negative imaginary part for losses.
        source: Distance of the source from the axis, on the positive x axis, for all observers or for each.
        observers: Places outside of the cylinder.
        parallel: Whether the electric field is parallel to the axis, instead of the magnetic one.
    """
    b = coefficients(radius, eps, parallel=parallel)
    n = np.arange(len(b))
    r, phi = np.hypot(*observers.T), np.arctan2(observers[:, 1], observers[:, 0])
    terms = np.where(n, 2.0, 1.0) * b * hankel2(n, np.asarray(source)[..., None])
    scattered = (hankel2(n, r[:, None]) * np.cos(n * phi[:, None]) * terms).sum(axis=1)
    return 1 - scattered / hankel2(0, np.hypot(observers[:, 0] - source, observers[:, 1]))


def coefficients(radius: float, eps: complex, *, parallel: bool) -> Complex[np.ndarray, " orders"]:
    """b_n from the order 0 on, as far as they count."""
    n = np.arange(int(radius + MORE * np.cbrt(radius)) + LEAST)
    inside = radius * np.sqrt(complex(eps))
    slope = 0.5 * (jve(n - 1, inside) - jve(n + 1, inside))
    q = jve(n, inside) / slope * (1 / np.sqrt(complex(eps)) if parallel else np.sqrt(complex(eps)))
    return (jv(n, radius) - q * jvp(n, radius)) / (hankel2(n, radius) - q * h2vp(n, radius))
