"""Evidence adds up, is bounded, can be taken back, and stays where it is when the map grows."""

import itertools
import math

import numpy as np
import pytest
from scipy.special import expit

from slam.grid import GridFrame
from slam.hull import Hull
from slam.mapping.occupancy import OccupancyConfig, OccupancyGrid
from slam.poses import to_map
from slam.sensing.projection import CameraModel, Scan, scan_from_depth
from tests.slam.rooms import Room

CAMERA = CameraModel()
#: Fall of the lowest image row per metre of depth, with a square image of 90 degrees: all but half a row of 1.
DOWN = 1.0
FRAME = GridFrame(origin_xy=(-6.0, -6.0), resolution_m=0.05, shape=(240, 240))
ORIGIN = np.zeros(3)


def _enter(grid: OccupancyGrid, scan: Scan, pose=ORIGIN) -> None:
    grid.integrate(scan, np.array(pose, float), CAMERA.height_m, DOWN)


def _flat(depth_m: float, *, top_m: float = 1.5, reach_m: float | None = None) -> Scan:
    """What is seen of a wide surface straight ahead; with `reach_m`, of an open floor instead."""
    left = np.linspace(1, -1, 96, dtype=np.float32)
    there = np.full(96, depth_m if reach_m is None else np.inf, np.float32)
    return Scan(
        left=left,
        depth_m=there,
        clear_m=np.full(96, reach_m or depth_m, np.float32),
        top_m=np.full(96, top_m if reach_m is None else 0, np.float32),
        far_m=np.full(96, np.inf, np.float32),
    )


def _at(grid: OccupancyGrid, x: float, y: float) -> float:
    iy, ix = grid.frame.index(np.array([x, y]))
    return float(grid.log_odds[iy, ix])


@pytest.mark.parametrize("n", [1, 2, 3, 4, 9, 10, 11, 30])
def test_evidence_adds_up_within_its_bounds(n):
    """Looks at a wall, n of them, 2.02 m ahead: min(4, 1.2 n) in it, max(-4, -0.4 n) before, 0 behind; to float32.

    The probability is the logistic function of that, by SciPy.
    """
    grid = OccupancyGrid(FRAME)
    for _ in range(n):
        _enter(grid, _flat(2.02))
    assert _at(grid, 2.025, 0.025) == pytest.approx(min(4.0, 1.2 * n), rel=1e-6)
    assert _at(grid, 1.0, 0.3) == pytest.approx(max(-4.0, -0.4 * n), rel=1e-6)
    assert _at(grid, 2.5, 0.0) == 0.0
    assert np.abs(grid.log_odds).max() <= 4.0
    np.testing.assert_allclose(grid.probability, expit(grid.log_odds), rtol=1e-6)


@pytest.mark.parametrize("looks", [1, 2, 3, 100])
def test_a_wall_entered_in_error_clears_after_contrary_looks(looks):
    """Belief b = min(4, 1.2 looks) is free again after the first look that brings b - 0.4 k below 0, never later."""
    grid, belief, still = OccupancyGrid(FRAME), min(4.0, 1.2 * looks), 0
    for _ in range(looks):
        _enter(grid, _flat(2.02))
    cleared = []
    for k in range(1, 30):
        rows, columns, changed = grid.integrate(_flat(2.02, reach_m=4.0), ORIGIN, CAMERA.height_m, DOWN)
        iy, ix = grid.frame.index(np.array([2.025, 0.025]))
        if changed[iy - rows.start, ix - columns.start]:
            cleared.append(k)
        if _at(grid, 2.025, 0.025) >= 0:
            still = k
    assert len(cleared) == 1
    assert belief / 0.4 - 1 - 1e-3 <= still <= belief / 0.4 + 1e-3
    assert cleared[0] in (still, still + 1)


def test_the_order_of_looks_does_not_matter_below_the_bound():
    """Five poses in a room, in 6 orders: the same log-odds to 1e-5. With the bound in reach it is not promised."""
    room, config = Room(), OccupancyConfig(limit=1000.0)
    poses = [(-1.0, 0.5, 0.0), (-1.0, 0.5, 0.7), (1.2, -0.8, 2.5), (0.3, 0.1, -1.6), (0.0, 1.0, 3.0)]
    scans = [scan_from_depth(room.depth(pose), CAMERA) for pose in poses]
    grids = []
    for order in itertools.islice(itertools.permutations(range(5)), 0, 120, 21):
        grid = OccupancyGrid(FRAME, config)
        for k in order:
            _enter(grid, scans[k], poses[k])
        grids.append(grid)
    for grid in grids[1:]:
        np.testing.assert_allclose(grid.log_odds, grids[0].log_odds, atol=1e-5)
        np.testing.assert_array_equal(grid.explored, grids[0].explored)
    assert (grids[0].log_odds > 1).any() and (grids[0].log_odds < -1).any()


