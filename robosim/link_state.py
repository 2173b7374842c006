"""Shipped classifiers of link states by name.

public          trained on the public measurements of mmwRobotNav: angles of arrival and departure, SNR, peaks
public-no-aod   the same without angles of departure, for transmitters whose beams are not known
"""

from pathlib import Path
from typing import TYPE_CHECKING

from robosim.assets import shipped_weights

if TYPE_CHECKING:
    from wireless.linkstate.classifier import LinkStateClassifier


def read_classifier(name: str | Path) -> "LinkStateClassifier":
    """A shipped classifier by name, or one from a file that `robosim train link-state` wrote.

    Raises:
        ValueError: If there is none.
    """
    from wireless.linkstate.classifier import load_classifier

    shipped = shipped_weights()
    path = shipped.get(str(name), Path(name))
    if path.suffix != ".safetensors":
        raise ValueError(
            f"classifier is {str(name)!r}, expected a .safetensors file or one of {', '.join(shipped)}."
        )
    return load_classifier(path)
