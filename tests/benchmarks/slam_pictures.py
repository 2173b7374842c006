"""Pictures of `python -m tests.benchmarks slam`: calibration, coverage, and built maps beside the truth."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from robosim.building.building import Building
from robosim.support.arrays_in import FAR, Array, read_npz
from robosim.support.colours import ESTIMATE, TRUE
from robosim.support.figures import save_figure
from robosim.support.reading import reading
from slam.networks.scores import PatchScores
from tests.benchmarks.exploration import area_under, held


def plot_reliability(scores: dict[str, PatchScores], path: Path) -> None:
    """Share that came true against the probability told."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained")
    for ax, part in zip(axes, ("seen", "hidden"), strict=True):
        ax.plot([0, 1], [0, 1], color="0.7")
        for teller, score in scores.items():
            told, came, _ = score.reliability(part).T
            ax.plot(told, came, ".-", label=teller)
        ax.set(title=f"cells {part}", xlabel="probability told", ylabel="share that were obstacles")
        ax.legend()
    save_figure(figure, path)


def plot_coverage(rows: list[dict[str, Any]], path: Path) -> None:
    """Median over plans of coverage against decisions, and the middle half of them, with each map."""
    figure, ax = plt.subplots(figsize=(7, 4.2), layout="constrained")
    for name in ("classical", "learned"):
        curves = 100 * np.array([held(np.array(row["walks"][name]["coverage"])) for row in rows])
        low, middle, high = np.quantile(curves, [0.25, 0.5, 0.75], axis=0)
        area = np.mean([area_under(curve) for curve in curves]) / 100
        line = ax.plot(middle, label=f"{name} map: area {area:.3f}")[0]
        ax.fill_between(np.arange(len(middle)), low, high, color=line.get_color(), alpha=0.15, lw=0)
    ax.set(xlabel="decisions", ylabel="reachable floor seen [%]", ylim=(0, 101))
    ax.set_title("Median over plans, and the middle half of them", fontsize=9)
    ax.grid(alpha=0.3)
    ax.legend(loc="lower right", fontsize=8)
    save_figure(figure, path)


_KEPT = {
    "observed": Array("u1", "ny nx"), "anticipated": Array("u1", "ny nx"), "origin": Array("f", "2", FAR),
    "resolution_m": Array("f", "", FAR), "poses": Array("f", "n 3", FAR), "estimates": Array("f", "n 3", FAR),
}  # fmt: skip


def plot_map(path: Path, building: Building, kept: Path, title: str) -> None:
    """Draw the observed and the anticipated map that a walk has left, true walls and both ways on top.

    Args:
        path: The picture.
        building: The true one.
        kept: The maps (`tests.benchmarks.slam_plan`).
        title: Said above.
    """
    west, south, east, north = building.free.bounds
    aspect = float(np.clip((north - south + 1) / (east - west + 1), 0.4, 2.0))
    figure, axes = plt.subplots(1, 2, figsize=(12, 6 * aspect + 0.7), layout="constrained")
    with reading(kept, "maps that a walk has left") as file:
        maps = read_npz(file, _KEPT)
        for ax, name in zip(axes, ("observed", "anticipated"), strict=True):
            _draw_map(ax, maps[name], maps["origin"], float(maps["resolution_m"]))
            building.draw_walls(ax)
            ax.plot(*maps["poses"][:, :2].T, color=TRUE, lw=1.6, label="true way")
            ax.plot(*maps["estimates"][:, :2].T, color=ESTIMATE, lw=0.8, label="estimated way")
            ax.set(xlim=(west - 0.5, east + 0.5), ylim=(south - 0.5, north + 0.5), xlabel="x [m]")
            ax.set_aspect("equal")
            ax.set_title(f"{name} map (dark: obstacle; grey: unknown; blue: true walls)", fontsize=9)
    axes[0].set_ylabel("y [m]")
    axes[0].legend(loc="upper left", fontsize=7)
    figure.suptitle(title, fontsize=10, parse_math=False)
    save_figure(figure, path)


def _draw_map(ax: Axes, probability: np.ndarray, origin: np.ndarray, resolution_m: float) -> None:
    height, width = np.array(probability.shape) * resolution_m
    extent = (origin[0], origin[0] + width, origin[1], origin[1] + height)
    ax.imshow(255 - probability, cmap="gray", vmin=0, vmax=255, origin="lower", extent=extent, zorder=0)
