"""Robots with cameras and radio in buildings made from floor plans.

The main path is `robosim.episode`: one episode on one page. Public names are in `__init__.pyi`.
"""

import sys
from importlib import import_module

from robosim.support.installation import is_installed
from robosim.support.public_names import public_names

#: `from robosim import *` brings data sets for PyTorch only where that is installed.
_hidden = () if is_installed("torch") else ("robosim.datasets.torch_data",)
__getattr__, __dir__, __all__ = public_names(__name__, __file__, _hidden)

if "gymnasium" in sys.modules:
    import_module("robosim.environments")  # registers them
