"""Arcs: circles that drawn or rastered walls stand for are found again, and straight-sided shapes are none."""

import numpy as np
import pytest

from wireless.geometry.arcs import find_arcs


def polygon(n, radius, centre=(0.0, 0.0), turn_rad=2 * np.pi):
    """Walls of n chords of an arc from direction 0.3 on."""
    angle = 0.3 + np.linspace(0, turn_rad, n + 1)
    point = centre + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.stack([point[:-1], point[1:]], axis=1)


def square(side, centre=(0.0, 0.0)):
    corner = centre + side / 2 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return np.stack([corner, np.roll(corner, -1, axis=0)], axis=1)


@pytest.mark.parametrize(("n", "radius", "turn"), [(8, 0.2, 2 * np.pi), (24, 0.4, 2 * np.pi), (30, 4.0, 1.6)])
def test_a_circle_is_found_whatever_the_order_of_its_walls(n, radius, turn):
    """Centre within 1e-9 m, all walls, the whole turn; the radius is less by what chords are inside on average."""
    walls = np.concatenate([polygon(n, radius, (3.0, -1.0), turn), square(2.0, (-4.0, 0.0))])
    order = np.random.default_rng(0).permutation(len(walls))
    walls = walls[order]
    walls[::3] = walls[::3, ::-1]
    [arc] = find_arcs(walls, 1e-6)
    np.testing.assert_allclose(arc.centre, (3, -1), atol=1e-9)
    assert set(order[arc.walls]) == set(range(n))
    assert radius * np.cos(turn / n / 2) < arc.radius_m < radius
    assert arc.turn_rad == pytest.approx(turn)
    assert turn > 6 or np.sin(arc.from_rad - 0.3) == pytest.approx(0, abs=1e-6)


def test_a_post_that_a_wall_ends_at_is_one():
    """Of 16 chords the 14 between two ends of a wall."""
    post = polygon(16, 0.25)[1:15]
    wall = [[post[0, 0], post[0, 0] + (3, 0)], [post[-1, 1], post[-1, 1] + (3, 0)]]
    [arc] = find_arcs(np.concatenate([post, wall]), 1e-6)
    assert set(arc.walls) == set(range(14))


def test_corners_are_no_arcs():
    """Squares, rectangles, a pentagon, a chamfered corner, and a long straight wall of many pieces."""
    chamfer = np.array([(9, 9), (11, 9), (11.1, 9.1), (11.1, 11), (9, 11), (9, 9)], float)
    straight = np.column_stack([np.linspace(0, 5, 40), np.full(40, -7.0)])
    shapes = [
        square(0.3),
        square(0.3, (1, 1)) * (3, 1),
        polygon(5, 0.3, (5, 5)),
        np.stack([chamfer[:-1], chamfer[1:]], axis=1),
        np.stack([straight[:-1], straight[1:]], axis=1),
    ]
    assert find_arcs(np.concatenate(shapes), 1e-6) == []
