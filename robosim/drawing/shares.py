"""Shares of links over the error of their azimuth of arrival."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from robosim.support.colours import STATE_COLOURS, STATE_NAMES, css
from wireless.paths import LinkState

#: Lines of estimators; those of others are dotted and dashed.
STYLE = {"pca": "--", "sage": "-", "limit": ":"}
#: Errors below this are drawn there [deg].
LEAST_DEG = 1e-3


def draw_shares(ax: Axes, pooled: list[dict[str, Any]], published: dict[str, dict[float, float]]) -> None:
    """Share of links over the error of their azimuth of arrival, by link state and estimator."""
    for row in pooled:
        state = LinkState[row["state"]]
        label, colour = STATE_NAMES[state], css(STATE_COLOURS[state])
        error = np.maximum(np.asarray(row["quantiles_deg"], float), LEAST_DEG)
        share = 100 * np.linspace(0, 1, len(error))
        ax.plot(error, share, STYLE[row["estimator"]], color=colour, label=f"{label}, {row['estimator']}")
    for name, shares in published.items():
        ax.plot(
            list(shares),
            [100 * share for share in shares.values()],
            "s",
            color=css(STATE_COLOURS[LinkState[name]]),
            mec="k",
        )
    ax.plot([], [], "ks", label="published")
    ax.set(xscale="log", xlabel="error of azimuth of arrival [deg]", ylabel="links [%]", title="traced plans")
    ax.set_xlim(LEAST_DEG, 180)
    ax.grid(True, which="major", lw=0.3)
    ax.legend(fontsize="x-small")
