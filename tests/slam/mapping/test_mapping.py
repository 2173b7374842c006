"""The classical mapper maps a room where its walls are, keeps hold of its pose, and survives blindness."""

import math

import numpy as np
import pytest

from slam.actions import FORWARD_M, TURN_RAD, Action
from slam.grid import MapEstimate
from slam.mapping import classical
from slam.mapping.classical import ClassicalMapper, MapperConfig
from slam.mapping.occupancy import OccupancyGrid
from slam.matching.surfaces import SurfaceGrid
from slam.odometry import calibrated
from slam.poses import between, compose
from slam.robot import Robot
from tests.slam.rooms import Room

F, L, R = Action.FORWARD, Action.LEFT, Action.RIGHT
#: Once around on the spot, then twice about the room: 2 m by 1 m.
ROUND = [L] * 36 + ([F] * 8 + [L] * 9 + [F] * 4 + [L] * 9) * 4
START = np.array([-1.0, -0.5, 0.0])
MOTION = np.array([[FORWARD_M, 0, 0], [0, 0, TURN_RAD], [0, 0, -TURN_RAD]])
#: What odometry reads too much in each step: of the size measured on the LoCoBot.
BIAS = np.array([[0.01, -0.005, 0.003], [0.005, 0.02, -0.004], [-0.004, -0.018, 0.005]])


def _drive(mapper, room, actions, *, bias=None, rng=None, start=START):
    """Poses, true and estimated, along a route; the displacements carried out are nominal."""
    pose = start.copy()
    mapper.reset(start)
    mapper.update(room.depth(pose))
    true, found = [pose], [mapper.pose]
    for action in actions:
        pose = compose(pose, MOTION[action])
        odometry = MOTION[action].copy()
        if bias is not None:
            odometry += bias[action]
        if rng is not None:
            odometry += rng.normal(0, [0.004, 0.004, 0.003])
        mapper.update(room.depth(pose), action, odometry)
        true.append(pose)
        found.append(mapper.pose)
    return np.array(true), np.array(found)


def _obstacles(estimate: MapEstimate):
    return estimate.frame.centres(estimate.obstacle)


def _off_cell_m(room: Room, centres):
    """How far the walls are from the nearest point of each cell: 0 for a cell that a wall runs through."""
    return np.maximum(room.wall_distance(centres) - 0.5 * 0.05, 0.0)


def _finite(estimate: MapEstimate) -> bool:
    offset = estimate.surface_offset_m
    return bool(
        np.isfinite(estimate.pose).all()
        and np.isfinite(estimate.obstacle_probability).all()
        and (offset is None or np.isfinite(offset).all())
    )


@pytest.fixture(scope="module")
def mapped():
    room, mapper = Room(), ClassicalMapper()
    true, found = _drive(mapper, room, ROUND)
    return room, mapper.estimate(), true, found


def test_with_exact_odometry_every_obstacle_is_a_wall(mapped):
    """Each obstacle cell is within one cell (0.05 m) of a true wall."""
    room, estimate, _, _ = mapped
    assert estimate.obstacle.any()
    assert room.wall_distance(_obstacles(estimate)).max() <= 0.05


def test_with_exact_odometry_every_wall_is_an_obstacle(mapped):
    """Every 5 cm along the walls an obstacle cell is within one cell, but for 2 % in the corners."""
    room, estimate, _, _ = mapped
    (x0, y0), (x1, y1) = room.low_xy, room.high_xy
    x, y = np.arange(x0 + 0.1, x1 - 0.1, 0.05), np.arange(y0 + 0.1, y1 - 0.1, 0.05)
    walls = np.concatenate(
        [np.stack([x, np.full_like(x, k)], axis=1) for k in (y0, y1)]
        + [np.stack([np.full_like(y, k), y], axis=1) for k in (x0, x1)]
    )
    gap = np.hypot(*(walls[:, None] - _obstacles(estimate)[None]).transpose(2, 0, 1)).min(axis=1)
    assert np.mean(gap <= 0.05) > 0.98


