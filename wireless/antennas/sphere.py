"""Directions on the unit sphere, and means over it."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float


def unit_vector(
    azimuth_rad: Float[np.ndarray, "*batch"], elevation_rad: Float[np.ndarray, "*#batch"]
) -> Float[np.ndarray, "*batch 3"]:
    """Direction of an azimuth (counter-clockwise from +x) and an elevation (up from the horizon)."""
    level = np.cos(elevation_rad)
    ahead = level * np.cos(azimuth_rad)
    direction = np.empty((*ahead.shape, 3))
    direction[..., 0], direction[..., 1] = ahead, level * np.sin(azimuth_rad)
    direction[..., 2] = np.sin(elevation_rad)
    return direction


def sphere(order: int = 64) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Directions and weights (of sum 1) whose weighted sum is the mean over the sphere.

    Gauss-Legendre in x for each half space, since elements end at their ground plane, and equal steps about
    x: exact for polynomials of degree 2 order - 1 in front and behind.
    """
    node, weight = np.polynomial.legendre.leggauss(order)
    x = np.concatenate([(node - 1) / 2, (node + 1) / 2])
    turn = 2 * np.pi * (np.arange(2 * order) + 0.5) / (2 * order)
    ring = np.sqrt(1 - x**2)
    direction = np.stack(
        [
            np.broadcast_to(x[:, None], (len(x), len(turn))),
            ring[:, None] * np.cos(turn),
            ring[:, None] * np.sin(turn),
        ],
        axis=-1,
    )
    share = np.repeat(np.concatenate([weight, weight]) / 4 / len(turn), len(turn))
    return direction.reshape(-1, 3), share


def mean_over_sphere(
    value: Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]], order: int = 64
) -> float:
    """Mean over the sphere of a function of unit vectors; `order` is the fineness of `sphere`."""
    node, share = sphere(order)
    # The sum of a product: BLAS adds in an order that depends on the number of threads.
    return float((share * value(node)).sum())
