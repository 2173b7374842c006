"""Measured against predicted powers, and where on the floor they differ."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from robosim.calibration.measured_powers import MeasuredPowers
from robosim.calibration.power_fit import PowerFit
from robosim.support.axes import axes_in_metres
from robosim.support.figures import save_figure

#: Colours of residuals end here [dB].
_MOST_DB = 12.0
#: Maps next to each other.
_COLUMNS = 3


def draw_powers(measured: MeasuredPowers, fit: PowerFit, path: Path) -> None:
    """Draw each reading over its prediction, those of the held-out half of the floor in another colour."""
    figure, axes = plt.subplots(figsize=(6, 6), layout="constrained")
    halves = (("fitted", ~measured.held_out, "0.6", 0), ("held out", measured.held_out, "#0072B2", 1))
    for name, mask, colour, i in halves:
        label = f"{name}, {fit.rms_db['mean'][i]:.1f} dB"
        powers = fit.predicted_dbm[:, mask].ravel(), measured.power_dbm[:, mask].ravel()
        axes.plot(*powers, "o", ms=2, mew=0, alpha=0.5, color=colour, label=label)
    ends = np.array([np.nanmin(measured.power_dbm), np.nanmax(measured.power_dbm)])
    axes.plot(ends, ends, color="black", lw=0.8)
    axes.set(xlabel="predicted power [dBm]", ylabel="measured power [dBm]", aspect="equal")
    axes.grid(True, lw=0.3)
    axes.legend(fontsize=8, markerscale=3)
    save_figure(figure, path)


def draw_residuals(measured: MeasuredPowers, fit: PowerFit, path: Path) -> None:
    """Draw measured minus predicted powers on the floor, a map for each beacon."""
    columns = min(_COLUMNS, len(measured.names))
    rows = -(-len(measured.names) // columns)
    figure, grid = plt.subplots(
        rows, columns, figsize=(4.2 * columns, 3.8 * rows), layout="constrained", squeeze=False
    )
    for axes in grid.flat[len(measured.names) :]:
        axes.set_axis_off()
    for i, (name, axes) in enumerate(zip(measured.names, grid.flat, strict=False)):
        axes_in_metres(axes)
        fit.building.draw_walls(axes)
        error = measured.power_dbm[i] - fit.predicted_dbm[i]
        received = ~np.isnan(error)
        points = axes.scatter(
            *measured.places[received, :2].T,
            c=error[received],
            cmap="RdBu_r",
            vmin=-_MOST_DB,
            vmax=_MOST_DB,
            s=4,
        )
        axes.plot(*measured.beacons[i, :2], "*", ms=12, color="black", mec="white")
        axes.autoscale_view()
        axes.set_title(f"beacon {name}: {fit.rms_db[name][1]:.1f} dB", fontsize=9, parse_math=False)
    figure.colorbar(points, ax=grid, label="measured over predicted [dB]", shrink=0.6)
    save_figure(figure, path)