@pytest.mark.parametrize("yaw", [0.0, 0.3, math.pi / 2, -2.0])
def test_free_is_what_lies_in_view_before_the_wall(yaw):
    """Brute force over all cells: in the wedge of view, nearer than the walls and than 5 m, free; others unchanged.

    Cells within two of the borders of wedge and range may be either, and within three of walls: seen at a grazing
    angle, one column takes in that much. No cell is both free and hit by one look.
    """
    room, pose = Room(low_xy=(-3.0, -2.0), high_xy=(5.8, 2.0)), np.array([-1.0, 0.4, yaw])
    grid = OccupancyGrid(FRAME)
    _enter(grid, scan_from_depth(room.depth(pose), CAMERA), pose)
    centres = FRAME.centres(np.ones(FRAME.shape, bool)).reshape(*FRAME.shape, 2)
    offset = centres - pose[:2]
    ahead = offset @ [math.cos(yaw), math.sin(yaw)]
    left = offset @ [-math.sin(yaw), math.cos(yaw)]
    within = np.minimum(centres - room.low_xy, np.array(room.high_xy) - centres).min(axis=-1)
    inner = (ahead - np.abs(left) > 0.1) & (within > 0.15) & (ahead < 4.9)
    outer = (ahead - np.abs(left) > -0.1) & (within > -0.1) & (ahead < 5.1)
    assert (grid.log_odds[inner] < 0).all()
    assert (grid.log_odds[~outer] == 0).all()
    np.testing.assert_array_equal(np.unique(grid.log_odds), np.float32([-0.4, 0.0, 1.2]))
    distance = np.hypot(ahead, left)
    assert grid.explored[inner & (distance < 3.15)].all()
    assert not grid.explored[distance > 3.25].any()


def test_a_grown_map_is_the_map_that_was_large_from_the_start():
    """Looks before and after growing by 80 cells on the left and 160 below: bit for bit; off by one would be noise."""
    room = Room(low_xy=(-3.0, -5.0), high_xy=(3.0, 2.0))
    small = GridFrame(origin_xy=(-3.2, -2.4), resolution_m=0.05, shape=(100, 130))
    large = small.padded(80, 0, 160, 40)
    grown, whole = OccupancyGrid(small), OccupancyGrid(large)
    for grid in (grown, whole):
        for pose in [(0.0, 0.0, 0.1), (-0.5, 0.5, 2.2)]:
            _enter(grid, scan_from_depth(room.depth(pose), CAMERA), pose)
        if grid is grown:
            grid.grow(large, 80, 160)
        _enter(grid, scan_from_depth(room.depth((0.0, -1.0, -1.5)), CAMERA), (0.0, -1.0, -1.5))
        grid.stand(np.array([0.0, -1.0, -1.5]), Hull(0.1))
    assert grown.frame == whole.frame
    # Before it grew, the small map could not hold what lies outside of it.
    old = np.s_[160:260, 80:210]
    for name in ("log_odds", "probability", "explored", "top_m"):
        a, b = getattr(grown, name), getattr(whole, name)
        np.testing.assert_array_equal(a[old], b[old])
        assert a.shape == large.shape
    assert (grown.log_odds[:160] > 0).any(), "the last look must show the wall far below the first map"


@pytest.mark.parametrize(("ahead_m", "clears"), [(0.5, False), (0.9, False), (1.2, True), (1.6, True)])
def test_a_low_box_is_cleared_only_from_where_it_would_be_seen(ahead_m, clears):
    """A box 0.3 m high: the lowest ray, 1.25 m - d, is below its top (5 cm to spare) from d = 1.0 m on.

    Nearer the camera looks over it, and thirty looks at the floor behind change nothing.
    """
    grid = OccupancyGrid(FRAME)
    for _ in range(3):
        _enter(grid, _flat(2.02, top_m=0.3))
    assert _at(grid, 2.025, 0.025) > 0
    for _ in range(30):
        _enter(grid, _flat(0.0, reach_m=4.0), (2.025 - ahead_m, 0.025, 0.0))
    assert (_at(grid, 2.025, 0.025) < 0) == clears


def test_where_the_robot_stands_nothing_else_does():
    """Brute force: the cells whose centres are nearer than the radius are free, all others as they were."""
    grid = OccupancyGrid(FRAME)
    grid.log_odds[:] = 2.0
    grid.probability[:] = expit(2.0)
    pose = np.array([0.713, -1.234, 0.6])
    grid.stand(pose, Hull(0.18))
    centres = FRAME.centres(np.ones(FRAME.shape, bool)).reshape(*FRAME.shape, 2)
    under = np.hypot(*(centres - pose[:2]).transpose(2, 0, 1)) < 0.18
    assert under.sum() > 30
    np.testing.assert_array_equal(grid.probability < 0.5, under)
    np.testing.assert_array_equal(grid.log_odds[~under], 2.0)


def test_a_view_box_holds_everything_that_a_scan_changes():
    """Compared with the same scan on a map so large that no box matters: no cell changes outside of the box."""
    room = Room(low_xy=(-3.0, -2.0), high_xy=(5.8, 2.0))
    for yaw in np.arange(-3.0, 3.1, 0.5):
        pose = np.array([0.2, -0.3, yaw])
        scan = scan_from_depth(room.depth(pose), CAMERA)
        grid = OccupancyGrid(FRAME)
        (x0, y0), (x1, y1) = grid.view_box(scan, pose)
        points = to_map(pose, np.column_stack([scan.depth_m, scan.depth_m * scan.left]))
        points = points[scan.depth_m < 5.0]
        assert ((points > [x0, y0]) & (points < [x1, y1])).all()
        _enter(grid, scan, pose)
        iy, ix = np.nonzero(grid.log_odds)
        changed = FRAME.to_points(np.column_stack([ix, iy]) + 0.5)
        assert ((changed > [x0 - 0.05, y0 - 0.05]) & (changed < [x1 + 0.05, y1 + 0.05])).all()


@pytest.mark.parametrize("values", [{"hit": 0.0}, {"miss": -0.1}, {"limit": 0.0}, {"explored_range_m": 9.0}])
def test_impossible_weights_are_rejected(values):
    """By name."""
    with pytest.raises(ValueError, match=next(iter(values))):
        OccupancyConfig(**values)
