"""Plane waves at half-spaces, slabs and cavity walls in closed form, in NumPy, to compare `wireless.em.fresnel` with.

Symbols and signs are those of `wireless.em.fresnel`.
"""

import numpy as np
from jaxtyping import Complex, Float
from scipy.constants import speed_of_light

#: Of reflection and transmission: r_te, r_tm, t_te, t_tm.
Ratios = tuple[
    Complex[np.ndarray, "*batch"],
    Complex[np.ndarray, "*batch"],
    Complex[np.ndarray, "*batch"],
    Complex[np.ndarray, "*batch"],
]


def reflection(
    cos_i: Float[np.ndarray, "*batch"], eps: complex | Complex[np.ndarray, "*batch"]
) -> tuple[Complex[np.ndarray, "*batch"], Complex[np.ndarray, "*batch"]]:
    """Fresnel reflection ratios of a half-space met from vacuum.

    Args:
        cos_i: Cosine of the angle between ray and wall normal, in [0, 1].
        eps: Relative permittivity, Im(eps) <= 0.

    Returns:
        r_te, r_tm: Reflected over incident electric field. Square the magnitude for power.

    Raises:
        ValueError: If a cosine is not in [0, 1], or Im(eps) > 0, which would be a wall with gain.
    """
    p = _normal_wavenumber(cos_i, eps)
    return _ratio(cos_i - p, cos_i + p), _ratio(eps * cos_i - p, eps * cos_i + p)


def slab(
    cos_i: Float[np.ndarray, "*batch"],
    eps: complex | Complex[np.ndarray, "*batch"],
    thickness_m: float,
    frequency_hz: float,
) -> Ratios:
    """Reflection and transmission ratios of a single layer in vacuum.

    Args:
        cos_i: Cosine of the angle between ray and wall normal, in [0, 1].
        eps: Relative permittivity of the layer, Im(eps) <= 0.
        thickness_m: Thickness of the layer.
        frequency_hz: Frequency of the wave.

    Returns:
        r_te, r_tm: Reflected over incident electric field, both at the face that the wave meets.
        t_te, t_tm: Field at the other face over incident field at the nearest point of the first face. A ray
            drawn straight on has the phase -k d cos(i) of that distance in vacuum already: subtract it there.

    Raises:
        ValueError: If thickness or frequency are not positive, a cosine is not in [0, 1], or Im(eps) > 0.
    """
    for name, value in (("thickness_m", thickness_m), ("frequency_hz", frequency_hz)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} is {value}, expected a positive number.")
    k = 2 * np.pi * frequency_hz / speed_of_light
    once = np.exp(-1j * k * thickness_m * _normal_wavenumber(cos_i, eps))
    half_te, half_tm = reflection(cos_i, eps)
    reflected = [r * (1 - once**2) / (1 - r**2 * once**2) for r in (half_te, half_tm)]
    through = [(1 - r**2) * once / (1 - r**2 * once**2) for r in (half_te, half_tm)]
    return reflected[0], reflected[1], through[0], through[1]


def cavity_wall(
    cos_i: Float[np.ndarray, "*batch"],
    eps: complex | Complex[np.ndarray, "*batch"],
    thickness_m: float,
    gap_m: float,
    frequency_hz: float,
) -> Ratios:
    """Reflection and transmission ratios of two equal layers with air between, such as two plasterboards.

    Args:
        cos_i: Cosine of the angle between ray and wall normal, in [0, 1].
        eps: Relative permittivity of the layers.
        thickness_m: Thickness of each layer.
        gap_m: Width of the air between.
        frequency_hz: Frequency of the wave.

    Returns:
        r_te, r_tm, t_te, t_tm: As of `slab`, for the whole wall.

    Raises:
        ValueError: As of `slab`, or if the gap is negative.
    """
    if not (np.isfinite(gap_m) and gap_m >= 0):
        raise ValueError(f"gap_m is {gap_m}, expected 0 or more.")
    r_te, r_tm, t_te, t_tm = slab(cos_i, eps, thickness_m, frequency_hz)
    once = np.exp(-2j * np.pi * frequency_hz / speed_of_light * gap_m * cos_i)
    in_te, in_tm = (_ratio(t**2, 1 - r**2 * once**2) for r, t in ((r_te, t_te), (r_tm, t_tm)))
    return r_te * (1 + in_te * once**2), r_tm * (1 + in_tm * once**2), in_te * once, in_tm * once


def _normal_wavenumber(
    cos_i: Float[np.ndarray, "*batch"], eps: complex | Complex[np.ndarray, "*batch"]
) -> Complex[np.ndarray, "*batch"]:
    """sqrt(eps - sin^2 i): wavenumber in the wall along its normal, over that of vacuum; decays inwards."""
    if not np.all((cos_i >= 0) & (cos_i <= 1)):
        raise ValueError(
            f"cos_i reaches from {np.min(cos_i)} to {np.max(cos_i)}, expected [0, 1]: turn the normal "
            "towards the incoming ray."
        )
    if not np.all(np.imag(eps) <= 0):
        raise ValueError(
            f"Im(eps) is {np.max(np.imag(eps))}, expected at most 0: fields vary as exp(+j omega t), "
            "where losses are negative."
        )
    p = np.sqrt(eps - (1 - cos_i**2) + 0j)
    return np.where(p.imag > 0, -p, p)


def _ratio(
    above: Complex[np.ndarray, "*batch"], below: Complex[np.ndarray, "*batch"]
) -> Complex[np.ndarray, "*batch"]:
    """Quotient, 0 where both are 0: a wave along a wall's face."""
    return np.divide(above, below, out=np.zeros_like(above), where=below != 0)
