"""Blockage: how bodies near a path weaken it.

Each body is an upright screen through its axis, as wide and as high as the body, perpendicular to the horizontal
projection of each segment of a path. The gain of a path is multiplied by the factors of all bodies at all of its
segments (`wireless.em.screens`); delays, directions and interactions are those of the path without bodies.

The distances from a screen to both ends are those of the unfolded path: a wall mirrors the wave, while an edge or a
rough wall sends a new one. They are distances in space; TR 38.901 projects them onto the ground and onto the path's
vertical plane, which is the same for level paths.

Bodies beyond an end of a segment do not block it; within half a radius around that end, what they do to it changes
linearly. Screens farther from a path than `FADES_AT` first Fresnel radii have less effect, and beyond `ENDS_AT` none. A
body that contains the transmitter or the receiver carries it, and does not block the segment that ends there.

Left out: several screens close to each other, whose losses in decibels are added as in TR 38.901; the floor, which
closes the gap below the feet; bodies straight above or below a terminal, as vertical segments have no screen.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int, UInt8
from numpy.typing import ArrayLike
from scipy.constants import speed_of_light

from robosim.support.checks import check_choice
from robosim.support.compiled import compiled
from wireless.em.fields import DIFFRACTION, NOWHERE_M, SCATTERING
from wireless.em.screens import SCREEN_MODELS, edge_share
from wireless.motion.bodies import Bodies, people
from wireless.paths import Paths

#: The effect of an edge at these distances from the path begins to fade, and ends, in first Fresnel radii.
FADES_AT, ENDS_AT = 5.0, 10.0
#: Amplitudes below this are not distinguished (300 dB).
_LEAST = 1e-15


class Blockage(NamedTuple):
    """Blockage of paths by bodies."""

    factor: Complex[np.ndarray, " n"]
    """By which the gain of each path is multiplied."""
    body: Int[np.ndarray, " n"]
    """Body that weakens each path most; -1 if none does."""
    loss_db: Float[np.ndarray, " n"]
    """Loss by that body [dB]; 0 if there is none."""


def block(paths: Paths, bodies: Bodies | ArrayLike, model: str = "knife-edges") -> tuple[Paths, Blockage]:
    """Return the paths attenuated by bodies, strongest first again.

    Paths that no body affects keep every bit. Link states follow the powers: `link_state` of the given
    paths is that of the building, and of the returned ones that of the building with the bodies in it.

    Args:
        paths: Paths of any links.
        bodies: Bodies, also none; or the positions of people who stand, n x 2 or n x 3 numbers [m].
        model: A key of `wireless.em.screens.SCREEN_MODELS`.

    Returns:
        Paths, and what the bodies do to each of them, in the same order.

    Raises:
        ValueError: If there is no such model.
    """
    blockage = find_blockage(paths, bodies, model)
    if not (blockage.factor != 1).any():
        return paths, blockage
    weaker, by_power = weaken(paths, blockage.factor)
    return weaker, Blockage(*(column[by_power] for column in blockage))


def weaken(paths: Paths, factor: Complex[np.ndarray, " n"]) -> tuple[Paths, Int[np.ndarray, " n"]]:
    """Paths with their gains multiplied by factors, strongest first again, and their numbers before."""
    met = factor != 1
    gain, power = paths.gain.copy(), paths.power.copy()
    gain[met] *= factor[met, None, None]
    power[met] *= np.abs(factor[met]) ** 2
    weaker = replace(paths, gain=gain, power=power)
    by_power = np.lexsort((-weaker.power, weaker.link))
    return weaker.select(by_power), by_power


def find_blockage(paths: Paths, bodies: Bodies | ArrayLike, model: str = "knife-edges") -> Blockage:
    """Compute the blockage of each path by bodies, in the order of the paths; see `block`."""
    check_choice("model", model, tuple(SCREEN_MODELS))
    bodies = bodies if isinstance(bodies, Bodies) else people(bodies)
    n = len(paths)
    blockage = Blockage(np.ones(n, complex), np.full(n, -1), np.zeros(n))
    if n and len(bodies):
        _find(
            paths.corners(),
            paths.order,
            paths.interaction,
            (bodies.position, bodies.radius_m, bodies.height_m),
            speed_of_light / paths.frequency_hz,
            SCREEN_MODELS[model],
            blockage.factor,
            blockage.body,
            blockage.loss_db,
        )
    return blockage


@compiled
def _find(
    corners: Float[np.ndarray, "n m2 3"],
    order: UInt8[np.ndarray, " n"],
    interaction: UInt8[np.ndarray, "n m"],
    bodies: tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, " k"], Float[np.ndarray, " k"]],
    wavelength_m: float,
    phases: bool,
    factor: Complex[np.ndarray, " n"],
    body: Int[np.ndarray, " n"],
    loss_db: Float[np.ndarray, " n"],
) -> None:
    """Fill the columns of a `Blockage`."""
    before, after = np.empty(corners.shape[1]), np.empty(corners.shape[1])
    for i in range(len(order)):
        last, corner = int(order[i]), corners[i]
        _unfold(corner, interaction[i], last, before, after)
        for k in range(len(bodies[1])):
            feet, radius_m, height_m = bodies[0][k], bodies[1][k], bodies[2][k]
            product = 1.0 + 0.0j
            for j in range(last + 1):
                if j == 0 and _contains(feet, radius_m, height_m, corner[j]):
                    continue
                if j == last and _contains(feet, radius_m, height_m, corner[j + 1]):
                    continue
                ends_m = before[j], after[j]
                product *= _factor(
                    corner[j], corner[j + 1], ends_m, feet, radius_m, height_m, wavelength_m, phases
                )
            loss = -20 * np.log10(max(abs(product), _LEAST))
            if loss > loss_db[i]:
                loss_db[i], body[i] = loss, k
            factor[i] *= product


@compiled
def _unfold(
    corner: Float[np.ndarray, "m2 3"],
    kind: UInt8[np.ndarray, " m"],
    last: int,
    before: Float[np.ndarray, " m2"],
    after: Float[np.ndarray, " m2"],
) -> None:
    """Lengths of the wave before and after each segment."""
    sum_before, sum_after = 0.0, 0.0
    for j in range(last + 1):
        before[j], after[last - j] = sum_before, sum_after
        sum_before += np.sqrt(((corner[j + 1] - corner[j]) ** 2).sum())
        sum_after += np.sqrt(((corner[last - j + 1] - corner[last - j]) ** 2).sum())
        if j < last and (kind[j] == DIFFRACTION or kind[j] == SCATTERING):
            sum_before = 0.0
        if j < last and (kind[last - 1 - j] == DIFFRACTION or kind[last - 1 - j] == SCATTERING):
            sum_after = 0.0


@compiled
def _contains(
    feet: Float[np.ndarray, "3"], radius_m: float, height_m: float, point: Float[np.ndarray, "3"]
) -> bool:
    """Whether a point is inside of a body."""
    level = np.hypot(point[0] - feet[0], point[1] - feet[1])
    return level <= radius_m and feet[2] <= point[2] <= feet[2] + height_m


@compiled
def _factor(
    a: Float[np.ndarray, "3"],
    b: Float[np.ndarray, "3"],
    ends_m: tuple[float, float],
    feet: Float[np.ndarray, "3"],
    radius_m: float,
    height_m: float,
    wavelength_m: float,
    phases: bool,
) -> complex:
    """Compute the factor of a body on the segment from a to b of a wave that goes on by ends_m beyond both ends."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    level = np.hypot(x, y)
    if level < NOWHERE_M:
        return 1.0 + 0.0j
    along = ((feet[0] - a[0]) * x + (feet[1] - a[1]) * y) / level
    inside = min(max(along / radius_m + 0.5, 0.0), 1.0) * min(max((level - along) / radius_m + 0.5, 0.0), 1.0)
    if inside == 0.0:
        return 1.0 + 0.0j
    offset = ((feet[0] - a[0]) * y - (feet[1] - a[1]) * x) / level
    share = min(max(along / level, 0.0), 1.0)
    length = np.sqrt(level * level + z * z)
    d1, d2, rise = ends_m[0] + share * length, ends_m[1] + (1 - share) * length, z / length
    foot = feet[2] - a[2] - share * z
    left = _parameter(offset - radius_m, d1, d2, 0.0, wavelength_m)
    right = _parameter(offset + radius_m, d1, d2, 0.0, wavelength_m)
    low = _parameter(foot, d1, d2, rise, wavelength_m)
    high = _parameter(foot + height_m, d1, d2, rise, wavelength_m)
    inside *= _nearness(left, right) * _nearness(low, high)
    if inside == 0.0:
        return 1.0 + 0.0j
    width = edge_share(right, phases) - edge_share(left, phases)
    height = edge_share(high, phases) - edge_share(low, phases)
    return 1.0 - inside * width * height


@compiled
def _parameter(h: float, d1: float, d2: float, rise: float, wavelength_m: float) -> float:
    """Fresnel parameter of an edge at h from a path that rises at this sine toward h."""
    # The difference of two long distances, each without loss of digits.
    first, second = h * (h + 2 * d1 * rise), h * (h - 2 * d2 * rise)
    excess = first / (np.sqrt(max(d1 * d1 + first, 0.0)) + d1 + 1e-300)
    excess += second / (np.sqrt(max(d2 * d2 + second, 0.0)) + d2 + 1e-300)
    return np.sign(h) * 2 * np.sqrt(max(excess, 0.0) / wavelength_m)


@compiled
def _nearness(v1: float, v2: float) -> float:
    """1 between two edges and near them, 0 far away."""
    radii = max(v1, -v2, 0.0) / np.sqrt(2.0)
    return min(max((ENDS_AT - radii) / (ENDS_AT - FADES_AT), 0.0), 1.0)
