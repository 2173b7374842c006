"""A robot that was moved by hand finds itself again, and one that was not is left alone."""

import math

import numpy as np
import pytest

from slam.actions import FORWARD_M, TURN_RAD, Action
from slam.mapping.classical import ClassicalMapper
from slam.mapping.relocalization import RelocalizationConfig
from slam.poses import compose, wrap
from tests.slam.rooms import Room

MOTION = np.array([[FORWARD_M, 0, 0], [0, 0, TURN_RAD], [0, 0, -TURN_RAD]])
START = np.array([-1.0, -0.5, 0.0])
#: Once around on the spot, then round the room.
ROUND = [Action.LEFT] * 36 + ([Action.FORWARD] * 4 + [Action.LEFT] * 9) * 3


def _mapped(room: Room) -> tuple[ClassicalMapper, np.ndarray]:
    """A mapper that has been round a room with noisy odometry, and where the robot truly is."""
    rng, mapper, pose = np.random.default_rng(1), ClassicalMapper(), START.copy()
    mapper.reset(pose)
    mapper.update(room.depth(pose))
    for action in ROUND:
        pose = compose(pose, MOTION[action])
        mapper.update(room.depth(pose), action, MOTION[action] + rng.normal(0, [0.004, 0.004, 0.003]))
        assert not mapper.relocalizer.lost
    return mapper, pose


def _turn_on(mapper: ClassicalMapper, room: Room, pose: np.ndarray, turns: int) -> tuple[float, float]:
    """Errors of position [m] and heading [rad] after some turns to the left from a true pose."""
    for _ in range(turns):
        pose = compose(pose, MOTION[Action.LEFT])
        mapper.update(room.depth(pose), Action.LEFT, MOTION[Action.LEFT])
    return math.hypot(*(mapper.pose - pose)[:2]), abs(wrap(mapper.pose[2] - pose[2]))


def _push(pose: np.ndarray, x_m: float, y_m: float, turned_deg: float = 0.0) -> np.ndarray:
    return np.array([pose[0] + x_m, pose[1] + y_m, wrap(pose[2] + math.radians(turned_deg))])


@pytest.mark.parametrize("direction_deg", range(0, 360, 45))
def test_a_robot_pushed_by_half_a_metre_finds_itself(direction_deg):
    """Either side: within 3 cm and 1 degree when it has turned by 90 degrees (measured 0.6 cm, 0.1 degrees)."""
    room = Room()
    mapper, pose = _mapped(room)
    a = math.radians(direction_deg)
    off_m, off_rad = _turn_on(mapper, room, _push(pose, 0.5 * math.cos(a), 0.5 * math.sin(a)), 9)
    assert off_m < 0.03
    assert off_rad < math.radians(1)


@pytest.mark.parametrize("turned_deg", [-25, 20])
def test_a_push_may_turn_the_robot_as_well(turned_deg):
    """By 0.36 m and up to 30 degrees: the same bounds."""
    room = Room()
    mapper, pose = _mapped(room)
    off_m, off_rad = _turn_on(mapper, room, _push(pose, 0.3, 0.2, turned_deg), 9)
    assert off_m < 0.03
    assert off_rad < math.radians(1)


def test_odometry_learns_nothing_from_a_push():
    """The bias of the turn during which it happened stays within 2 mm of what it was, not a share of 0.5 m."""
    room = Room()
    mapper, pose = _mapped(room)
    before = mapper.odometry.bias.copy()
    _turn_on(mapper, room, _push(pose, 0.0, -0.5), 1)
    np.testing.assert_allclose(mapper.odometry.bias, before, atol=0.002)


def test_while_the_robot_is_lost_the_map_stays_as_it_was():
    """Set down in another room, it finds nothing that fits: bit for bit the same map, until it is given up on.

    After as many frames as the settings say, what is seen is believed again, and entered.
    """
    room, other = Room(), Room(low_xy=(-1.2, -0.9), high_xy=(1.3, 1.1))
    mapper, pose = _mapped(room)
    lost: list[bool] = []
    for _ in range(RelocalizationConfig().tries + 10):
        pose = compose(pose, MOTION[Action.LEFT])
        before = mapper.occupancy.log_odds.copy()
        mapper.update(other.depth(np.array([0.0, 0.0, pose[2]])), Action.LEFT, MOTION[Action.LEFT])
        lost.append(mapper.relocalizer.lost)
        changed = np.argwhere(mapper.occupancy.log_odds != before)
        from_robot = np.abs(changed - np.array(mapper.frame.index(mapper.pose[:2]))).max(initial=0)
        if lost[-1]:
            assert from_robot <= 3, "only the cells under the hull, which are always free"
    assert sum(lost) >= 5, "another room must be noticed"
    assert sum(lost) <= RelocalizationConfig().tries, (
        "a changed building must not blind the mapper permanently"
    )


def test_a_new_room_is_no_reason_for_doubt():
    """Round a hall 14 m long, of which each look shows 6 m: never lost, though most of it was never seen before."""
    hall, mapper = Room(low_xy=(-7.0, -1.0), high_xy=(7.0, 1.0)), ClassicalMapper()
    pose = np.array([-6.0, 0.0, 0.0])
    mapper.reset(pose)
    mapper.update(hall.depth(pose))
    for action in [Action.FORWARD] * 48 + [Action.LEFT] * 18 + [Action.FORWARD] * 40:
        pose = compose(pose, MOTION[action])
        mapper.update(hall.depth(pose), action, MOTION[action])
        assert not mapper.relocalizer.lost
    assert math.hypot(*(mapper.pose - pose)[:2]) < 0.05


def test_a_bare_wall_is_no_reason_for_doubt():
    """A wall that fills the view, from 0.6 m: 100 turns to and fro leave the pose within 2 cm of the truth."""
    room, mapper = Room(low_xy=(-40.0, -40.0), high_xy=(0.6, 40.0)), ClassicalMapper()
    pose = np.zeros(3)
    mapper.update(room.depth(pose))
    for k in range(100):
        action = Action.LEFT if k % 2 else Action.RIGHT
        pose = compose(pose, MOTION[action])
        mapper.update(room.depth(pose), action, MOTION[action])
        assert not mapper.relocalizer.lost
    assert math.hypot(*(mapper.pose - pose)[:2]) < 0.02


@pytest.mark.parametrize("values", [{"settled": 0.5}, {"search_m": 0.0}, {"contradiction": 2.0}])
def test_impossible_settings_are_rejected(values):
    """By name."""
    with pytest.raises(ValueError, match=next(iter(values))):
        RelocalizationConfig(**values)
