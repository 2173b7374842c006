"""A picture of what odometry measures wrongly, action by action."""

import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from robosim.robot.calibration import Runs
from robosim.support.figures import save_figure
from wireless.support.counting import counted

#: Points drawn of each action.
_MOST = 2000


def draw_errors(runs: Runs, path: Path) -> None:
    """Draw the errors of each run: sideways against ahead, and the turn, with the ellipse that holds 95 % of them."""
    figure, axes = plt.subplots(2, len(runs.errors), figsize=(11, 6.5), layout="constrained", squeeze=False)
    circle = np.linspace(0, 2 * math.pi, 100)
    for column, (action, all_of_them) in enumerate(runs.errors.items()):
        some = all_of_them[:: max(1, len(all_of_them) // _MOST)]
        place, turn = axes[:, column]
        place.plot(1000 * some[:, 0], 1000 * some[:, 1], ".", ms=2, color="tab:blue", alpha=0.5)
        mean, covariance = all_of_them[:, :2].mean(axis=0), np.cov(all_of_them[:, :2].T)
        lengths, directions = np.linalg.eigh(covariance)
        # A normal distribution in the plane has 95 % of its mass within 2.448 standard deviations.
        reach = (
            2.448 * directions @ (np.sqrt(np.maximum(lengths, 0))[:, None] * [np.cos(circle), np.sin(circle)])
        )
        place.plot(*(1000 * (mean[:, None] + reach)), color="tab:orange", label="95 %")
        place.plot(*(1000 * mean), "+", color="black", ms=10, label="mean")
        place.axhline(0, color="0.8", lw=0.8, zorder=0)
        place.axvline(0, color="0.8", lw=0.8, zorder=0)
        place.set_aspect("equal", "datalim")
        place.set_title(f"{action.name.lower()}, {counted(len(all_of_them), 'run')}")
        place.set_xlabel("ahead, measured minus true [mm]")
        place.set_ylabel("to the left [mm]")
        place.legend(loc="upper right", fontsize=8)
        turn.hist(np.degrees(all_of_them[:, 2]), bins=40, color="tab:blue")
        turn.axvline(float(np.degrees(all_of_them[:, 2].mean())), color="black", lw=1)
        turn.set_xlabel("turn, measured minus true [deg]")
        turn.set_ylabel("runs")
    save_figure(figure, path)
