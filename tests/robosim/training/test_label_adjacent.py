"""Which paths the published ray tracer could find: those of a coarse grid of receivers, and the same between."""

import numpy as np
import pytest
import trimesh

from robosim.training.label_links import adopted, fully_traced, with_coarse
from wireless.paths import Interaction
from wireless.tracing.tracer import Tracer, TracerConfig

N = 12


def grid(first_row, first_column):
    """Cells of N x N receivers and their places, 0.15 m apart, the first one at (-0.75, 1.8)."""
    row, column = (index.ravel() for index in np.indices((N, N)))
    place = np.column_stack([-0.75 + 0.15 * column, 1.8 - 0.15 * row])
    return np.column_stack([first_row + row, first_column + column]), place


@pytest.mark.parametrize("half_m", [0.02, 0.045, 0.1])
@pytest.mark.parametrize("first", [(1, 1), (2, 4), (4, 7)])
def test_a_reflection_between_needs_one_on_the_coarse_grid(half_m, first):
    """A mirror so short that it lights a beam one to three receivers wide, over a grid that begins anywhere.

    By hand: it is seen where the line to the image crosses it, and found at coarse receivers and at most a row and a
    column away from a coarse one that sees it. Line of sight goes everywhere and is found.
    """
    ends = [(-half_m, 0.0), (half_m, 0.0)]
    wall = [(x, y, z) for x, y in ends for z in (0.0, 3.0)]
    mesh = trimesh.Trimesh(wall, [(0, 1, 3), (0, 3, 2)], process=False)
    cell, place = grid(*first)
    rx = np.column_stack([place, np.full(len(place), 1.5)])
    config = TracerConfig(max_reflections=1, diffraction=False)
    paths = Tracer(mesh, config=config).trace(np.array([[0.0, 1.0, 1.5]]), rx)
    lit = np.abs(place[:, 0] / (1 + place[:, 1])) <= half_m
    full = (cell[:, 0] % 2 == 0) & (cell[:, 1] % 2 == 1)
    found = [
        bool(lit[i] and (full[i] or any(full & lit & (np.abs(cell - cell[i]).max(axis=1) <= 1))))
        for i in range(len(cell))
    ]
    mask = adopted(paths, cell)
    mirrored = paths.interaction[:, 0] == Interaction.REFLECTION
    assert mask[~mirrored].all()
    np.testing.assert_array_equal(np.bincount(paths.rx[mirrored], minlength=len(cell)), lit)
    np.testing.assert_array_equal(np.bincount(paths.rx[mirrored & mask], minlength=len(cell)), found)


def test_some_reflections_between_are_lost():
    """The narrowest mirror lights one column of receivers, x = 0: lost if that column is even, found if it is odd."""
    wall = [(x, 0.0, z) for x in (-0.02, 0.02) for z in (0.0, 3.0)]
    mesh = trimesh.Trimesh(wall, [(0, 1, 3), (0, 3, 2)], process=False)
    for first_column, share in ((1, 0.0), (2, 1.0)):
        cell, place = grid(2, first_column)
        rx = np.column_stack([place, np.full(len(place), 1.5)])
        tracer = Tracer(mesh, config=TracerConfig(max_reflections=1, diffraction=False))
        paths = tracer.trace(np.array([[0.0, 1.0, 1.5]]), rx)
        mirrored = paths.interaction[:, 0] == Interaction.REFLECTION
        assert mirrored.sum() >= N
        assert adopted(paths, cell)[mirrored].mean() == share


def test_coarse_receivers_around_are_added_once_and_in_place():
    """A lone receiver between gets the coarse ones within a row and a column; a coarse one is not repeated."""
    cell, place = np.array([[5, 8], [6, 7]]), np.array([[1.2, -0.75], [1.05, -0.9]])
    cells, places = with_coarse(cell, place)
    np.testing.assert_array_equal(cells[:2], cell)
    assert fully_traced(cells[2:]).all()
    assert sorted(map(tuple, cells[2:])) == [(4, 7), (4, 9), (6, 9)]
    np.testing.assert_allclose(places, np.column_stack([0.15 * cells[:, 1], -0.15 * cells[:, 0]]), atol=1e-12)


def test_receivers_off_their_grid_are_named():
    """A receiver moved by a centimetre is not where its row and column say."""
    cell, place = grid(1, 1)
    place[7, 0] += 0.01
    with pytest.raises(ValueError, match=r"a receiver is 0.01 m off"):
        with_coarse(cell, place)
