"""The link state of estimated paths: features, networks, training, calibration.

    make_tokens           estimated paths as one array for networks
    Recipe, train         how a network is trained, and doing so
    default_recipe        how unless told otherwise
    Epoch                 how an epoch of it went
    read_links            links of the public measurements, or of a data set
    Links                 what that reads
    LinkStateClassifier   trained networks behind one call
    load_classifier       one from files
    reliability           confidence against accuracy

What trains imports PyTorch when it is first asked for; a trained classifier needs none.
"""

from importlib import import_module
from typing import TYPE_CHECKING

#: Where each public name is: imported when it is first asked for.
_MODULES = {
    "Epoch": "epoch",
    "LinkStateClassifier": "classifier",
    "Links": "data",
    "Recipe": "learning.training",
    "default_recipe": "learning.training",
    "load_classifier": "classifier",
    "make_tokens": "tokens",
    "read_links": "data",
    "reliability": "calibration",
    "train": "learning.training",
}
__all__ = [*_MODULES]

if TYPE_CHECKING:
    from wireless.linkstate.calibration import reliability as reliability
    from wireless.linkstate.classifier import LinkStateClassifier as LinkStateClassifier
    from wireless.linkstate.classifier import load_classifier as load_classifier
    from wireless.linkstate.data import Links as Links
    from wireless.linkstate.data import read_links as read_links
    from wireless.linkstate.epoch import Epoch as Epoch
    from wireless.linkstate.learning.training import Recipe as Recipe
    from wireless.linkstate.learning.training import default_recipe as default_recipe
    from wireless.linkstate.learning.training import train as train
    from wireless.linkstate.tokens import make_tokens as make_tokens
else:

    def __getattr__(name: str) -> object:
        """A public name, imported when it is first asked for."""
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
