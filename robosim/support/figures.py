"""The place that writes figures of matplotlib, drawn without a display."""

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from robosim.support.files import whole_file

#: Resolution of PNG files [dots per inch].
DPI = 200
#: Metadata that make the bytes of a figure reproducible, by format.
_METADATA: dict[str, dict[str, Any]] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whole or not at all, and free it.

    Where matplotlib's `savefig.format` is another format, as `--figures pdf` sets it, the figure is also written in
    that one, under the same name.
    """
    for kind in dict.fromkeys(["png", plt.rcParams["savefig.format"]]):
        with whole_file(path.with_suffix(f".{kind}")) as partial, plt.rc_context({"svg.hashsalt": path.stem}):
            about = _METADATA.get(kind, {})
            # Cut to what is drawn: labels that need more room than the layout has left them are not clipped.
            figure.savefig(partial, format=kind, dpi=DPI, bbox_inches="tight", metadata=about)
    plt.close(figure)
