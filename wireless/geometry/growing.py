"""Arrays of compiled loops that do not know beforehand how many rows they will need."""

import numpy as np
from jaxtyping import Float, Int

from wireless.support.compiled import compiled


@compiled
def longer_ints(a: Int[np.ndarray, "n k"]) -> Int[np.ndarray, "m k"]:
    """An array of twice as many rows, the first half of them the same."""
    return np.concatenate((a, np.empty_like(a)))


@compiled
def longer(a: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "m k"]:
    """An array of twice as many rows, the first half of them the same."""
    return np.concatenate((a, np.empty_like(a)))