def test_the_floor_of_the_room_is_free_and_seen(mapped):
    """All cells more than 10 cm from the walls are known free and explored; nothing outside of the room is."""
    room, estimate, _, _ = mapped
    centres = estimate.frame.centres(np.ones(estimate.frame.shape, bool))
    inside = ((centres > room.low_xy) & (centres < room.high_xy)).all(axis=1)
    deep = inside & (room.wall_distance(centres) > 0.1)
    assert estimate.known_free.ravel()[deep].all()
    assert estimate.explored.ravel()[deep].all()
    far_out = ~inside & (room.wall_distance(centres) > 0.1)
    assert not estimate.known_free.ravel()[far_out].any()


def test_surfaces_are_known_to_much_less_than_a_cell(mapped):
    """Centre plus offset lies on the wall: median below 5 mm, where cell centres alone are up to 25 mm off."""
    room, estimate, _, _ = mapped
    surface = _obstacles(estimate) + estimate.surface_offset_m[estimate.obstacle]
    assert np.median(room.wall_distance(surface)) < 0.005


def test_with_exact_odometry_the_pose_stays_exact(mapped):
    """Matching takes nothing away from a perfect prediction: below 1 cm and 0.2 degrees at all 140 decisions."""
    _, _, true, found = mapped
    off = np.array([between(a, b) for a, b in zip(true, found, strict=True)])
    assert np.hypot(*off[:, :2].T).max() < 0.01
    assert np.abs(off[:, 2]).max() < math.radians(0.2)


def test_biased_and_noisy_odometry_stays_below_five_centimetres():
    """Calibrated bias, noise of 4 mm and 0.17 degrees. Dead reckoning gets over 0.4 m off."""
    rng, room = np.random.default_rng(0), Room()
    runs = np.random.default_rng(1).normal(size=(3, 200, 3)) * [0.004, 0.004, 0.003]
    odometry = calibrated({action: BIAS[action] + runs[action] for action in (F, L, R)})
    mapper = ClassicalMapper(Robot(odometry=odometry))
    true, found = _drive(mapper, room, ROUND, bias=BIAS, rng=rng)
    off = np.hypot(*(true - found)[:, :2].T)
    assert off.max() < 0.05
    assert _off_cell_m(room, _obstacles(mapper.estimate())).max() < 0.05
    dead_reckoning, worst = START, 0.0
    for action, pose in zip(ROUND, true[1:], strict=True):
        dead_reckoning = compose(dead_reckoning, MOTION[action] + BIAS[action])
        worst = max(worst, float(np.hypot(*(dead_reckoning - pose)[:2])))
    assert worst > 0.4, "the readings must need correction"


def test_an_uncalibrated_bias_is_learned():
    """A step that reads 1 cm long and a turn that reads 2 cm sideways: within 4 mm after two rounds."""
    mapper = ClassicalMapper()
    true, found = _drive(mapper, Room(), ROUND, bias=BIAS)
    assert np.abs(mapper.odometry.bias[F, :2] - BIAS[F, :2]).max() < 0.004
    assert np.abs(mapper.odometry.bias[L, :2] - BIAS[L, :2]).max() < 0.004
    assert np.hypot(*(true - found)[:, :2].T).max() < 0.1


@pytest.mark.parametrize("wild", [0.0, np.nan])
def test_three_hundred_blind_frames_do_no_harm(wild):
    """The pose is that of odometry, the map what the hull stood on; nothing grows, nothing is NaN, no error."""
    mapper, blind = ClassicalMapper(), np.full((32, 32), wild, np.float32)
    before = mapper.frame.shape
    pose = np.zeros(3)
    mapper.update(blind)
    for k in range(300):
        action = F if k % 20 == 19 else L
        pose = compose(pose, MOTION[action])
        estimate = mapper.update(blind, action, MOTION[action])
    assert _finite(estimate)
    np.testing.assert_allclose(estimate.pose[:2], pose[:2], atol=1e-6)
    assert estimate.frame.shape == before
    assert not estimate.obstacle.any()


def test_the_map_does_not_outgrow_its_bound():
    """Driven 22 m down a hall with a bound of 400 m2, it stops growing and goes on giving poses."""
    hall = Room(low_xy=(-45.0, -3.0), high_xy=(45.0, 3.0))
    mapper = ClassicalMapper(config=MapperConfig(max_area_m2=400.0))
    pose = np.zeros(3)
    mapper.update(hall.depth(pose, size=32))
    for _ in range(90):
        pose = compose(pose, MOTION[F])
        estimate = mapper.update(hall.depth(pose, size=32), F, MOTION[F])
        assert estimate.obstacle_probability.size * 0.05**2 <= 400.0
    assert _finite(estimate)
    assert np.hypot(*(estimate.pose - pose)[:2]) < 0.2


