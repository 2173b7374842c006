"""Ranges of whole numbers of different lengths, all at once."""

import numpy as np
from jaxtyping import Int


def index_ranges(
    first: Int[np.ndarray, " n"], counts: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """The index of each range, once per number in it, and the numbers: `counts` of them from `first` on."""
    index = np.repeat(np.arange(len(counts)), counts)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts) + first[index]
