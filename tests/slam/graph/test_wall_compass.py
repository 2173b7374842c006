"""Directions of walls: of rooms whose turn is known, and as sightings of a graph that drifts."""

import math

import numpy as np
import pytest

from slam.graph.least_squares import Constraint
from slam.graph.pose_graph import PoseGraph
from slam.graph.wall_compass import WallCompass, wall_direction
from slam.matching.scan_matching import ScanPoints
from slam.poses import between, compose, rotation


def room(turn_deg: float, noise_m: float = 0.005, seed: int = 0) -> ScanPoints:
    """Walls of a room of 6 x 4 m, a point every 5 cm, turned about its middle."""
    rng = np.random.default_rng(seed)
    x, y = np.arange(-3, 3, 0.05), np.arange(-2, 2, 0.05)
    sides = [(np.column_stack([x, np.full(len(x), side * 2.0)]), [0, -side]) for side in (-1, 1)] + [
        (np.column_stack([np.full(len(y), side * 3.0), y]), [-side, 0]) for side in (-1, 1)
    ]
    turn = rotation(math.radians(turn_deg))[:2, :2]
    points = np.concatenate([points for points, _ in sides])
    normals = np.concatenate([np.tile(normal, (len(points), 1)) for points, normal in sides]).astype(float)
    points = points + noise_m * rng.standard_normal((len(points), 1)) * normals
    # Normals of neighbours 8 cm away are coarse.
    angle = np.arctan2(normals[:, 1], normals[:, 0]) + 0.1 * rng.standard_normal(len(normals))
    normals = np.column_stack([np.cos(angle), np.sin(angle)])
    return ScanPoints(points=points @ turn.T, normals=normals @ turn.T, weights=np.ones(len(points)))


def off_deg(found: float, turn_deg: float) -> float:
    """Difference of two directions modulo a right angle [degrees]."""
    return (math.degrees(found) - turn_deg + 45) % 90 - 45


@pytest.mark.parametrize("turn_deg", [0.0, 1.3, 17.0, 44.0, 46.0, 89.5])
def test_the_direction_of_a_room_is_its_turn(turn_deg: float):
    """Walls of 20 m in all with errors of 5 mm: a slope of some hundredths of a degree."""
    direction, sigma = wall_direction(room(turn_deg))
    assert abs(off_deg(direction, turn_deg)) < 0.05
    assert math.radians(0.05) < sigma < math.radians(0.3)


def test_recesses_do_not_turn_a_wall():
    """A wall whose second half stands back by 3 cm is not straight: its slope of 0.6 degrees does not count."""
    whole = room(0.0, noise_m=0.0)
    points = whole.points.copy()
    points[(points[:, 1] > 1.9) & (points[:, 0] > 0), 1] += 0.03
    direction, _ = wall_direction(ScanPoints(points=points, normals=whole.normals, weights=whole.weights))
    assert abs(off_deg(direction, 0.0)) < 0.1


def test_a_round_room_has_no_direction():
    """No wall of a circle is straight."""
    angle = np.arange(0, 2 * math.pi, 0.02)
    points = 2.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    assert (
        wall_direction(ScanPoints(points=points, normals=-points / 2.5, weights=np.ones(len(angle)))) is None
    )


def test_nothing_seen_has_no_direction():
    nothing = np.zeros((0, 2))
    assert wall_direction(ScanPoints(points=nothing, normals=nothing, weights=np.zeros(0))) is None


def walked(walls_deg: dict[int, float], with_walls: bool = True) -> float:
    """Largest error of yaw [degrees] of a walk of 20 submaps, 4 m each, whose yaw drifts by 0.12 degrees a submap.

    Walls of submaps by number, turned against the building's axes.
    """
    drift = math.radians(0.12)
    graph, compass = PoseGraph(np.zeros(3)), WallCompass()
    true = [np.zeros(3)]
    for number in range(20):
        step = np.array([4.0, 0.0, math.radians(30.0 if number == 9 else 0.0)])
        true.append(compose(true[-1], step))
        measured = np.add(step, [0.0, 0.0, drift])
        node = graph.add(compose(graph.poses[-1], measured))
        covariance = np.diag([0.01, 0.01, drift]) ** 2
        graph.hold(Constraint(first=node - 1, second=node, pose=measured, covariance=covariance))
        if with_walls and number in walls_deg:
            surfaces = room(walls_deg[number], seed=number).at(between(true[number], np.zeros(3)))
            if compass.see(graph, number, surfaces) > 0:
                graph.solve()
    errors = [
        (pose[2] - yaw + math.pi) % (2 * math.pi) - math.pi
        for pose, (*_, yaw) in zip(graph.poses, true, strict=True)
    ]
    return math.degrees(max(map(abs, errors)))


def test_walls_hold_the_yaw_of_a_walk():
    """Without walls the drift adds up to 2.4 degrees; with walls at every third submap to less than half."""
    walls = dict.fromkeys(range(0, 20, 3), 5.0)
    assert walked(walls, with_walls=False) == pytest.approx(2.4, abs=0.05)
    assert walked(walls) < 1.2


def test_walls_askew_do_not_turn_a_walk():
    """A room stands askew by 2.5 degrees, which is more than the yaw can be off there, or loses its weight."""
    walls = dict.fromkeys(range(0, 20, 2), 5.0)
    assert walked(walls | {10: 7.5}) < 1.2
