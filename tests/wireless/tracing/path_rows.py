"""Paths as rows that two engines can be compared by."""

import numpy as np
from scipy.constants import speed_of_light


def table(paths):
    """Link, order, length, directions and gains of each path, in an order of its own."""
    rows = np.column_stack(
        [
            paths.link,
            paths.order,
            paths.delay_s * speed_of_light,
            np.cos(paths.aod_az),
            np.sin(paths.aoa_az),
            paths.aod_el,
            paths.aoa_el,
            np.abs(paths.gain).reshape(-1, 4) * 1e3,
        ]
    )
    return rows[np.lexsort(np.round(rows[:, ::-1], 7).T)]
