"""The link state of estimated paths: features, networks, training, calibration.

    make_tokens           estimated paths as one array for networks
    Recipe, train         how a network is trained, and doing so
    default_recipe        how unless told otherwise
    read_links            links of the public measurements, or of a data set
    LinkStateClassifier   trained networks behind one call
    load_classifier       one from files
    reliability           confidence against accuracy

Importing this imports PyTorch; `wireless` alone does not.
"""

from wireless.linkstate.calibration import reliability
from wireless.linkstate.classifier import LinkStateClassifier, load_classifier
from wireless.linkstate.data import Links, read_links
from wireless.linkstate.tokens import make_tokens
from wireless.linkstate.training import Epoch, Recipe, default_recipe, train

__all__ = [
    "Epoch",
    "LinkStateClassifier",
    "Links",
    "Recipe",
    "default_recipe",
    "load_classifier",
    "make_tokens",
    "read_links",
    "reliability",
    "train",
]
