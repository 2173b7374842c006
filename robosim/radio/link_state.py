"""Shipped classifiers of link states by name.

generated         trained on our own links of generated homes, for our own sounding and estimator: angles of arrival
                  and departure, SNR, delays; the one to take in episodes
generated-no-aod  the same without angles of departure, for transmitters whose beams are not known
generated-no-sync  without delays too, for transmitters whose timing from beam to beam is not known
public            trained on the public measurements of mmwRobotNav, and on generated homes measured the same way:
                  angles of arrival and departure, SNR, heights of peaks

SNR means different things in the two, and states follow different rules: take the one that fits the measurements.
In generated homes measurement by the public receiver, `public` tells 89.5 % of our states rightly; of public links,
`generated-no-sync`, which alone finds there all that it needs, tells 59 %.

All but `generated-no-sync` can also remember the robot's way (`wireless.linkstate.follower`): along ways to the
transmitter in unseen homes `generated` is right at 96.8 % of the places alone, at 97.0 % with it.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from robosim.parts import CLASSIFIER

if TYPE_CHECKING:
    from wireless.linkstate.classifier import LinkStateClassifier


class TrueStates:
    """Stands for the true link states, to see what a perfect classifier would bring."""

    def predict(self) -> None:
        """Not to be asked: who interprets measurements takes the truth instead."""
        raise RuntimeError("True link states are not predicted.")


def read_classifier(name: str | Path) -> "LinkStateClassifier":
    """A shipped classifier by name, or one from a file of `robosim train link-state`; ValueError if there is none."""
    made: LinkStateClassifier = CLASSIFIER.make(str(name), field="classifier")
    return made


def classifier_of_file(path: Path) -> "LinkStateClassifier":
    """A classifier with weights of its own."""
    from wireless.linkstate.classifier import load_classifier

    return load_classifier(path)
