"""Pictures of training and scoring classifiers of link states: loss and accuracy, confusion, reliability."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float, Shaped
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from robosim.support.figures import save_figure
from wireless.linkstate.calibration import reliability
from wireless.linkstate.epoch import Epoch
from wireless.linkstate.scores import confusion

_NAMES = ("outage", "LOS", "first\norder", "higher\norder")


def plot_curves(runs: dict[str, list[Epoch]], path: Path) -> None:
    """Draw loss and held-out accuracy of networks over epochs."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    for name, epochs in runs.items():
        number = [epoch.epoch for epoch in epochs]
        (line,) = left.plot(number, [epoch.loss for epoch in epochs], "-", label=f"{name}, training")
        if epochs[0].accuracy is not None:
            watched = [np.nan if epoch.watched_loss is None else epoch.watched_loss for epoch in epochs]
            left.plot(number, watched, "--", color=line.get_color(), label=f"{name}, held out")
            accuracy = [np.nan if epoch.accuracy is None else epoch.accuracy for epoch in epochs]
            right.plot(number, accuracy, "--", color=line.get_color(), label=name)
    left.set_ylabel("cross entropy [nat]")
    right.set_ylabel("held-out accuracy, links with paths")
    for axes in (left, right):
        axes.set_xlabel("epoch")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(alpha=0.3)
        if axes.lines:
            for text in axes.legend(fontsize=7).get_texts():
                text.set_parse_math(False)  # names of folders may have dollars in them
    save_figure(figure, path)


def _draw_confusion(axes: Axes, matrix: Shaped[np.ndarray, "4 4"]) -> None:
    """Shares of each true state (row) told as each state (column)."""
    shares = matrix / np.maximum(matrix.sum(1, keepdims=True), 1)
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1)
    for (row, column), share in np.ndenumerate(shares):
        axes.text(column, row, f"{share:.3f}", ha="center", va="center", color="w" if share > 0.5 else "k")
    axes.set_xticks(range(4), _NAMES)
    axes.set_yticks(range(4), _NAMES)
    axes.set_xlabel("told")
    axes.set_ylabel("true")


def plot_scores(probability: Float[np.ndarray, "n 4"], state: Shaped[np.ndarray, " n"], path: Path) -> None:
    """Draw the confusion matrix and the reliability of links with paths."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
    _draw_confusion(left, confusion(probability, state))
    bins = reliability(probability, state.astype(int))
    width = 1 / len(bins.count)
    places = (np.arange(len(bins.count)) + 0.5) * width
    right.bar(places, bins.count / bins.count.max(), width, color="0.88", label="links (largest bin: 1)")
    right.plot([0, 1], [0, 1], "k:", lw=1, label="calibrated")
    right.plot(bins.confidence, bins.accuracy, "o-", color="#0072B2", label="measured")
    right.set(xlim=(0, 1), ylim=(0, 1.02), xlabel="confidence", ylabel="share right")
    right.set_title(f"expected calibration error {bins.expected_calibration_error:.4f}", fontsize=9)
    right.legend(fontsize=7)
    save_figure(figure, path)
