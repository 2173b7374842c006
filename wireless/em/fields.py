"""Field along a radio path: two polarisations carried through reflections and an edge.

A path is its points. The field starts as one of the two unit vectors theta (downwards at the horizon) and
phi (counter-clockwise) of the departure direction, is turned and weakened at each point, and is read along
theta and phi of the arrival direction, which points from the receiver back along the path: so a free path
has gain +1 for theta to theta and -1 for phi to phi (straight up and down, where azimuth is 0, the reverse).
All is times lambda / (4 pi r) e^(-j k r) between isotropic antennas, r the unfolded length, and behind an
edge lambda / (4 pi) e^(-j k (s' + s)) / sqrt(s' s (s' + s)) D. Paths shorter than lambda / (2 pi), within the
reactive near field, are as strong as at that length (-6 dB): no more arrives than was sent.

Walls are half-spaces or layers, the same from both sides. At an edge the field
splits along and around it (b0 and phi of UTD); the two faces reflect as whole walls would, with their plane
of incidence, also when the ray meets the edge at a slant.

Left out: walls whose sides differ, antennas (`wireless.antennas.elements`), more than one edge per path.
References: ITU-R P.2040-4, equation (37) (see `wireless.em.fresnel`); `wireless.em.diffraction`.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from robosim.support.compiled import compiled
from wireless.em.diffraction import wedge_terms
from wireless.em.fresnel import fresnel

REFLECTION, DIFFRACTION, SCATTERING, TRANSMISSION = 1, 2, 3, 4
#: Legs of paths shorter than this have no direction [m].
NOWHERE_M = 1e-9


class Path(NamedTuple):
    """A path, of which the first interactions count."""

    point: Float[np.ndarray, "m2 3"]
    """Transmitter, interaction points, receiver [m]."""
    kind: Int[np.ndarray, " m"]
    """`REFLECTION`, `DIFFRACTION` or `TRANSMISSION` at each interaction point."""
    normal: Float[np.ndarray, "m 3"]
    """Unit normals of the walls that are met, of any side."""
    walls: Complex[np.ndarray, "m l"]
    """Their layers, see `wireless.em.fresnel.fresnel`."""
    share: Float[np.ndarray, " m"]
    """Exponents of their transmission ratios, see `meet_wall`."""


class Wedge(NamedTuple):
    """An edge and its two faces."""

    axes: Float[np.ndarray, "3 3"]
    """Unit vectors along the edge, along the 0-face away from it, and normal to that face."""
    n: float
    """Open angle over pi."""
    walls: Complex[np.ndarray, "2 l"]
    """Layers of 0-face and n-face, see `wireless.em.fresnel.fresnel`."""
    bisector: bool
    """Which angle of incidence the faces reflect at, see `_face_ratios`."""


@compiled
def meet_wall(
    field: Complex[np.ndarray, "2 3"],
    ray: Float[np.ndarray, "3"],
    normal: Float[np.ndarray, "3"],
    wall: Complex[np.ndarray, " l"],
    wavenumber: float,
    through: bool,
    share: float,
) -> None:
    """Turn two fields into what a wall reflects or transmits, in place.

    Args:
        field: Electric fields of the incoming wave.
        ray: Unit direction of the incoming wave.
        normal: Unit normal of the wall, of any side.
        wall: Its layers, see `wireless.em.fresnel.fresnel`.
        wavenumber: 2 pi over the wavelength [1/m].
        through: Whether the wave goes on rather than being reflected.
        share: Exponent of the transmission ratios, 0.5 for each of the two faces of one wall.
    """
    c = ray[0] * normal[0] + ray[1] * normal[1] + ray[2] * normal[2]
    te, tm, t_te, t_tm = fresnel(min(abs(c), 1.0), wall, wavenumber)
    if through:
        te, tm, c = t_te, t_tm, 0.0  # straight on: the direction behind is the one before
        if share != 1.0:
            te, tm = te**share if te != 0 else te, tm**share if tm != 0 else tm
    sx = ray[1] * normal[2] - ray[2] * normal[1]
    sy = ray[2] * normal[0] - ray[0] * normal[2]
    sz = ray[0] * normal[1] - ray[1] * normal[0]
    size = np.sqrt(sx * sx + sy * sy + sz * sz)
    if size < 1e-12:  # along the normal: no plane of incidence, and both ratios agree
        for q in range(2):
            for i in range(3):
                field[q, i] *= te
        return
    sx, sy, sz = sx / size, sy / size, sz / size
    ox, oy, oz = ray[0] - 2 * c * normal[0], ray[1] - 2 * c * normal[1], ray[2] - 2 * c * normal[2]
    px, py, pz = sy * ray[2] - sz * ray[1], sz * ray[0] - sx * ray[2], sx * ray[1] - sy * ray[0]
    rx, ry, rz = sy * oz - sz * oy, sz * ox - sx * oz, sx * oy - sy * ox
    for q in range(2):
        s = te * (field[q, 0] * sx + field[q, 1] * sy + field[q, 2] * sz)
        p = tm * (field[q, 0] * px + field[q, 1] * py + field[q, 2] * pz)
        field[q, 0], field[q, 1], field[q, 2] = s * sx + p * rx, s * sy + p * ry, s * sz + p * rz


@compiled
def _cross(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"], out: Float[np.ndarray, "3"]) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@compiled
def _dot(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _angle(ray: Float[np.ndarray, "3"], wedge: Float[np.ndarray, "3 3"], n: float) -> float:
    """Angle of a direction from the 0-face, within [0, n pi]."""
    angle = np.arctan2(_dot(ray, wedge[2]), _dot(ray, wedge[1]))
    if angle < 0:
        angle += 2 * np.pi
    if angle > np.pi * (n / 2 + 1):  # just behind the 0-face
        angle = 0.0
    return min(angle, n * np.pi)


@compiled
def _face_ratios(
    phi: float,
    phi_source: float,
    cos_b0: float,
    sin_b0: float,
    wall: Complex[np.ndarray, " l"],
    wavenumber: float,
    bisector: bool,
) -> tuple[complex, complex, complex]:
    """Reflection of a face in the coordinates of its edge, angles counted from that face."""
    # With r_te and r_tm at the face's angle of incidence and (a, b) the direction of TE in (b0, phi), the dyad is (b0
    # from b0) = b^2 r_tm - a^2 r_te, (phi from phi) = b^2 r_te - a^2 r_tm and (b0 from phi) = -(phi from b0) = a b
    # (r_te + r_tm). Away from the reflection boundary a b is the mean of source and observer.
    # The angle of incidence is that of the nearer of source and observer, or (`bisector`) that at which a plane mirror
    # would turn the incoming ray into the outgoing one. On the reflection boundary these are the same.
    sine = abs(np.cos((phi - phi_source) / 2)) if bisector else np.sin(min(phi, phi_source))
    cos_i = min(abs(sin_b0 * sine), 1.0)
    te, tm, _, _ = fresnel(cos_i, wall, wavenumber)
    q2 = 1 - cos_i * cos_i
    if q2 < 1e-14:
        return -te, -tm, 0j
    bb = cos_b0 * cos_b0 * sine * sine / q2
    ab = cos_b0 * sine * (np.cos(phi_source) - np.cos(phi)) / (2 * q2)
    return bb * tm - (1 - bb) * te, bb * te - (1 - bb) * tm, ab * (te + tm)


@compiled
def diffract(
    field: Complex[np.ndarray, "2 3"],
    ray: Float[np.ndarray, "3"],
    out: Float[np.ndarray, "3"],
    wedge: Wedge,
    wavenumber: float,
    legs_m: tuple[float, float],
    work: Float[np.ndarray, "4 3"],
) -> None:
    """Turn two fields into what an edge sends into a direction, in place; spreading is left to the caller.

    Args:
        field: Electric fields of the incoming wave.
        ray: Unit direction of the incoming wave.
        out: Unit direction of the outgoing wave, at the same angle to the edge.
        wedge: The edge.
        wavenumber: 2 pi over the wavelength [1/m].
        legs_m: Unfolded distances s' from the source and s to the observer.
        work: Room for vectors.
    """
    edge, n, bisector, (before_m, after_m) = wedge.axes[0], wedge.n, wedge.bisector, legs_m
    cos_b0 = _dot(ray, edge)
    sin_b0 = np.sqrt(max(1 - cos_b0 * cos_b0, 1e-12))
    for i in range(3):
        work[0, i] = -ray[i]
    phi_source, phi = _angle(work[0], wedge.axes, n), _angle(out, wedge.axes, n)
    distance = before_m * after_m * sin_b0 * sin_b0 / (before_m + after_m)
    tie = NOWHERE_M * (1 / before_m + 1 / after_m) / sin_b0
    direct, on_0, on_n = wedge_terms(phi, phi_source, n, wavenumber, distance, sin_b0, tie)
    bb_0, ff_0, bf_0 = _face_ratios(phi, phi_source, cos_b0, sin_b0, wedge.walls[0], wavenumber, bisector)
    bb_n, ff_n, bf_n = _face_ratios(
        n * np.pi - phi, n * np.pi - phi_source, -cos_b0, sin_b0, wedge.walls[1], wavenumber, bisector
    )
    d_bb = -direct + on_0 * bb_0 + on_n * bb_n
    d_ff = -direct + on_0 * ff_0 + on_n * ff_n
    d_bf = on_0 * bf_0 + on_n * bf_n
    _cross(ray, edge, work[0])  # phi of the source, against e x s'
    _cross(edge, out, work[2])  # phi of the observer
    for i in range(3):
        work[0, i] /= sin_b0
        work[2, i] /= sin_b0
    _cross(work[0], ray, work[1])
    _cross(work[2], out, work[3])
    for q in range(2):
        f = field[q, 0] * work[0, 0] + field[q, 1] * work[0, 1] + field[q, 2] * work[0, 2]
        b = field[q, 0] * work[1, 0] + field[q, 1] * work[1, 1] + field[q, 2] * work[1, 2]
        to_b, to_f = d_bb * b + d_bf * f, d_ff * f - d_bf * b
        for i in range(3):
            field[q, i] = to_b * work[3, i] + to_f * work[2, i]


@compiled
def _spherical(
    ray: Float[np.ndarray, "3"], theta: Float[np.ndarray, "3"], phi: Float[np.ndarray, "3"]
) -> None:
    """Unit vectors of polar angle and azimuth at a direction; azimuth 0 straight up and down."""
    level = np.sqrt(ray[0] * ray[0] + ray[1] * ray[1])
    c, s = (ray[0] / level, ray[1] / level) if level > 1e-15 else (1.0, 0.0)
    theta[0], theta[1], theta[2] = ray[2] * c, ray[2] * s, -level
    phi[0], phi[1], phi[2] = -s, c, 0.0


@compiled
def _lengths(path: Path, count: int) -> tuple[float, float]:
    """Length of a path of `count` interactions, and of its part before the edge (-1 without one) [m]."""
    # The length is -1 for a path that starts, ends or diffracts at no distance.
    total, before = 0.0, -1.0
    for j in range(count + 1):
        step = 0.0
        for i in range(3):
            step += (path.point[j + 1, i] - path.point[j, i]) ** 2
        step = np.sqrt(step)
        # Two reflections in one point, in a corner of the room, are fine.
        if step < NOWHERE_M and (
            j == 0 or j == count or path.kind[j - 1] == DIFFRACTION or path.kind[j] == DIFFRACTION
        ):
            return -1.0, before
        total += step
        if j < count and path.kind[j] == DIFFRACTION:
            before = total
    return total, before


@compiled
def path_gain(
    path: Path,
    count: int,
    wedge: Wedge,
    wavenumber: float,
    gain: Complex[np.ndarray, "2 2"],
    work: Float[np.ndarray, "8 3"],
    field: Complex[np.ndarray, "2 3"],
) -> float:
    """Gain of one path of at most one diffraction.

    Args:
        path: The path.
        count: Number of its interactions.
        wedge: Its edge; any values on paths without diffraction.
        wavenumber: 2 pi over the wavelength [1/m].
        gain: Takes the result: [theta, phi at the receiver, theta, phi at the transmitter].
        work: Room for vectors.
        field: Room for two fields.

    Returns:
        Unfolded length [m]; -1, with no gain set, for a path that starts, ends or diffracts at no distance.
    """
    total, before = _lengths(path, count)
    if total < 0:
        return -1.0
    ray, out = work[4], work[5]
    _unit(path.point, 0, ray)
    _spherical(ray, work[6], work[7])
    for i in range(3):
        field[0, i], field[1, i] = work[6, i], work[7, i]
    for j in range(count):
        if path.kind[j] != DIFFRACTION:
            through, normal = path.kind[j] == TRANSMISSION, path.normal[j]
            meet_wall(field, ray, normal, path.walls[j], wavenumber, through, path.share[j])
            c = 0.0 if through else 2 * _dot(ray, normal)
            for i in range(3):
                out[i] = ray[i] - c * normal[i]
        else:
            _unit(path.point, j + 1, out)
            diffract(field, ray, out, wedge, wavenumber, (before, total - before), work[:4])
        for i in range(3):
            ray[i] = out[i]
    spread = 1 / total
    if before > 0:
        spread = 1 / np.sqrt(before * (total - before) * total)
    spread *= min(1.0, wavenumber * total)  # nearer than the far field begins, no stronger
    factor = spread / (2 * wavenumber) * np.exp(-1j * wavenumber * total)
    for i in range(3):
        out[i] = -ray[i]
    _spherical(out, work[6], work[7])
    for q in range(2):
        for p in range(2):
            gain[p, q] = factor * (
                field[q, 0] * work[6 + p, 0] + field[q, 1] * work[6 + p, 1] + field[q, 2] * work[6 + p, 2]
            )
    return total


@compiled
def _unit(points: Float[np.ndarray, "p 3"], j: int, out: Float[np.ndarray, "3"]) -> None:
    """Unit vector from point j to the next."""
    size = 0.0
    for i in range(3):
        out[i] = points[j + 1, i] - points[j, i]
        size += out[i] * out[i]
    size = np.sqrt(size)
    for i in range(3):
        out[i] /= size
