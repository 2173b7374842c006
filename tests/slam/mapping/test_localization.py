"""Localization on a known map: rooms of known walls, scans computed from them, and true poses."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from slam.grid import GridFrame
from slam.mapping.known_map import KnownMap
from slam.mapping.localization import Localizer, Location
from slam.matching.scan_matching import ScanPoints, points_of_beams
from slam.poses import between, compose, wrap
from tests.robot_logs import ROOM, ROUTE
from tests.slam import beams

BEARING = np.radians(np.arange(-135, 135, 1.0))
EMPTY = beams.rectangle(0, 0, 8, 6)
SOLID = shapely.box(-1, -1, 9, 7) - shapely.box(0, 0, 8, 6)
FURNITURE = shapely.MultiPolygon([shapely.box(3, 2, 4, 3.5), shapely.box(6, 0, 8, 1.2)])
STEP = np.diag([0.03, 0.03, 0.02]) ** 2


def known_map(obstacles: shapely.Geometry, free_to_x: float = 9.0) -> KnownMap:
    """Cells of 0.05 m by their centres; unknown behind walls, and beyond a limit in x [m]."""
    frame = GridFrame(origin_xy=(-0.5, -0.5), resolution_m=0.05, shape=(140, 180))
    x, y = np.meshgrid(*frame.axes())
    is_solid = shapely.contains_xy(obstacles, x, y)
    known = shapely.contains_xy(shapely.box(-0.05, -0.05, 8.05, 6.05), x, y) & (x < free_to_x)
    return KnownMap(is_solid & known, ~is_solid & known, frame)


def scan_at(pose: np.ndarray, walls: list, rng: np.random.Generator) -> ScanPoints:
    """Points of a scan whose ranges err by 1 cm."""
    range_m = beams.ranges(walls, pose, bearing=BEARING) + rng.normal(0, 0.01, len(BEARING))
    return points_of_beams(BEARING, range_m, 25.0, 0.05, 0.02)


def drive(
    localizer: Localizer, route: list[np.ndarray], walls: list, first: int = 0, seed: int = 0
) -> list[Location]:
    """Locations along true poses from a number on, with odometry that errs by 2 cm and 0.6 degrees a step."""
    rng, locations = np.random.default_rng(seed), []
    for k, pose in enumerate(route):
        step = np.zeros(3) if k == first else between(route[k - 1], pose) + rng.normal(0, [0.02, 0.02, 0.01])
        if k >= first:
            locations.append(localizer.update(scan_at(pose, walls, rng), step, STEP))
    return locations


def deviation(pose: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Distance [m] and turn [degrees] between poses."""
    return math.hypot(*(pose - true)[:2]), abs(math.degrees(wrap(pose[2] - true[2])))


def test_known_map_has_surfaces_on_true_walls():
    """Within half a cell of the wall's face, normals within 3 degrees of into the room."""
    points, normals, _ = known_map(SOLID).levels.fine.planes()
    sides = {"left": (0, 0.0, 1.0), "right": (0, 8.0, -1.0), "low": (1, 0.0, 1.0), "high": (1, 6.0, -1.0)}
    for axis, wall_m, towards in sides.values():
        middle = (points[:, 1 - axis] > 1) & (points[:, 1 - axis] < 5) & (abs(points[:, axis] - wall_m) < 0.2)
        assert middle.sum() > 60
        assert abs(points[middle, axis] - wall_m).max() < 0.026
        assert (normals[middle, axis] * towards).min() > math.cos(math.radians(3))


def test_known_map_agreement_separates_true_and_wrong_poses():
    known, rng = known_map(SOLID | FURNITURE), np.random.default_rng(0)
    scan = scan_at(ROUTE[5], ROOM, rng).every()
    agrees, contradicts = known.agreement(ROUTE[5], scan)
    assert agrees > 0.95 and contradicts < 0.03
    agrees, contradicts = known.agreement(compose(ROUTE[5], np.array([1.0, 0.5, 0.3])), scan)
    assert agrees < 0.5 < contradicts


