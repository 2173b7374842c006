"""Learning of link states: networks as PyTorch trains them, and their training.

Training needs PyTorch; classifiers that were trained (`wireless.linkstate.classifier`) are used without.
"""

try:
    import torch as torch
except ImportError as error:
    raise ImportError(
        "Training needs PyTorch, which is not installed: pip install 'robosim-wireless[train]', or in a checkout "
        "pip install -e '.[train]'",
        name="torch",
    ) from error
