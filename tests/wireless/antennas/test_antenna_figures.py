"""Pictures of antennas show what was computed."""

import numpy as np
import pytest

from wireless.antennas.codebook import terminal_named
from wireless.antennas.figures import FLOOR_DBI, arrays_figure, coverage_loss_db


def test_figure_shows_every_beam_and_array(tmp_path):
    """One line for each beam and array of both terminals, tops at the directivity of the best beam."""
    figure = arrays_figure()
    for axis, name in zip(figure.axes[1:], ("gnb", "ue"), strict=True):
        terminal = terminal_named(name)
        assert len(axis.lines) == terminal.n_beams + 3
        drawn = np.array([line.get_ydata() for line in axis.lines])
        best = terminal.platform.directivity(np.linspace(-np.pi, np.pi, 721)).max()
        assert drawn.max() == pytest.approx(10 * np.log10(best), abs=1e-9)
        assert drawn.min() == FLOOR_DBI
    figure.savefig(tmp_path / "arrays.png")
    assert (tmp_path / "arrays.png").stat().st_size > 10_000


def test_coverage_loss_of_the_reference():
    """Three arrays leave the worst azimuth about 3 dB under the best: 4.0 dB for planes, 1.9 dB for lines."""
    assert coverage_loss_db(terminal_named("gnb")) == pytest.approx(4.0, abs=0.1)
    assert coverage_loss_db(terminal_named("ue")) == pytest.approx(1.9, abs=0.1)
