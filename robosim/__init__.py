"""Robots with cameras and radio in buildings made from floor plans.

The main path is `robosim.episode`: one episode on one page. Public names are in `__init__.pyi`.
"""

import sys
from importlib import import_module

from robosim.support.public_names import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)

if "gymnasium" in sys.modules:
    import_module("robosim.environments")  # registers them
