"""Thresholds of occupancy: where a probability, or a percentage, becomes free, occupied or unknown."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Shaped, UInt8

from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN


class Thresholds(NamedTuple):
    """Thresholds of a map, by default the usual ones of map_server. The grey 205 of unknown lies just between them."""

    free: float = 0.196
    """Probability of being occupied below which a cell is free."""
    occupied: float = 0.65
    """Probability above which a cell is occupied."""

    def states(self, probability: Shaped[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n"]:
        """States by map_server's rule: unknown at both thresholds, between them and where the probability is NaN."""
        return _states(probability < self.free, probability > self.occupied)

    def raw_states(self, percent: Shaped[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n"]:
        """States of mode raw by map_saver's rule: thresholds are rounded and included, above 100 is unknown."""
        free, occupied = np.rint(100 * self.free), np.rint(100 * self.occupied)
        return _states(percent <= free, (percent >= occupied) & (percent <= 100))


def _states(free: Shaped[np.ndarray, "*n"], occupied: Shaped[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n"]:
    return np.where(free, FREE, np.where(occupied, OCCUPIED, UNKNOWN)).astype(np.uint8)
