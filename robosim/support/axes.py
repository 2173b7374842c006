"""Where things are drawn that have a place: axes in metres. Matplotlib is loaded when something is drawn."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def axes_in_metres(axes: "Axes | None") -> "Axes":
    """The axes given, or those of a new figure, with x and y in metres at one scale."""
    if axes is None:
        import matplotlib.pyplot as plt

        _, axes = plt.subplots(layout="constrained")
    axes.set_aspect("equal")
    axes.set(xlabel="x [m]", ylabel="y [m]")
    return axes
