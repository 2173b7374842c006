"""Where things are drawn that have a place: axes in metres. Matplotlib is loaded when something is drawn."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import ListedColormap


def axes_in_metres(axes: "Axes | None") -> "Axes":
    """The axes given, or those of a new figure, with x and y in metres at one scale."""
    if axes is None:
        import matplotlib.pyplot as plt

        _, axes = plt.subplots(layout="constrained")
    axes.set_aspect("equal")
    axes.set(xlabel="x [m]", ylabel="y [m]")
    return axes


#: Map of colours for the power of rays, and the part of it that is used: its brightest end hardly shows on white.
RAY_MAP, RAY_SHARE = "plasma", (0.0, 0.85)


def ray_colours() -> "ListedColormap":
    """Colours of the power of rays, the brighter the stronger."""
    import matplotlib
    import numpy as np
    from matplotlib.colors import ListedColormap

    return ListedColormap(matplotlib.colormaps[RAY_MAP](np.linspace(*RAY_SHARE, 256)))
