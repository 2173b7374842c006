"""Arrays of compiled loops that do not know beforehand how many rows they will need."""

import numpy as np
from jaxtyping import Num

from robosim.support.compiled import compiled


@compiled
def longer(a: Num[np.ndarray, "..."]) -> Num[np.ndarray, "..."]:
    """An array of twice as many rows, the first half of them the same."""
    return np.concatenate((a, np.empty_like(a)))
