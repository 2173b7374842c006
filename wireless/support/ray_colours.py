"""Colours of rays by their power, in all pictures. Matplotlib is loaded when something is drawn."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.colors import ListedColormap

#: Map of colours for the power of rays, and the part of it that is used: its brightest end hardly shows on white.
RAY_MAP, RAY_SHARE = "plasma", (0.0, 0.85)


def ray_colours() -> "ListedColormap":
    """Colours of the power of rays, the brighter the stronger."""
    import matplotlib
    import numpy as np
    from matplotlib.colors import ListedColormap

    return ListedColormap(matplotlib.colormaps[RAY_MAP](np.linspace(*RAY_SHARE, 256)))
