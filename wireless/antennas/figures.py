"""Pictures of antennas: element and beam patterns, and what the arrays of a platform cover."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wireless.antennas.codebook import TERMINALS, Terminal, terminal_named
from wireless.antennas.elements import ELEMENTS, directivity, unit_vector

#: Directivities that pictures reach from and to [dBi].
FLOOR_DBI, TOP_DBI = -10.0, 20.0


def arrays_figure(element: str = "patch") -> Figure:
    """Elements, and beams and coverage of the reference's two terminals.

    Args:
        element: Name of the element that the terminals are made of.
    """
    figure = Figure(figsize=(15, 5.2), layout="constrained")
    axes = [figure.add_subplot(1, 3, i + 1, projection="polar") for i in range(3)]
    draw_elements(axes[0])
    for axis, name in zip(axes[1:], TERMINALS, strict=True):
        terminal = terminal_named(name, element)
        draw_coverage(axis, terminal)
        worst = coverage_loss_db(terminal)
        axis.set_title(f"{name}: {terminal.n_beams} beams, worst azimuth {worst:.1f} dB under the best")
    return figure


def coverage_loss_db(terminal: Terminal) -> float:
    """How far the worst azimuth lies under the best, for the best beam of the best array [dB]."""
    best = terminal.platform.directivity(_around()).max(axis=1)
    return float(10 * np.log10(best.max() / best.min()))


def draw_elements(axis: Axes) -> None:
    """Directivity of each element by azimuth (drawn through) and by elevation (dashed)."""
    angle = _around()
    zero = np.zeros_like(angle)
    upright = np.stack([np.cos(angle), zero, np.sin(angle)], axis=-1)
    for i, (name, element) in enumerate(ELEMENTS.items()):
        level = directivity(element, unit_vector(angle, zero))
        axis.plot(angle, _dbi(level), color=f"C{i}", label=name)
        axis.plot(angle, _dbi(directivity(element, upright)), "--", color=f"C{i}")
    axis.set_title("elements [dBi]: azimuth, elevation (dashed)")
    axis.legend(loc="lower left")
    _scale(axis)


def draw_coverage(axis: Axes, terminal: Terminal) -> None:
    """All beams (thin) and the best that each array can do in any direction (thick)."""
    angle = _around()
    beams = np.abs(terminal.beam_response(angle)) ** 2
    for k in range(terminal.n_beams):
        axis.plot(angle, _dbi(beams[:, k]), lw=0.5, color=f"C{terminal.beam_array[k]}", alpha=0.6)
    for i, level in enumerate(terminal.platform.directivity(angle).T):
        axis.plot(angle, _dbi(level), lw=2, color=f"C{i}")
    _scale(axis)


def _around() -> Float[np.ndarray, " n"]:
    return np.linspace(-np.pi, np.pi, 721)


def _dbi(power: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Decibels, not below the picture's floor."""
    return 10 * np.log10(np.maximum(power, 10 ** (FLOOR_DBI / 10)))


def _scale(axis: Axes) -> None:
    axis.set_ylim(FLOOR_DBI, TOP_DBI)
