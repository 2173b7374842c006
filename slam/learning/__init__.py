"""Learning: training of mapper, pose and the choice among frontiers.

Training needs PyTorch; inference does not.
"""

from robosim.support import torch_training as torch_training  # says what to install without PyTorch
