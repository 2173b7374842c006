"""Plots of trainings: curves over steps, epochs and rounds; confusion matrix and reliability of link states."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float, Shaped
from matplotlib.ticker import MaxNLocator

from robosim.support.figures import save_figure
from wireless.linkstate.calibration import reliability
from wireless.linkstate.epoch import Epoch
from wireless.linkstate.scores import confusion

_OVERLAPS = (
    ("iou_seen", "obstacles, seen"),
    ("iou_hidden", "obstacles, hidden"),
    ("iou_hidden_floor", "floor, hidden"),
)
_STATES = ("outage", "LOS", "first\norder", "higher\norder")


def plot_mapper(curve: list[dict[str, float]], classical: dict[str, float], path: Path) -> None:
    """Loss and overlap of a mapper over steps; dashed lines: overlap of the classical map."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    steps = np.array([row["step"] for row in curve])
    for name, label in (("train_loss", "training"), ("loss", "held out")):
        left.plot(steps, [row[name] for row in curve], ".-", label=label)
    left.set(xlabel="batch", ylabel="loss [nats per cell]")
    for i, (name, label) in enumerate(_OVERLAPS):
        right.plot(steps, [row[name] for row in curve], ".-", color=f"C{i}", label=label)
        right.axhline(classical[name], color=f"C{i}", ls="--")
    right.set(xlabel="batch", ylabel="IoU on held-out homes (dashed: classical map)", ylim=(0, 1))
    for axes in (left, right):
        axes.legend()
        axes.grid(alpha=0.3)
    save_figure(figure, path)


def plot_coverage(curve: list[dict[str, float]], path: Path) -> None:
    """Mean coverage over rounds, of training walks and on held-out homes."""
    figure, axes = plt.subplots(figsize=(6, 4))
    for key, style, label in (
        ("coverage", "-", "training walks"),
        ("held_out", "o-", "held-out homes, most likely choices"),
    ):
        points = [(row["round"], row[key]) for row in curve if key in row]
        axes.plot(*zip(*points, strict=True), style, label=label)
    axes.set(xlabel="round", ylabel="mean coverage")
    axes.legend()
    save_figure(figure, path)


def plot_epochs(runs: dict[str, list[Epoch]], path: Path) -> None:
    """Loss and held-out accuracy of classifiers over epochs."""
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
                text.set_parse_math(False)  # names of folders may contain dollars
    save_figure(figure, path)


def plot_scores(probability: Float[np.ndarray, "n 4"], state: Shaped[np.ndarray, " n"], path: Path) -> None:
    """Confusion matrix (rows: true states) and reliability of links with paths."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
    matrix = confusion(probability, state)
    shares = matrix / np.maximum(matrix.sum(1, keepdims=True), 1)
    left.imshow(shares, cmap="Blues", vmin=0, vmax=1)
    for (row, column), share in np.ndenumerate(shares):
        left.text(column, row, f"{share:.3f}", ha="center", va="center", color="w" if share > 0.5 else "k")
    left.set_xticks(range(4), _STATES)
    left.set_yticks(range(4), _STATES)
    left.set(xlabel="classified", ylabel="true")
    bins = reliability(probability, state.astype(int))
    width = 1 / len(bins.count)
    places = (np.arange(len(bins.count)) + 0.5) * width
    right.bar(
        places, bins.count / max(bins.count.max(), 1), width, color="0.88", label="links (largest bin: 1)"
    )
    right.plot([0, 1], [0, 1], "k:", lw=1, label="calibrated")
    right.plot(bins.confidence, bins.accuracy, "o-", color="#0072B2", label="measured")
    right.set(xlim=(0, 1), ylim=(0, 1.02), xlabel="confidence", ylabel="share right")
    right.set_title(f"expected calibration error {bins.expected_calibration_error:.4f}", fontsize=9)
    right.legend(fontsize=7)
    save_figure(figure, path)
