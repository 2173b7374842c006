"""Constrained triangulation: area, orientation and walls hold exactly, on points made to break tolerance."""

import numpy as np
import pytest
import shapely

from wireless.geometry.triangulation import Triangulation


def check(points, walls):
    """Triangles turn left, fill the square without overlap, and have every wall as a side."""
    mesh = Triangulation(points, 1000)
    for a, b in walls:
        mesh.constrain(int(a), int(b))
    triangles = mesh.triangles()
    xy = np.array(mesh.points, object)
    (ax, ay), (bx, by), (cx, cy) = (xy[triangles[:, k]].T for k in range(3))
    twice = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    assert (twice > 0).all()
    assert twice.sum() == 2 * (xy[-2, 0] - xy[-4, 0]) * (xy[-2, 1] - xy[-4, 1])
    assert len(triangles) == 2 * len(points) + 2
    sides = {frozenset((t[i], t[i - 1])) for t in triangles.tolist() for i in range(3)}
    assert all(frozenset((int(a), int(b))) in sides for a, b in walls)


def test_lattice_points_are_cocircular_and_collinear():
    """A full 15 x 15 lattice, where every circle and line test is a tie, with rows and columns as walls."""
    points = np.stack(np.meshgrid(np.arange(15), np.arange(15)), axis=2).reshape(-1, 2) * 50_000
    walls = [(i, i + 1) for i in range(0, 200, 3) if i % 15 < 14] + [(i, i + 15) for i in range(0, 200, 7)]
    check(points, walls)


@pytest.mark.parametrize("seed", range(6))
def test_random_walls_become_sides(seed):
    """Long walls through crowds of points, cut where they cross by GEOS."""
    rng = np.random.default_rng(seed)
    ends = rng.integers(0, 10**7, (30, 2, 2))
    lines = shapely.union_all(shapely.linestrings(ends.astype(float)), grid_size=1.0)
    xy, line = shapely.get_coordinates(shapely.get_parts(lines), return_index=True)
    points, number = np.unique(np.rint(xy).astype(int), axis=0, return_inverse=True)
    same = line[1:] == line[:-1]
    walls = np.column_stack([number.ravel()[:-1][same], number.ravel()[1:][same]])
    extra = rng.integers(0, 10**7, (200, 2))  # off the walls, surely
    check(np.concatenate([points, extra]), walls)


def test_point_on_a_wall_is_an_error():
    """Three points in a row: the long wall cannot be a side, and is rejected rather than lost."""
    mesh = Triangulation(np.array([[0, 0], [10, 10], [20, 20], [5, 0]]), 100)
    with pytest.raises(ValueError, match="lies on the wall"):
        mesh.constrain(0, 2)
