"""Public names of `wireless.linkstate`."""

from wireless.linkstate.epoch import Epoch as Epoch
from wireless.linkstate.classifier import LinkStateClassifier as LinkStateClassifier
from wireless.linkstate.data import Links as Links
from wireless.linkstate.learning.training import Recipe as Recipe
from wireless.linkstate.classifier import load_classifier as load_classifier
from wireless.linkstate.tokens import make_tokens as make_tokens
from wireless.linkstate.data import read_links as read_links
from wireless.linkstate.calibration import reliability as reliability
from wireless.linkstate.learning.training import train as train
