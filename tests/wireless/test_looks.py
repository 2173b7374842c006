"""What paths and estimates look like when printed, in a notebook, and drawn."""

import re

import matplotlib
import numpy as np
import pytest

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from wireless import PathEstimates, Tracer, TracerConfig
from wireless.support.listing import Listing


@pytest.fixture(scope="module")
def paths(extruded, ring):
    """Of a room of 6 m x 4 m with a column: the strongest is the direct one."""
    mesh = extruded(np.concatenate([ring((0, 0), (6, 0), (6, 4), (0, 4)), ring((2, 1), (3, 1), (3, 2))]))
    tx, rx = np.array([[1.0, 3.0, 1.5]]), np.array([[5.0, 3.0, 1.5], [5.0, 1.0, 1.5]])
    return Tracer(mesh, config=TracerConfig(max_paths=15)).trace(tx, rx)


@pytest.fixture
def estimates():
    """Two links with paths, one without."""
    places = np.array([[0.5, -1.0], [0.0, 0.0], [np.pi / 2, 0.0]])
    return PathEstimates(
        aoa_rad=places,
        aod_rad=-places,
        snr_db=np.array([[30.0, 12.25], [-np.inf, -np.inf], [20.0, -np.inf]]),
        delay_s=np.array([[0.0, 3e-9], [0.0, 0.0], [0.0, 0.0]]),
        count=np.array([2, 0, 1]),
    )


def test_paths_print_as_a_table_of_their_first_rows(paths):
    """A title, heads with units, 20 rows and how many are left out; the first is the direct path of 4 m."""
    title, heads, first, *others, rest = str(paths).splitlines()
    assert title == f"{len(paths)} paths, 1 transmitter to 2 receivers at 28 GHz"
    for head in ("power [dB]", "delay [ns]", "AoA az [deg]", "AoD el [deg]"):
        assert head in heads
    assert len(others) == 19 and rest == f"... and {len(paths) - 20} more"
    friis_db = 20 * np.log10(299_792_458 / 28e9 / (4 * np.pi * 4))
    reported = first.split()
    assert reported[:3] == ["0", "0", "direct"]
    assert float(reported[3]) == pytest.approx(friis_db, abs=0.1)
    assert float(reported[4]) == pytest.approx(4 / 0.299792458, abs=0.01)
    assert float(reported[7]) == pytest.approx(0.0, abs=0.1)
    assert len({len(line) for line in (heads, first, *others)}) == 1


def test_few_paths_leave_nothing_out(paths):
    """One row, no rest; none at all is a title alone."""
    lines = str(paths.between(0, 1).strongest()).splitlines()
    assert len(lines) == 3 and "more" not in lines[-1]
    assert str(paths.select(np.zeros(len(paths), bool))).splitlines() == [
        "0 paths, 1 transmitter to 2 receivers at 28 GHz"
    ]
    assert repr(paths) == f"<Paths: {str(paths).splitlines()[0]}>"


def test_a_notebook_shows_the_same_table(paths):
    """As many rows and cells as the text has, and the title as caption."""
    shown = paths._repr_html_()
    assert len(re.findall("<tr>", shown)) == 21 and len(re.findall("<td>", shown)) == 20 * 9
    assert f"<caption>{str(paths).splitlines()[0]}</caption>" in shown
    assert shown.endswith(f"<p>... and {len(paths) - 20} more</p>")


def test_estimates_print_those_that_were_found(estimates):
    """In degrees and nanoseconds, links without any left out."""
    title, heads, *rows = str(estimates).splitlines()
    assert title == "3 estimated paths of 3 links, 1 of them without any"
    assert "SNR [dB]" in heads and "delay [ns]" in heads
    assert [row.split() for row in rows] == [
        ["0", "0", "28.6", "-28.6", "30.0", "0.00"],
        ["0", "1", "-57.3", "57.3", "12.2", "3.00"],
        ["2", "0", "90.0", "-90.0", "20.0", "0.00"],
    ]
    assert repr(estimates) == f"<PathEstimates: {title}>"
    assert "<td>90.0</td>" in estimates._repr_html_()


def test_cells_are_text_whatever_they_look_like():
    """Markup in a title, a head or a cell is shown as it is written."""
    listing = Listing(title="<b>", heads=("a & b",), rows=[("<script>",)], n_rows=2)
    assert listing.text().splitlines() == ["<b>", "   a & b", "<script>", "... and 1 more"]
    shown = listing.html()
    assert "<script>" not in shown and "<b>" not in shown
    assert "&lt;script&gt;" in shown and "a &amp; b" in shown


def test_paths_are_drawn_where_they_run(paths):
    """One line a path from transmitter over its points to the receiver, the strongest on top, and both ends marked."""
    link = paths.between(0, 1)
    axes = link.plot()
    (rays,) = axes.collections
    routes = [path.vertices for path in rays.get_paths()]
    assert len(routes) == len(link) and len(routes[-1]) == 2 + link.order[0]
    np.testing.assert_allclose(rays.get_array(), link.power_db[::-1])
    for route in routes:
        np.testing.assert_allclose(route[[0, -1]], [[1, 3], [5, 1]])
    assert [line.get_label() for line in axes.lines] == ["transmitter", "receiver"]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")
    assert paths.plot(axes) is axes
    plt.close(axes.figure)
