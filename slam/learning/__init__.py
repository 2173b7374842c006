"""Learning: training of mapper, pose and the choice among frontiers.

Training needs PyTorch; what was learnt is used without.
"""

try:
    import torch as torch
except ImportError as error:
    raise ImportError(
        "Training needs PyTorch, which is not installed: pip install 'robosim-wireless[train]', or in a checkout "
        "pip install -e '.[train]'",
        name="torch",
    ) from error
