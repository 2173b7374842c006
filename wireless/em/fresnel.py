"""Fresnel reflection coefficients and transmission coefficients of half-spaces and layered slabs.

The field splits into TE (normal to the plane of incidence) and TM (in that plane). A wall of relative
permittivity eps, met from vacuum at an angle i from its normal, reflects
    r_TE = (cos i - p) / (cos i + p),   r_TM = (eps cos i - p) / (eps cos i + p),   p = sqrt(eps - sin^2 i).
A slab of thickness d adds up the waves that go to and fro inside, each time with the phase q = k d p:
    r = r' (1 - e^(-2jq)) / (1 - r'^2 e^(-2jq)),   t = (1 - r'^2) e^(-jq) / (1 - r'^2 e^(-2jq)),
with r' of the half-space. Two such layers, a cavity wall, do the same with the air of width a between them,
    R = r (1 + t^2 g^2 / (1 - r^2 g^2)),   T = t^2 g / (1 - r^2 g^2),   g = e^(-jk a cos i).
Fields vary as exp(+j omega t), so that a lossy wall has Im(eps) < 0. Both reflection coefficients
go to -1 at grazing incidence; at normal incidence they are opposite, since TM then counts the reflected field
along the direction that is mirrored.

Layers that differ are put together from the last to the first.

Left out: roughness, diffuse scattering, walls that end.
Reference: Recommendation ITU-R P.2040-4 (09/2025), equations (37), (43) and (44).
"""

import numpy as np
from jaxtyping import Complex

from robosim.support.compiled import compiled


@compiled
def fresnel(
    cos_i: float, wall: Complex[np.ndarray, " l"], wavenumber: float
) -> tuple[complex, complex, complex, complex]:
    """Reflection coefficients r_te, r_tm and transmission coefficients t_te, t_tm of a wall for one ray.

    A wall is the relative permittivity and thickness [m] of each of its layers in turn, zeros beyond the last
    (`wireless.em.materials.wall_row`). One layer of thickness 0 stands for a half-space. Transmission coefficients are
    over the field that would be there without the wall.
    """
    eps, thickness_m = wall[0], wall[1].real
    p = np.sqrt(eps - (1 - cos_i * cos_i) + 0j)
    if p.imag > 0:
        p = -p
    te, tm = cos_i + p, eps * cos_i + p
    r_te = (cos_i - p) / te if te != 0 else 0j
    r_tm = (eps * cos_i - p) / tm if tm != 0 else 0j
    if thickness_m == 0:
        return r_te, r_tm, 0j, 0j
    several = len(wall) > 2 and wall[2] != 0
    if several and not _is_cavity(wall):
        return _stack(cos_i, wall, wavenumber)
    once, free = np.exp(-1j * wavenumber * thickness_m * p), np.exp(1j * wavenumber * thickness_m * cos_i)
    many_te, many_tm = 1 - r_te**2 * once**2, 1 - r_tm**2 * once**2
    t_te, t_tm = (1 - r_te**2) * once / many_te, (1 - r_tm**2) * once / many_tm
    r_te, r_tm = r_te * (1 - once**2) / many_te, r_tm * (1 - once**2) / many_tm
    if not several:
        return r_te, r_tm, t_te * free, t_tm * free
    # A ratio to the free field needs no phase of the gap, which is that of the free field too.
    around = np.exp(-2j * wavenumber * wall[3].real * cos_i)
    many_te, many_tm = 1 - r_te**2 * around, 1 - r_tm**2 * around
    in_te = t_te**2 / many_te if many_te != 0 else 0j  # grazing: nothing gets in
    in_tm = t_tm**2 / many_tm if many_tm != 0 else 0j
    return r_te * (1 + in_te * around), r_tm * (1 + in_tm * around), in_te * free**2, in_tm * free**2


@compiled
def _is_cavity(wall: Complex[np.ndarray, " l"]) -> bool:
    """Whether a wall is two equal layers with air between, for which there is a closed form."""
    three = len(wall) >= 6 and wall[4] != 0 and (len(wall) == 6 or wall[6] == 0)
    return three and wall[2] == 1 and wall[0] == wall[4] and wall[1] == wall[5]


@compiled
def _stack(
    cos_i: float, wall: Complex[np.ndarray, " l"], wavenumber: float
) -> tuple[complex, complex, complex, complex]:
    """`fresnel` of any layers, from the last to the first (Parratt, Physical Review 95, 359, 1954)."""
    # With s and 1 + s of each boundary, what lies behind it with R and T, R' = (s + R) / (1 + s R) and T' = (1 + s) T /
    # (1 + s R); each layer then turns R by twice its phase and T by once. Of TM this is the magnetic field.
    count = len(wall) // 2
    while wall[2 * count - 2] == 0:
        count -= 1
    # Behind the last layer is air, as before the first.
    p_behind, eps_behind, total_m = cos_i + 0j, 1.0 + 0j, 0.0
    r_te, r_tm, t_te, t_tm = 0j, 0j, 1 + 0j, 1 + 0j
    for j in range(count, -1, -1):
        eps = wall[2 * j - 2] if j else 1.0 + 0j
        p = np.sqrt(eps - (1 - cos_i * cos_i) + 0j) if j else cos_i + 0j
        if p.imag > 0:
            p = -p
        te, tm = p + p_behind, eps_behind * p + eps * p_behind
        s_te = (p - p_behind) / te if te != 0 else 0j
        s_tm = (eps_behind * p - eps * p_behind) / tm if tm != 0 else 0j
        many_te, many_tm = 1 + s_te * r_te, 1 + s_tm * r_tm
        # Grazing: nothing gets in.
        t_te = (1 + s_te) * t_te / many_te if many_te != 0 else 0j
        t_tm = (1 + s_tm) * t_tm / many_tm if many_tm != 0 else 0j
        r_te = (s_te + r_te) / many_te if many_te != 0 else s_te
        r_tm = (s_tm + r_tm) / many_tm if many_tm != 0 else s_tm
        if j:
            thickness_m = wall[2 * j - 1].real
            once = np.exp(-1j * wavenumber * thickness_m * p)
            r_te, r_tm, t_te, t_tm = r_te * once**2, r_tm * once**2, t_te * once, t_tm * once
            total_m += thickness_m
        p_behind, eps_behind = p, eps
    free = np.exp(1j * wavenumber * total_m * cos_i)
    return r_te, r_tm, t_te * free, t_tm * free
