"""Learning: training of mapper, pose and the choice among frontiers.

Training needs PyTorch; inference does not.
"""

try:
    import torch as torch
except ImportError as error:
    raise ImportError(
        "Training needs PyTorch, which is not installed: pip install 'robosim-wireless[train]', or in a checkout "
        "pip install -e '.[train]'",
        name="torch",
    ) from error
