"""Link-state classifiers: their interface, and the shipped ones by name.

generated         trained on traced links of generated homes among none to ten people, for the simulator's sounding and
                  estimator: angles of arrival and departure, SNR, delays; the default of episodes
generated-no-aod  without angles of departure, for transmitters whose beams are unknown
generated-no-sync  without delays too, for transmitters whose timing from beam to beam is unknown
public            trained on the public measurements of mmwRobotNav, and on generated homes measured in the same manner:
                  angles of arrival and departure, SNR, heights of peaks

ble, wifi-2.4, wifi-5, wifi-6, uwb-6.5, 60ghz, 140ghz
                  like generated, for one radio band of `wireless.bands` each, from what the band resolves

SNR and link states are defined differently in generated and public, so the classifier must fit the measurements: of
links of generated homes, measured by the public receiver, `public` classifies 89.5 % correctly; of public links,
`generated-no-sync`, whose inputs alone are available there, classifies 59 % correctly.

All but those of bands are for 28 GHz; episodes at other carriers warn.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from wireless.linkstate.classifier import LinkStateClassifier


@runtime_checkable
class Classifier(Protocol):
    """Classifies link states of measurements."""

    def predict(
        self,
        aoa_rad: Float[np.ndarray, "n paths"],
        snr_db: Float[np.ndarray, "n paths"],
        *,
        aod_rad: Float[np.ndarray, "n paths"] | None = None,
        delay_s: Float[np.ndarray, "n paths"] | None = None,
    ) -> Float[np.ndarray, "n 4"]:
        """Probability of each `LinkState`, in its order; see `wireless.linkstate.classifier.LinkStateClassifier`."""


class TrueStates:
    """Marks the use of true link states, as of a perfect classifier."""

    def predict(self) -> None:
        """Raise RuntimeError: measurements are interpreted by the true state instead."""
        raise RuntimeError("True link states are not predicted.")


def classifier_of_file(path: Path) -> "LinkStateClassifier":
    """A classifier with weights of a file."""
    from wireless.linkstate.classifier import load_classifier

    return load_classifier(path)
