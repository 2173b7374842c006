"""Arrays from what users give."""

import numpy as np
from jaxtyping import Float, Shaped
from numpy.typing import ArrayLike


def to_array(values: ArrayLike, name: str) -> Shaped[np.ndarray, "..."]:
    """Copy of a user's numbers as an array of floats; ValueError, which names them, if they are none or ragged."""
    try:
        return np.array(values, float)
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} is {str(values)[:60]}, expected numbers in an array or lists of equal length."
        ) from None


def to_positions(values: ArrayLike, name: str) -> Float[np.ndarray, "n 3"]:
    """Positions [m] of a user as an array; ValueError, which names them, if there are none or one is not finite."""
    points = to_array(values, name)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
        raise ValueError(
            f"{name} has shape {points.shape}, expected (n, 3), one or more finite positions [m]."
        )
    return points
