"""Path estimators by name: measurements in, estimated paths out.

`pca` is the reference's: principal components read on grids, always the requested number of paths. `sage` is
ours: maximum likelihood off the grid, and paths only where they stand out of noise at a set false-alarm rate.
"""

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Complex

from wireless.estimates import PathEstimates
from wireless.estimation.pca import PcaEstimator
from wireless.estimation.sage import SageEstimator
from wireless.sounding.sounder import Sounder


@runtime_checkable
class PathEstimator(Protocol):
    """Anything that estimates paths from correlation tensors."""

    def estimate(self, tensor: Complex[np.ndarray, "links window n_basis beams"]) -> PathEstimates:
        """Paths of each link, the strongest first."""
        ...


#: Estimators by name.
ESTIMATORS = {"pca": PcaEstimator, "sage": SageEstimator}


def estimator_named(
    name: str, sounder: Sounder, n_paths: int = 5, *, false_alarm_rate: float | None = None
) -> PathEstimator:
    """An estimator for a sounder's measurements.

    Args:
        name: Key of `ESTIMATORS`.
        sounder: Sounder of the measurements.
        n_paths: Most paths of a link.
        false_alarm_rate: Share of links without any path in which one is found; None for the estimator's own.

    Raises:
        ValueError: If there is none of this name, or it has no such rate.
    """
    if name not in ESTIMATORS:
        raise ValueError(f"Unknown path estimator {name!r}. Known: {', '.join(ESTIMATORS)}.")
    if false_alarm_rate is None:
        return ESTIMATORS[name](sounder, n_paths=n_paths)
    if name != "sage":
        raise ValueError(
            f"false_alarm_rate is {false_alarm_rate:g}, but {name!r} returns the requested number of paths at any "
            "noise. Leave the rate out, or take 'sage'."
        )
    return SageEstimator(sounder, n_paths=n_paths, false_alarm_rate=false_alarm_rate)
