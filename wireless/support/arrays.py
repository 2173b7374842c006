"""Arrays from what users give."""

import numpy as np
from jaxtyping import Shaped
from numpy.typing import ArrayLike


def to_array(values: ArrayLike, name: str) -> Shaped[np.ndarray, "..."]:
    """Numbers of a user as an array of floats; ValueError, which names them, if they are none or ragged."""
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} is {str(values)[:60]}, expected numbers in an array or lists of equal length."
        ) from None
