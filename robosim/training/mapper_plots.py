"""Pictures of how a mapper was trained."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from robosim.support.figures import save_figure

_PARTS = (
    ("iou_seen", "obstacles, seen"),
    ("iou_hidden", "obstacles, hidden"),
    ("iou_hidden_floor", "floor, hidden"),
)


def plot_curve(curve: list[dict[str, float]], classical: dict[str, float], path: Path) -> None:
    """Loss and overlap over steps, the classical map's overlap as dashed lines."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    steps = np.array([row["step"] for row in curve])
    for name, label in (("train_loss", "learnt from"), ("loss", "held out")):
        left.plot(steps, [row[name] for row in curve], ".-", label=label)
    left.set(xlabel="batch", ylabel="loss [nats a cell]")
    for i, (name, label) in enumerate(_PARTS):
        right.plot(steps, [row[name] for row in curve], ".-", color=f"C{i}", label=label)
        right.axhline(classical[name], color=f"C{i}", ls="--")
    right.set(xlabel="batch", ylabel="IoU on held-out homes (dashed: classical map)", ylim=(0, 1))
    for axes in (left, right):
        axes.legend()
        axes.grid(alpha=0.3)
    save_figure(figure, path)
