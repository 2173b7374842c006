"""Walls along a line of sight, against mirror images worked out point by point."""

import math

import numpy as np
import pytest

from slam.graph.alongside import mirror_image_angle_rad
from slam.graph.tracker import Tracker
from slam.graph.tracker_config import TrackerConfig
from slam.matching.scan_matching import MatchConfig
from slam.poses import to_map
from slam.sensing.bearings import Bearing
from tests.slam.beams import ranges, rectangle, seen

#: Resolution of the receiver.
APART_RAD, APART_M = math.radians(20.0), 1.0


def _bearing(range_m: float, bearing_rad: float = 0.0) -> Bearing:
    return Bearing(
        source="a",
        bearing_rad=bearing_rad,
        sigma_rad=math.radians(0.5),
        range_m=range_m,
        sigma_log_range=0.3,
        apart_rad=APART_RAD,
        apart_m=APART_M,
    )


def _wall(start: tuple[float, float], end: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Points every 5 cm of a wall, and its normal at each."""
    a, b = np.array(start), np.array(end)
    length = float(np.hypot(*(b - a)))
    points = a + np.arange(0.0, length, 0.05)[:, None] * (b - a) / length
    return points, np.tile([-(b - a)[1] / length, (b - a)[0] / length], (len(points), 1))


@pytest.mark.parametrize("turned", [0.0, 0.7, 2.5])
@pytest.mark.parametrize("range_m", [8.0, 15.0, 40.0])
def test_a_corridor_has_the_mirror_image_of_its_farther_wall(turned: float, range_m: float) -> None:
    """Robot 1 m from one wall and 0.5 m from the other: the image is the transmitter's, mirrored in the farther."""
    near, far = _wall((-5, -0.5), (60, -0.5)), _wall((60, 1.0), (-5, 1.0))
    points = np.concatenate([near[0], far[0]])
    normals = np.concatenate([near[1], far[1]])
    turn = np.array([0.0, 0.0, turned])
    pose = np.array([3.0, -2.0, 0.3])
    image = np.array([range_m, 2.0])
    angle_rad = mirror_image_angle_rad(
        _bearing(range_m, turned - pose[2]),
        pose,
        to_map(turn, points) + pose[:2],
        to_map(turn, normals),
    )
    assert angle_rad == pytest.approx(math.atan2(image[1], image[0]), abs=1e-9)


def test_paths_that_a_receiver_separates_are_no_images() -> None:
    """At 4 m the image of a wall at 1 m is 27 degrees aside; at 15 m, of one at 3 m, 1.2 m longer."""
    assert mirror_image_angle_rad(_bearing(4.0), np.zeros(3), *_wall((0, 1), (10, 1))) == 0
    assert mirror_image_angle_rad(_bearing(15.0), np.zeros(3), *_wall((0, 3), (15, 3))) == 0
    assert mirror_image_angle_rad(_bearing(15.0), np.zeros(3), *_wall((0, 1), (15, 1))) > 0


def test_pillars_and_walls_across_are_not_alongside() -> None:
    """The side of a pillar of 1 m, a wall that the line goes through, and none at all."""
    for wall in (_wall((4, 1), (5, 1)), _wall((6, -3), (6, 3)), (np.zeros((0, 2)), np.zeros((0, 2)))):
        assert mirror_image_angle_rad(_bearing(15.0), np.zeros(3), *wall) == 0


def test_a_tracker_in_a_corridor_trusts_bearings_along_it_less() -> None:
    """There half of the image's angle is the deviation; across the corridor it is that of the bearing."""
    tracker = Tracker(TrackerConfig(match=MatchConfig(max_range_m=12.0)))
    scan = seen(ranges(rectangle(-5, -1, 30, 1), np.zeros(3), np.random.default_rng(0)))
    tracker.update(*scan, np.zeros(3), 1e-10 * np.eye(3))
    used: list[Bearing] = []
    tracker.landmarks.see = lambda graph, here, spread, bearings: used.extend(bearings)  # type: ignore[method-assign]
    tracker.listen([_bearing(15.0), _bearing(15.0, math.pi / 2)])
    image_rad = math.atan2(2.0, 15.0)
    assert used[0].sigma_rad == pytest.approx(math.hypot(math.radians(0.5), 0.5 * image_rad), rel=0.02)
    assert used[1].sigma_rad == math.radians(0.5)