def test_a_hall_of_a_quarter_kilometre_is_mapped_to_its_end():
    """By itself the map grows to 250 m x 16 m, a tenth of what it may; both long walls stand in its last metre."""
    hall = Room(low_xy=(-2.0, -3.0), high_xy=(252.0, 3.0))
    mapper, stride = ClassicalMapper(), np.array([1.0, 0.0, 0.0])
    pose = np.zeros(3)
    mapper.update(hall.depth(pose, size=32))
    for _ in range(249):
        pose = compose(pose, stride)
        estimate = mapper.update(hall.depth(pose, size=32), F, stride)
    for y in (-3.0, 3.0):
        x = pose[0] + 2.7
        rows, columns, _ = estimate.frame.window((x - 0.3, y - 0.2), (x + 0.3, y + 0.2))
        assert estimate.obstacle[rows, columns].any()
    assert np.hypot(*(estimate.pose - pose)[:2]) < 0.2


def test_tiles_drawn_again_equal_a_map_drawn_from_all_scans(monkeypatch):
    """The first scans shift by 5 cm: of 663 obstacle cells none differs from those drawn from all scans.

    Bound 1 %: rounding may move a point on the border of two cells.
    """
    monkeypatch.setattr(classical, "_WHOLE_SCANS", 0)
    monkeypatch.setattr(classical, "_TILE_M", 1.0)
    mapper = ClassicalMapper()
    _drive(mapper, Room(), ROUND)
    poses = mapper.tracker.poses()
    poses[:30, 0] += 0.05
    monkeypatch.setattr(mapper.tracker, "poses", lambda: poses)
    mapper._rearrange()
    n_stale = len(mapper._stale)
    while mapper._stale:
        mapper._redraw_stale()
    assert n_stale > 9
    occupancy, surfaces = OccupancyGrid(mapper.frame), SurfaceGrid(mapper.frame)
    for frame, pose in zip(mapper._frames, poses, strict=True):
        mapper._draw(frame, pose, occupancy, surfaces)
    obstacle = occupancy.log_odds > 0
    differs = (obstacle != mapper.estimate().obstacle).sum()
    assert differs <= 0.01 * obstacle.sum()
    same = np.isclose(mapper.surfaces.front_m, surfaces.front_m, atol=1e-3).all(axis=2)
    assert (~same).sum() <= 0.01 * obstacle.sum()


@pytest.mark.parametrize(
    "odometry",
    [
        None,
        np.full(3, np.nan),
        np.array([np.inf, 0.0, 0.0]),
    ],
)
def test_odometry_that_is_missing_or_not_finite_is_left_out(odometry):
    """The robot counts as not moved; what it sees decides, and the next good reading counts."""
    room, mapper = Room(), ClassicalMapper()
    mapper.reset(START)
    for _ in range(5):
        estimate = mapper.update(room.depth(START), F, odometry)
    assert _finite(estimate)
    np.testing.assert_allclose(estimate.pose, START, atol=1e-3)
    pose = compose(START, MOTION[F])
    estimate = mapper.update(room.depth(pose), F, MOTION[F])
    np.testing.assert_allclose(estimate.pose, pose, atol=0.02)


def test_what_is_handed_out_cannot_be_written():
    """The arrays of an estimate are the mapper's own: a planner that writes into them must fail loudly."""
    mapper = ClassicalMapper()
    estimate = mapper.update(Room().depth(np.zeros(3), size=32))
    with pytest.raises(ValueError, match="read-only"):
        estimate.obstacle_probability[0, 0] = 1.0


def test_the_same_input_gives_the_same_map_bit_for_bit():
    """Two mappers, and one of them used before."""
    room, first, second = Room(), ClassicalMapper(), ClassicalMapper()
    _drive(second, room, [F, L, F])
    for mapper in (first, second):
        _drive(mapper, room, ROUND[30:44])
    np.testing.assert_array_equal(first.occupancy.log_odds, second.occupancy.log_odds)
    np.testing.assert_array_equal(first.pose, second.pose)
