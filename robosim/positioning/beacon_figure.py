"""Beacons located by powers along a route, a map for each."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse

from robosim.plans.floorplan import FloorPlan
from robosim.positioning.beacon_places import BeaconPlace
from robosim.positioning.power_route import PowerRoute
from robosim.support.axes import axes_in_metres
from robosim.support.figures import save_figure

#: Maps next to each other.
_COLUMNS = 3
#: Radius, in standard deviations, of an ellipse that holds 90 % of a normal distribution in the plane.
_NINE_TENTHS = np.sqrt(2 * np.log(10))


def draw_beacons(
    powers: PowerRoute, places: Mapping[str, BeaconPlace], plan: FloorPlan | None, path: Path
) -> None:
    """Draw powers along the route, the place of each beacon with an ellipse of 90 %, and its true place if known."""
    columns = min(_COLUMNS, len(places))
    rows = -(-len(places) // columns)
    figure, grid = plt.subplots(
        rows, columns, figsize=(4.2 * columns, 3.8 * rows), layout="constrained", squeeze=False
    )
    for axes in grid.flat[len(places) :]:
        axes.set_axis_off()
    for (name, place), axes in zip(places.items(), grid.flat, strict=False):
        axes_in_metres(axes)
        if plan is not None:
            plan.plot(axes)
        readings = powers.readings(name)
        points = axes.scatter(*readings.xy.T, c=readings.power_dbm, cmap="viridis", s=4)
        figure.colorbar(points, ax=axes, shrink=0.6, label="power [dBm]")
        variance, axis = np.linalg.eigh(place.covariance)
        width, height = 2 * _NINE_TENTHS * np.sqrt(variance)
        angle = np.degrees(np.arctan2(axis[1, 0], axis[0, 0]))
        axes.add_patch(
            Ellipse(
                (place.xy[0], place.xy[1]), width, height, angle=angle, fill=False, color="#D55E00", lw=1.5
            )
        )
        axes.plot(*place.xy, "o", ms=6, color="#D55E00", mec="white", label="located")
        if (truth := powers.true_xy.get(name)) is not None:
            axes.plot(*truth, "*", ms=12, color="black", mec="white", label="true")
        axes.autoscale_view()
        axes.set_title(f"beacon {name}", fontsize=9, parse_math=False)
    axes.legend(fontsize=8)
    save_figure(figure, path)
