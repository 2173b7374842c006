"""A map's cells keep their place, and coordinates go there and back."""

import matplotlib
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from slam.grid import GridFrame, MapEstimate, enlarged, zeros

_FRAMES = st.builds(
    lambda x, y, cell, ny, nx: GridFrame(origin_xy=(x, y), resolution_m=cell, shape=(ny, nx)),
    st.floats(-20, 20),
    st.floats(-20, 20),
    st.sampled_from([0.02, 0.05, 0.1, 0.25]),
    st.integers(1, 12),
    st.integers(1, 12),
)
_POINTS = st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=6).map(np.array)


@given(_FRAMES, _POINTS)
def test_points_to_cells_and_back_are_the_same_points(frame, points):
    """The two maps are inverse to 1e-9 m."""
    np.testing.assert_allclose(frame.to_points(frame.to_cells(points)), points, atol=1e-9)


@given(_FRAMES)
def test_the_centre_of_every_cell_lies_in_that_cell(frame):
    """index(centres) runs through all rows and columns in order; would catch a swap of x and y, or half a cell."""
    iy, ix = frame.index(frame.centres(np.ones(frame.shape, bool)))
    ny, nx = frame.shape
    np.testing.assert_array_equal(iy, np.repeat(np.arange(ny), nx))
    np.testing.assert_array_equal(ix, np.tile(np.arange(nx), ny))
    assert np.all(frame.inside(iy, ix))


def test_cell_zero_begins_at_the_origin_with_y_up():
    """Origin (1, 2) and cells of 0.5 m: (1.6, 3.2) lies in row 2, column 1, and that cell's centre is (1.75, 3.25)."""
    frame = GridFrame(origin_xy=(1.0, 2.0), resolution_m=0.5, shape=(4, 3))
    assert frame.index(np.array([1.6, 3.2])) == (2, 1)
    mask = np.zeros((4, 3), bool)
    mask[2, 1] = True
    np.testing.assert_allclose(frame.centres(mask), [[1.75, 3.25]], atol=1e-12)


def test_points_left_of_and_below_the_grid_have_negative_cells():
    """Rounding is downwards: 1 mm below the origin is cell -1, which truncation would call 0."""
    frame = GridFrame(origin_xy=(0.0, 0.0), shape=(2, 2))
    iy, ix = frame.index(np.array([-0.001, -0.001]))
    assert (iy, ix) == (-1, -1)
    assert not frame.inside(iy, ix)


@given(_FRAMES, st.tuples(*[st.integers(0, 9)] * 4))
def test_a_padded_grid_keeps_every_cell_where_it_was(frame, pads):
    """Cell (iy, ix) becomes (iy + below, ix + left) with the same centre, to 1e-9 m."""
    left, right, below, above = pads
    padded = frame.padded(left, right, below, above)
    ny, nx = frame.shape
    assert padded.shape == (ny + below + above, nx + left + right)
    old = np.zeros(padded.shape, bool)
    old[below : below + ny, left : left + nx] = True
    np.testing.assert_allclose(padded.centres(old), frame.centres(np.ones((ny, nx), bool)), atol=1e-9)


@given(_FRAMES, st.tuples(*[st.floats(-25, 25)] * 4))
def test_a_window_is_a_part_of_the_grid_in_its_place(frame, box):
    """Centres seen through the window are those of the grid, and cells of the grid wholly in the box are in it."""
    low, high = (min(box[0], box[1]), min(box[2], box[3])), (max(box[0], box[1]), max(box[2], box[3]))
    rows, columns, part = frame.window(low, high)
    mask = np.zeros(frame.shape, bool)
    mask[rows, columns] = True
    assert mask.sum() == part.shape[0] * part.shape[1] >= 1
    np.testing.assert_allclose(part.centres(np.ones(part.shape, bool)), frame.centres(mask), atol=1e-9)
    all_centres = frame.centres(np.ones(frame.shape, bool))
    within = ((all_centres > low) & (all_centres < high)).all(axis=1)
    assert mask.ravel()[within].all()


@pytest.mark.parametrize("bad", [{"resolution_m": 0.0}, {"resolution_m": float("nan")}, {"shape": (0, 3)}])
def test_an_impossible_grid_is_rejected(bad):
    """The message names what is wrong."""
    with pytest.raises(ValueError, match=next(iter(bad))):
        GridFrame(origin_xy=(0.0, 0.0), **bad)


def test_a_cell_of_which_nothing_is_known_is_neither_free_nor_an_obstacle():
    """Probability 0.2 is free, 0.5 unknown, 0.8 an obstacle."""
    estimate = MapEstimate(
        frame=GridFrame(origin_xy=(0.0, 0.0), shape=(1, 3)),
        obstacle_probability=np.array([[0.2, 0.5, 0.8]], np.float32),
        explored=np.ones((1, 3), bool),
        blocked=np.zeros((1, 3), bool),
        pose=np.zeros(3),
    )
    np.testing.assert_array_equal(estimate.known_free, [[True, False, False]])
    np.testing.assert_array_equal(estimate.obstacle, [[False, False, True]])


def test_a_map_says_and_draws_what_it_knows():
    """Obstacles dark, seen floor white, the rest grey, each where it lies; the robot where it is and looks."""
    probability = np.full((4, 6), 0.5, np.float32)
    probability[0, 0], probability[0, 1] = 0.9, 0.1
    explored = np.zeros((4, 6), bool)
    explored[0, :2] = True
    estimate = MapEstimate(
        frame=GridFrame(origin_xy=(1.0, 2.0), resolution_m=0.5, shape=(4, 6)),
        obstacle_probability=probability,
        explored=explored,
        blocked=np.zeros((4, 6), bool),
        pose=np.array([1.75, 2.25, np.pi / 2]),
    )
    assert repr(estimate) == (
        "<MapEstimate: 6 x 4 cells of 0.5 m, 0.5 m2 explored, robot at (1.75, 2.25) m, 90 deg>"
    )
    axes = estimate.plot()
    (image,) = axes.images
    assert image.get_extent() == [1.0, 4.0, 2.0, 4.0] and image.origin == "lower"
    np.testing.assert_array_equal(image.get_array()[0, :3], [0.15, 1.0, 0.85])
    (arrow,) = axes.collections
    np.testing.assert_allclose(arrow.get_offsets(), [[1.75, 2.25]])
    np.testing.assert_allclose([arrow.U[0], arrow.V[0]], [0, 1], atol=1e-12)
    assert len(estimate.plot(plt.figure().add_subplot(), robot=False).collections) == 0
    plt.close("all")


def test_an_enlarged_grid_holds_the_old_one_at_its_place():
    """Blocks of zeros are not copied: all values, also those beyond the first block of 64 x 512 cells, are the same."""
    old = zeros((130, 1030, 2), np.float32)
    old[[0, 70, 129], [0, 600, 1029]] = 1.0, 2.0
    new = enlarged(old, (150, 1100), left=20, below=7)
    assert np.array_equal(new[7:137, 20:1050], old)
    assert new.sum() == old.sum() == 9.0
