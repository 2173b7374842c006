"""Legend, scale bar and north arrow of plans that matplotlib draws."""

from collections.abc import Sequence

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from robosim.drawing.marks import bar_m
from robosim.support.colours import FURNISHING, WALL

#: Height of the strip below a plan over the plan's size.
_STRIP = 0.08


def wall_keys(furnished: bool) -> list[Artist]:
    """Legend entries of `Building.draw_walls`, of a building with or without furnishings."""
    walls: list[Artist] = [Line2D([], [], color=WALL, lw=1.5, label="true walls")]
    return [*walls, Line2D([], [], color=FURNISHING, lw=1.5, label="furniture")] if furnished else walls


def map_keys() -> list[Artist]:
    """Legend entries of a robot's map."""
    shades = (("floor seen", "1.0"), ("obstacle seen", "0.15"), ("not seen", "0.85"))
    return [Patch(facecolor=shade, edgecolor="0.5", lw=0.5, label=label) for label, shade in shades]


def heading(text: str) -> Artist:
    """A heading in a legend."""
    return Line2D([], [], ls="", label=text)


def explain(
    axes: Axes, keys: Sequence[Artist], title: str | None = None, *, after: Sequence[Artist] = ()
) -> None:
    """Add a legend next to a plan, and a scale bar and a north arrow below it; the axes have their final limits.

    The legend has the entries `keys`, those of the labelled artists, and `after`.
    """
    drawn, _ = axes.get_legend_handles_labels()
    inside = axes.get_legend()
    if inside is not None:
        inside.remove()
    axes.figure.legend(
        handles=[*keys, *drawn, *after],
        loc="outside right upper",
        fontsize=8,
        frameon=False,
        title=title,
        title_fontsize=8,
    )
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    strip = _STRIP * max(east - west, north - south)
    axes.set_ylim(south - strip, north)
    length, y = bar_m(east - west), south - 0.62 * strip
    x, tick = west + 0.3 * strip, 0.12 * strip
    for ends in (
        ([x, x + length], [y, y]),
        ([x, x], [y - tick, y + tick]),
        ([x + length, x + length], [y - tick, y + tick]),
    ):
        axes.plot(*ends, color="0.1", lw=1.6, zorder=9, solid_capstyle="butt")
    axes.annotate(f"{length:g} m", (x + length / 2, y + tick), ha="center", va="bottom", fontsize=8, zorder=9)
    at = x + length + 0.8 * strip
    axes.annotate(
        "",
        (at, y + 0.45 * strip),
        (at, y - 0.25 * strip),
        arrowprops={"arrowstyle": "-|>", "color": "0.1", "lw": 1.2},
        zorder=9,
    )
    axes.annotate("N (+y)", (at + 0.2 * strip, y), va="center", fontsize=8, zorder=9)