@pytest.mark.parametrize(("occupied", "free"), [(False, True), (True, False)])
def test_known_map_without_walls_or_floor_is_rejected(occupied, free):
    frame = GridFrame(origin_xy=(0, 0), shape=(4, 4))
    with pytest.raises(ValueError, match=r"known map has no (occupied|free) cell"):
        KnownMap(np.full((4, 4), occupied), np.full((4, 4), free), frame)


@pytest.mark.parametrize("first", [0, 12, 25])
def test_localizer_finds_the_robot_anywhere(first):
    """From anywhere on the route: located within ten scans, then within 3 cm and 0.5 degrees, and so is its past."""
    localizer = Localizer(known_map(SOLID | FURNITURE))
    locations = drive(localizer, ROUTE[: first + 20], ROOM, first)
    located = [location.is_located for location in locations]
    assert not located[0] and all(located[10:])
    for pose, true in zip(localizer.trajectory()[0], ROUTE[first:], strict=False):
        away_m, turn_deg = deviation(pose, true)
        assert away_m < 0.05 and turn_deg < 0.7
    away_m, turn_deg = deviation(locations[-1].pose, ROUTE[first + 19])
    assert away_m < 0.03 and turn_deg < 0.5
    assert math.sqrt(np.trace(locations[-1].covariance[:2, :2])) < 0.03


def test_localizer_stays_undecided_in_a_room_that_looks_alike_turned():
    """An empty rectangle with scans of a full turn: the pose, or the opposite one."""
    bearing = np.radians(np.arange(-180, 180, 2.0))
    localizer, route = Localizer(known_map(SOLID)), [np.array([2 + 0.1 * k, 2.0, 0.3]) for k in range(12)]
    for before, pose in pairwise([route[0], *route]):
        scan = points_of_beams(bearing, beams.ranges(EMPTY, pose, bearing=bearing), 25.0, 0.05, 0.02)
        location = localizer.update(scan, between(before, pose), STEP)
    assert not location.is_located


def test_localizer_notices_that_the_robot_was_carried_off():
    """Odometry says that it stood still; the pose is found again within 15 scans."""
    localizer = Localizer(known_map(SOLID | FURNITURE))
    localizer.reset(ROUTE[0])
    drive(localizer, ROUTE[:15], ROOM)
    locations = drive(localizer, ROUTE[27:], ROOM)
    kidnapped = [k for k, location in enumerate(locations) if location.was_kidnapped]
    assert len(kidnapped) == 1 and kidnapped[0] < 5
    assert locations[-1].is_located
    assert deviation(locations[-1].pose, ROUTE[-1])[0] < 0.03


def test_localizer_follows_odometry_where_nothing_is_known():
    """The map ends in the middle of the room, and the scan shows only what lies beyond it; then the pose is vague."""
    localizer = Localizer(known_map(SOLID, free_to_x=3.0))
    localizer.reset(np.array([2.0, 3.0, 0.0]))
    ahead = np.abs(BEARING) < 0.6
    before = np.array([2.0, 3.0, 0.0])
    deviations, located = [], []
    for k in range(30):
        pose = np.array([2.0 + 0.1 * k, 3.0, 0.0])
        range_m = np.where(ahead, beams.ranges(EMPTY, pose, bearing=BEARING), np.inf)
        scan = points_of_beams(BEARING, range_m, 25.0, 0.05, 0.02)
        location = localizer.update(scan, between(before, pose), STEP)
        before = pose
        deviations.append(math.sqrt(location.covariance[1, 1]))
        located.append(location.is_located)
    assert deviation(location.pose, pose)[0] < 0.01
    assert (np.diff(deviations) > 0).all()
    assert located[0] and not located[-1]


def test_localizer_gives_one_result():
    """Bit for bit."""
    runs = [drive(Localizer(known_map(SOLID | FURNITURE)), ROUTE[:12], ROOM) for _ in range(2)]
    for location, other in zip(*runs, strict=True):
        np.testing.assert_array_equal(location.pose, other.pose)
        np.testing.assert_array_equal(location.covariance, other.covariance)
