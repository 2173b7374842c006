"""Figures of measured values next to traced ones: maps of residuals, impulse responses, places and their ellipses."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from robosim.plans.floorplan import FloorPlan
from tests.benchmarks.harness import figure_of
from wireless.channel import Channel
from wireless.sounding.first_path import hann_pulse

#: Colours by what stands there.
_COLOURS = {"wall": "black", "board": "tab:brown", "books": "tab:olive", "mirror": "tab:cyan"}


def draw_apartment(
    sheets: Sequence[tuple[str, Float[np.ndarray, "2 2"]]],
    ends_m: Float[np.ndarray, "n 2 2"],
    residuals: Mapping[str, tuple[Float[np.ndarray, " n"], float]],
) -> Figure:
    """Map of an apartment for each quantity, whose links have the colour of measured less predicted.

    Args:
        sheets: Walls and sides of furniture: material and ends [m].
        ends_m: Anchor and tag of each link [m].
        residuals: Title of each panel: residual of each link, and the end of the colours.
    """
    figure, panels = figure_of(len(residuals), size=(5.5, 5.2))
    for axes, (title, (rest, most)) in zip(panels, residuals.items(), strict=True):
        for material, ends in sheets:
            axes.plot(*ends.T, color=_COLOURS[material], lw=1.5)
        for (anchor, tag), value in zip(ends_m, rest, strict=True):
            axes.plot(*np.array([anchor, tag]).T, color="0.75", lw=0.8, zorder=1)
            axes.annotate(
                f"{value:+.1f}",
                (anchor + 2 * tag) / 3,
                (0, 6),
                textcoords="offset points",
                fontsize=7,
                ha="center",
            )
        middle = (ends_m[:, 0] + 2 * ends_m[:, 1]) / 3
        drawn = axes.scatter(
            *middle.T, c=rest, s=60, cmap="coolwarm", vmin=-most, vmax=most, edgecolors="0.3"
        )
        axes.plot(*ends_m[:, 0].T, "^k", ms=4)
        axes.plot(*ends_m[:, 1].T, "ok", ms=3)
        axes.set(title=title, xlabel="x [m]", ylabel="y [m]", aspect="equal")
        figure.colorbar(drawn, ax=axes, shrink=0.8)
    handles = [panels[0].plot([], [], color=colour)[0] for colour in _COLOURS.values()]
    panels[0].legend(handles, list(_COLOURS), fontsize=7, loc="lower right")
    return figure


def draw_responses(
    links: Sequence[tuple[str, Float[np.ndarray, " taps"], float, Channel, float]],
    bandwidth_hz: float,
    tap_s: float,
) -> Figure:
    """Measured responses of links and those of traced paths, over the delay after the straight line.

    Args:
        links: Title, measured mean power of each tap, delay of the first tap after the straight line [s], traced
            channel, and delay of the straight line [s].
        bandwidth_hz: Bandwidth of the receiver.
        tap_s: Time of a tap [s].
    """
    figure, panels = figure_of(len(links), size=(4.2, 3.6))
    for axes, (title, power, begin_s, channel, straight_s) in zip(panels, links, strict=True):
        time_s = begin_s + tap_s * np.arange(len(power))
        axes.plot(1e9 * time_s, 10 * np.log10(power / power.max()), label="measured")
        fine_s = np.arange(-10e-9, 80e-9, 0.1e-9)
        coefficients, delays_s = channel.cir()
        later_s = delays_s[0, 0] - straight_s
        traced = (
            np.abs(hann_pulse(bandwidth_hz * (fine_s[:, None] - later_s)) @ coefficients[0, 0, 0, 0]) ** 2
        )
        axes.plot(1e9 * fine_s, 10 * np.log10(traced / traced.max() + 1e-9), label="traced", lw=1)
        paths = np.abs(coefficients[0, 0, 0, 0]) ** 2
        axes.plot(1e9 * later_s, 10 * np.log10(paths / traced.max() + 1e-9), "|", color="0.5", label="paths")
        axes.set(title=title, xlabel="after the straight line [ns]", xlim=(-10, 80), ylim=(-45, 3))
    panels[0].set_ylabel("power over the strongest [dB]")
    panels[0].legend(fontsize=8)
    return figure


def draw_flat(
    plan: FloorPlan,
    places: Float[np.ndarray, "n 2"],
    rest_db: Float[np.ndarray, "n_beacons n"],
    beacons: Mapping[str, Float[np.ndarray, "2"]],
) -> Figure:
    """Measured less predicted powers at places of a flat, a panel for each beacon.

    Args:
        plan: The flat.
        places: Of the robot [m].
        rest_db: Measured less predicted power; NaN where nothing was received [dB].
        beacons: Names and places [m].
    """
    figure = Figure(figsize=(12, 7), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey=True).ravel()
    for axes, rest, (name, beacon) in zip(panels, rest_db, beacons.items(), strict=True):
        _draw_plan(axes, plan)
        drawn = axes.scatter(*places.T, c=rest, s=3, cmap="coolwarm", vmin=-12, vmax=12)
        axes.plot(*beacon, "*k", ms=11)
        axes.set(title=f"beacon {name}, {np.sqrt(np.nanmean(rest**2)):.1f} dB", aspect="equal")
    figure.colorbar(drawn, ax=list(panels), label="measured less predicted power [dB]", shrink=0.7)
    figure.supxlabel("x [m]")
    figure.supylabel("y [m]")
    return figure


def draw_located(
    errors: Mapping[str, tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k n"]]],
    inside: Mapping[str, Float[np.ndarray, " n"]],
) -> Figure:
    """Errors of located beacons over the share of the route, and how often ellipses hold the true place.

    Args:
        errors: Label, shares of the route, and errors of all beacons and runs at each [m].
        inside: Label, and the probability of the smallest ellipse that holds each true place.
    """
    figure, (left, right) = figure_of(2)
    for label, (share, error_m) in errors.items():
        line = left.plot(100 * share, np.median(error_m, axis=1), "o-", label=label)[0]
        left.fill_between(
            100 * share, *np.quantile(error_m, (0.25, 0.75), axis=1), color=line.get_color(), alpha=0.15
        )
    left.set(xlabel="share of the run [%]", ylabel="error of a beacon: median, quartiles [m]", ylim=(0, None))
    wanted = np.linspace(0, 100, 101)
    right.plot(wanted, wanted, ":", color="0.5", label="calibrated")
    for label, probability in inside.items():
        right.step(wanted, [100 * np.mean(100 * probability <= p) for p in wanted], where="post", label=label)
    right.axvline(90, color="0.7", lw=0.8)
    right.set(xlabel="probability of the ellipse [%]", ylabel="true places inside [%]")
    for axes in (left, right):
        axes.legend(fontsize=8)
    return figure


def _draw_plan(axes: Axes, plan: FloorPlan) -> None:
    """Draw the free floor of a plan in white on grey."""
    low, high = plan.to_map(np.array([[0, 0], plan.shape[::-1]], float))
    free: Bool[np.ndarray, "h w"] = plan.free
    extent: Any = (low[0], high[0], low[1], high[1])
    axes.imshow(free, origin="lower", extent=extent, cmap="gray", vmin=-2, vmax=1)
