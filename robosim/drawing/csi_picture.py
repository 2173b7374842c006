"""Figure of the frequency response of one link."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Complex, Float

from robosim.support.figures import save_figure

_PORTS = ("vertical", "horizontal")
#: Pairs of ports that are weaker than the strongest by this factor receive rounding only, and are not drawn.
_LEAST = 1e-7
#: Most singular values that are drawn.
_STREAMS = 4


def plot_response(
    path: Path,
    response: Complex[np.ndarray, "rx_ports tx_ports f"],
    offset_hz: Float[np.ndarray, " f"],
    *,
    is_array: bool = False,
    frequency_hz: float,
    title: str,
) -> None:
    """Draw |H| in decibels over offsets from the carrier, between each pair of ports; of arrays, singular values."""
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    if is_array:
        values = np.linalg.svd(np.moveaxis(response, 2, 0), compute_uv=False)[:, :_STREAMS]
        response = values.T[:, None]
    for r, t in np.ndindex(response.shape[:2]):
        if is_array:
            pair: str | None = f"singular value {r + 1}"
        else:
            pair = f"{_PORTS[t]} to {_PORTS[r]}" if response.shape[0] > 1 else None
        marker = "." if len(offset_hz) <= 128 else ""
        if np.abs(response[r, t]).max() > _LEAST * np.abs(response).max():
            gain_db = 20 * np.log10(np.maximum(np.abs(response[r, t]), 1e-300))
            axes.plot(offset_hz / 1e6, gain_db, marker=marker, label=pair)
    if not response.any():
        axes.text(0.5, 0.5, "no path", transform=axes.transAxes, ha="center")
    label = f"frequency from the carrier of {frequency_hz / 1e9:g} GHz [MHz]"
    axes.set(xlabel=label, ylabel="singular value [dB]" if is_array else "|H| [dB]", title=title)
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize="small")
    save_figure(figure, path)
