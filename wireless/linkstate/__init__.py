"""The link state of estimated paths: features, networks, training, calibration.

Training imports PyTorch; a trained classifier does not require it.
Public names are in `__init__.pyi`.
"""

from robosim.support.public_names import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
