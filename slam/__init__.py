"""Mapping and moving: RGB-D and odometry in, map, pose, goals and actions out.

Inputs and outputs are plain arrays; neither the simulator nor radio is required.
Public names are in `__init__.pyi`.
"""

from robosim.support.public_names import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
