"""Radio in buildings: materials of walls, their effect on waves, and propagation paths between points.

A mesh and points go in, radio quantities come out; robots are not required.
Public names are in `__init__.pyi`.
"""

from robosim.support.public_names import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
