"""Diffuse scattering by rough walls: how much of what a wall would reflect leaves it in other directions, and which.

Of the power that a smooth wall would reflect, |r|^2 of what falls on it, a share S^2 is scattered (S is the scattering
coefficient) and the rest, 1 - S^2, is reflected; what the wall transmits or absorbs does not change, so that energy is
conserved. The directive model puts a single lobe around the reflected direction, of power per solid angle
    p = f / F,   f = ((1 + cos psi) / 2)^alpha,   F = integral of f over the half-space before the wall,
psi the angle from the reflected direction; alpha = 0 is the same power everywhere. Lambert's law is f = cos(theta_s)
and F = pi.
With isotropic antennas a piece of wall of area dA, seen from the transmitter at r_i under theta_i from its normal and
from the receiver at r_s, adds the power gain
    g = (lambda / 4 pi)^2 S^2 |r|^2 p cos(theta_i) dA / (r_i r_s)^2.
A lobe of finite width is normalised by the direction of incidence, so that the directive model is not reciprocal away
from it: the two directions differ by cos(theta_i) F(theta_s) / (cos(theta_s) F(theta_i)), as the model is published.

Left out: backscattering lobe, depolarisation, scattering of what was transmitted.
Reference: V. Degli-Esposti et al., IEEE Trans. Antennas Propag. 55 (2007), equations 4 to 10.
"""

from math import comb

import numpy as np
from jaxtyping import Float

#: Largest exponent of a lobe: 3 degrees of half-power width.
MOST_NARROW = 1000


def lobe(
    cos_psi: Float[np.ndarray, "*batch"], cos_s: Float[np.ndarray, "*batch"], alpha: int | None
) -> Float[np.ndarray, "*batch"]:
    """Shape f by cosines of angles from the reflected direction and the normal; alpha None: Lambert's law."""
    return cos_s if alpha is None else ((1 + cos_psi) / 2) ** alpha


def lobe_integral(cos_i: Float[np.ndarray, "*batch"], alpha: int | None) -> Float[np.ndarray, "*batch"]:
    """F: the shape's integral over the half-space before the wall.

    F = 2^-alpha sum over j of C(alpha, j) I_j, where I_j is 2 pi / (j + 1), times cos(theta_i) sum over w up to
    (j - 1) / 2 of C(2w, w) (sin(theta_i) / 2)^2w if j is odd.

    Args:
        cos_i: Cosine of the angle of incidence.
        alpha: See `lobe`.
    """
    if alpha is None:
        return np.full(cos_i.shape, np.pi)
    sine_squared = 1 - cos_i**2
    # All factors stay within 1: C(alpha, j) / 2^alpha is a binomial distribution, C(2w, w) / 4^w at most 1.
    series, power, total = np.zeros_like(cos_i), np.ones_like(cos_i), np.zeros_like(cos_i)
    for j in range(alpha + 1):
        odd = j % 2 == 1
        if odd:
            w = (j - 1) // 2
            series = series + float(comb(2 * w, w) / 4**w) * power
            power = power * sine_squared
        total += comb(alpha, j) / 2**alpha * 2 * np.pi / (j + 1) * (cos_i * series if odd else 1.0)
    return total
