"""Top-down grids, judged by numpy.loadtxt and by the pictures published next to them."""

import numpy as np
import pytest
from PIL import Image

from robosim.plans.files import find_plans, read_plan, write_ros
from robosim.plans.floorplan import FREE, OCCUPIED
from robosim.plans.formats.mmwrobotnav import parse_grid

GRID = np.array([[0, 2, 2, 0], [0, 2, 1, 2], [0, 0, 2, 0]])


def test_axes_and_walls_are_those_of_the_published_data(tmp_path):
    """The cell in row r, column c from the top left has its centre at x = 0.05 c, y = -0.05 r."""
    path = tmp_path / "Colebrook.glb_topdownmap.out"
    np.savetxt(path, GRID, fmt="%d", delimiter=",")
    plan = read_plan(path)
    assert (plan.name, plan.wall_line, plan.eroded_m) == ("Colebrook", "cell_centre", 0.1)
    rows, columns = np.nonzero(GRID)
    published = np.column_stack([0.05 * columns, -0.05 * rows])
    centres = plan.centres(plan.free)
    order = np.lexsort(centres.T), np.lexsort(published.T)
    np.testing.assert_allclose(centres[order[0]], published[order[1]], atol=1e-12)
    assert set(np.unique(plan.occupancy)) == {FREE, OCCUPIED}


@pytest.mark.parametrize(
    "content",
    [
        b"0,2,2,0\n0,2,1,2\n0,0,2,0\n",
        b"0,2,2,0\n0,2,1,2\n0,0,2,0",
        b"0, 2, 2, 0,\r\n0,2,1,2,\r\n 0 ,0,2, 0,\r\n\r\n",
        b"0 2 2 0\n0\t2 1  2 \n\n0 0 2 0\n",
        b"0.0,2.0,2.0,0.0\n0.0,2.0,1.0,2.0\n0,0,2,0\n",
        b"0.000e+00,2.000e+00,2,0\n0,2,1,2\n0,0,2,0\n",
    ],
)
def test_commas_and_blanks_may_vary(content):
    np.testing.assert_array_equal(parse_grid(content), GRID)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"0,1\n0,1,2\n", ["row 2 has 3", "row 1 has 2"]),
        (b"0,1\n0,3\n", ["row 2, column 2", "'3'"]),
        (b"0,1\n0,\n", ["row 2 has 1"]),
        (b"0,1,2\n0,,2\n", ["row 2, column 2", "''"]),
        (b"0,1\n-1,1\n", ["row 2, column 1", "'-1'"]),
        (b"0,nan\n", ["row 1, column 2", "'nan'"]),
        (b"0,0.5\n", ["'0.5'"]),
        (b"wall,floor\n", ["row 1, column 1", "'wall'"]),
        (b"\n \n,\n", ["no values"]),
        (b"\xff\xfe\x00\x01\n", ["row 1, column 1"]),
    ],
)
def test_bad_grids_are_said_with_row_and_column(content, words):
    with pytest.raises(ValueError) as error:
        parse_grid(content)
    for word in words:
        assert word in str(error.value)


def test_published_grids_load_export_and_reload_equal(shared, tmp_path):
    """All 52: equal to the colours of the published picture, and to themselves once written.

    In the picture row 0 is at the top and outside is violet, so a plan that is upside down fails.
    """
    paths = find_plans([shared / "maps" / "gibson"])
    assert len(paths) == 52
    for path in paths:
        plan = read_plan(path)
        picture = np.asarray(Image.open(path.with_suffix(".png")).convert("RGB"))
        outside = (picture == (68, 1, 84)).all(axis=-1)
        np.testing.assert_array_equal(plan.free[::-1], ~outside)
        write_ros(plan, tmp_path / f"{plan.name}.yaml")
        again = read_plan(tmp_path / f"{plan.name}.yaml")
        np.testing.assert_array_equal(again.occupancy, plan.occupancy)
        for key in ("name", "resolution_m", "origin", "wall_line", "eroded_m"):
            assert getattr(again, key) == getattr(plan, key)
    values = np.loadtxt(paths[0], delimiter=",")
    np.testing.assert_array_equal(parse_grid(paths[0].read_bytes()), values)
