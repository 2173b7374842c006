"""What the map of one decision says of the cells of a belief's grid: each thing is worked out once, when asked for."""

from functools import cached_property

import numpy as np
from jaxtyping import Float

from robosim.policies.leads import Leads, leads
from robosim.policies.sightlines import Knowledge, knowledge
from slam.grid import GridFrame, MapEstimate

#: Free cells this near to an obstacle are such where a wave may bend or bounce [m].
_BESIDE_M = 0.2


class Survey:
    """A map, as it is at one decision, over a grid."""

    def __init__(self, estimate: MapEstimate, frame: GridFrame) -> None:
        """Nothing is worked out yet.

        Args:
            estimate: The map; to be asked before it changes.
            frame: The grid.
        """
        self.estimate, self.frame = estimate, frame
        self._leads: tuple[bytes, Leads] | None = None

    @cached_property
    def known(self) -> Knowledge:
        """The map as rays need it."""
        return knowledge(self.estimate, beside_m=_BESIDE_M)

    def leads(self, place: Float[np.ndarray, "2"]) -> Leads:
        """The ways between a place (x, y) [m] and the cells; those of the last place are kept."""
        key = np.asarray(place, float).tobytes()
        if self._leads is None or self._leads[0] != key:
            self._leads = key, leads(self.estimate, place, self.frame)
        return self._leads[1]
