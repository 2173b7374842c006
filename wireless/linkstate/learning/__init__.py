"""Learning of link states: networks as PyTorch trains them, and their training.

Training needs PyTorch; classifiers that were trained (`wireless.linkstate.classifier`) are used without.
"""

from robosim.support import torch_training as torch_training  # says what to install without PyTorch
