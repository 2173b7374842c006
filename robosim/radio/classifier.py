"""Whatever tells link states of measurements: what it is asked."""

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float


@runtime_checkable
class Classifier(Protocol):
    """Tells link states of measurements."""

    def predict(
        self,
        aoa_rad: Float[np.ndarray, "n paths"],
        snr_db: Float[np.ndarray, "n paths"],
        *,
        aod_rad: Float[np.ndarray, "n paths"] | None = None,
        delay_s: Float[np.ndarray, "n paths"] | None = None,
    ) -> Float[np.ndarray, "n 4"]:
        """Probability of each `LinkState`, in its order; see `wireless.linkstate.classifier.LinkStateClassifier`."""
