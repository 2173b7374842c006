"""A step that falls short marks the cells before the hull, once, where nothing on the map explains it."""

import math

import numpy as np
import pytest

from slam.actions import FORWARD_M, Action, Velocity
from slam.grid import GridFrame
from slam.hull import Hull
from slam.mapping.collisions import CollisionConfig, CollisionMarks
from slam.poses import to_map

FRAME = GridFrame(origin_xy=(-2.0, -2.0), resolution_m=0.05, shape=(80, 80))
OPEN = np.zeros(FRAME.shape, np.float32)
POSES = [(0.013, 0.021, 0.0), (0.3, -0.4, math.pi / 2), (-0.2, 0.6, 2.1), (0.0, 0.0, -0.7)]


def _stop(marks, pose, *, step=1, obstacle=OPEN, driven_m=0.0) -> bool:
    return marks.update(step, Action.FORWARD, np.array([driven_m, 0.0, 0.0]), np.array(pose, float), obstacle)


def _in_robot(marks, pose):
    """Centres of the blocked cells, ahead and left of the robot [m]."""
    points = marks.frame.centres(marks.blocked) - np.array(pose[:2])
    return points @ np.array(
        [[math.cos(pose[2]), -math.sin(pose[2])], [math.sin(pose[2]), math.cos(pose[2])]]
    )


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("radius_m", [0.10, 0.18])
def test_a_stop_marks_the_cells_before_the_hull(pose, radius_m):
    """From the hull to 0.1 m before it, within half a cell's diagonal (0.036 m); the point of contact is marked.

    Nothing at its sides or behind it is, and nothing under it: it must be able to leave.
    """
    marks = CollisionMarks(FRAME, Hull(radius_m))
    assert _stop(marks, pose)
    ahead, left = _in_robot(marks, pose).T
    assert len(ahead) >= 2
    assert ahead.min() > radius_m - 0.011 and ahead.max() < radius_m + 0.1 + 0.061
    assert np.abs(left).max() < 0.05 + 0.036
    iy, ix = FRAME.index(to_map(np.array(pose), np.array([radius_m + 0.03, 0.0])))
    assert marks.blocked[iy, ix]
    assert np.hypot(ahead, left).min() > radius_m - 0.011


@pytest.mark.parametrize(
    ("action", "driven_m", "stopped"),
    [
        (Action.FORWARD, 0.0, True),
        (Action.FORWARD, 0.19, True),
        (Action.FORWARD, 0.21, False),
        (Action.FORWARD, FORWARD_M, False),
        (Action.BACKWARD, 0.0, True),
        (Action.BACKWARD, -0.21, False),
        (Action.LEFT, 0.0, False),
        (Action.RIGHT, 0.0, False),
    ],
)
def test_only_a_step_that_falls_short_is_a_stop(action, driven_m, stopped):
    """Shorter than 0.2 m of 0.25 m; turns go nowhere by design and mark nothing."""
    marks = CollisionMarks(FRAME)
    displacement = np.array([driven_m, 0.0, 0.0])
    assert marks.update(1, action, displacement, np.zeros(3), OPEN) == stopped
    assert marks.blocked.any() == stopped


def test_a_velocity_that_falls_short_is_a_stop_once_the_robot_has_accelerated():
    """0.5 m/s for 0.5 s: from rest not judged before the third command; then 0.19 m of 0.25 m are a stop, 0.21 m none.

    Nor is a robot judged that brakes, turns on the spot, or does another action in between.
    """
    ahead, pose = Velocity(0.5, 0.2, 0.5), np.zeros(3)
    for driven_m, expected in ((0.19, True), (0.21, False)):
        marks = CollisionMarks(FRAME)
        stops = [
            marks.update(k, ahead, np.array([length_m, 0.0, 0.1]), pose, OPEN)
            for k, length_m in enumerate((0.05, 0.1, driven_m))
        ]
        assert stops == [False, False, expected] and marks.blocked.any() == expected
        for k, command in enumerate((Velocity(0.05, 0, 0.5), Velocity(0, 1, 0.5), Action.LEFT, ahead, ahead)):
            assert not marks.update(3 + k, command, np.zeros(3), pose, OPEN)


def test_a_step_back_that_is_stopped_marks_what_is_behind():
    """The cells of a stop forward, turned by half a circle about the robot."""
    marks, turned = CollisionMarks(FRAME), CollisionMarks(FRAME)
    pose = np.array([0.0, 0.0, 0.0])
    marks.update(1, Action.BACKWARD, np.zeros(3), pose, OPEN)
    turned.update(1, Action.FORWARD, np.zeros(3), np.array([0.0, 0.0, math.pi]), OPEN)
    assert marks.blocked.any() and np.array_equal(marks.blocked, turned.blocked)
    assert _in_robot(marks, pose)[:, 0].max() < 0


def test_a_wall_on_the_map_explains_a_stop_and_one_behind_does_not():
    """An obstacle cell at the bow: nothing new is learned, twice; at the third stop in a row it is marked.

    The same cell at the stern explains nothing: marked at once.
    """
    bow, stern = OPEN.copy(), OPEN.copy()
    bow[40, 42], stern[40, 37] = True, True
    marks = CollisionMarks(FRAME)
    for k in (1, 2, 3):
        assert _stop(marks, (0.0, 0.025, 0.0), step=k, obstacle=bow)
        assert marks.blocked.any() == (k == 3)
    marks = CollisionMarks(FRAME)
    _stop(marks, (0.0, 0.025, 0.0), obstacle=stern)
    assert marks.blocked.any()


def test_marks_widen_while_the_robot_goes_on_bumping_up_to_a_bound():
    """Each stop widens the strip by 2 cells, to at most 0.45 m and the cells that it touches; a free step ends that."""
    marks, widths = CollisionMarks(FRAME), []
    for k in range(1, 9):
        _stop(marks, (0.0, 0.025, 0.0), step=k)
        widths.append(float(np.ptp(_in_robot(marks, (0.0, 0.025, 0.0))[:, 1])))
    assert (np.diff(widths) >= 0).all()
    assert widths[3] > widths[1] > widths[0]
    assert widths[-1] == widths[-2] <= 0.45 + 0.05
    _stop(marks, (0.0, 0.025, 0.0), step=9, driven_m=FORWARD_M)
    marks.blocked[:] = False
    _stop(marks, (0.0, 0.025, 0.0), step=10)
    assert np.ptp(_in_robot(marks, (0.0, 0.025, 0.0))[:, 1]) == pytest.approx(widths[0])


def test_marks_fade_and_a_second_bump_lasts_twice_as_long():
    """Made at decision 1: removed at 151. Made again in the same place at 200: there at 499, removed at 500."""
    marks, pose = CollisionMarks(FRAME), (0.0, 0.025, 0.0)
    turn = np.array([0.0, 0.0, 0.1])

    def standing(step):
        marks.update(step, Action.LEFT, turn, np.array(pose), OPEN)
        return bool(marks.blocked.any())

    _stop(marks, pose, step=1)
    assert standing(150)
    assert not standing(151)
    _stop(marks, pose, step=200, driven_m=0.15)
    assert standing(499)
    assert not standing(500)


def test_the_hull_takes_marks_off_where_it_stands():
    """Brute force: removed are exactly those whose centres are nearer than the radius."""
    marks = CollisionMarks(FRAME)
    marks.blocked[30:60, 30:60] = True
    before = marks.blocked.copy()
    pose = np.array([0.113, 0.267, 1.0])
    marks.stand(pose)
    centres = FRAME.centres(np.ones(FRAME.shape, bool)).reshape(*FRAME.shape, 2)
    under = np.hypot(*(centres - pose[:2]).transpose(2, 0, 1)) < 0.10
    assert under.sum() > 8
    np.testing.assert_array_equal(marks.blocked, before & ~under)


def test_marks_stay_in_their_place_when_the_map_grows():
    """The centres in `map` are the same before and after, and they fade at the same decision."""
    marks, pose = CollisionMarks(FRAME), (0.3, -0.4, 2.1)
    _stop(marks, pose)
    before = FRAME.centres(marks.blocked)
    grown = FRAME.padded(80, 0, 160, 80)
    marks.grow(grown, 80, 160)
    np.testing.assert_allclose(grown.centres(marks.blocked), before, atol=1e-9)
    marks.update(151, Action.LEFT, np.zeros(3), np.array(pose), np.zeros(grown.shape, np.float32))
    assert not marks.blocked.any()


def test_a_stop_at_the_edge_of_the_map_is_no_error():
    """Cells beyond are left out."""
    marks = CollisionMarks(FRAME)
    assert _stop(marks, (1.99, 0.0, 0.0))
    assert not marks.blocked.any()


@pytest.mark.parametrize("values", [{"depth_m": -0.1}, {"short_m": 0.3}, {"short_m": 0.0}])
def test_impossible_settings_are_rejected(values):
    """By name."""
    with pytest.raises(ValueError, match=next(iter(values))):
        CollisionConfig(**values)


#: A base that swings 2 cm to the side with each turn of 10 degrees.
SWINGS = ((FORWARD_M, 0.0, 0.0), (0.0, 0.02, 0.17), (0.0, -0.02, -0.17))


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize(("action", "side"), [(Action.LEFT, 1), (Action.RIGHT, -1)])
def test_update_marks_cells_next_to_the_hull_where_a_swing_was_stopped(pose, action, side):
    """A swing of 0.5 of 2 cm was stopped by something next to the hull; 1.5 cm are usual."""
    marks = CollisionMarks(FRAME, Hull(0.1), motions=SWINGS)
    for swing_m, stopped in ((0.015, False), (0.005, True)):
        displacement = np.array([0.0, side * swing_m, side * 0.17])
        assert marks.update(1, action, displacement, np.array(pose, float), OPEN) is stopped
        assert marks.blocked.any() == stopped
    marks.stand(np.array(pose))
    ahead, left = _in_robot(marks, pose).T
    assert len(left) and np.abs(ahead).max() < 0.05 + 0.036
    assert (side * left).max() < 0.1 + 0.061 and (side * left > 0).all()
    assert not marks.update(100_000, Action.LEFT, np.array([0.0, 0.02, 0.17]), np.zeros(3), OPEN)
    assert marks.blocked.any()


def test_update_does_not_judge_swings_of_bases_that_turn_about_their_middle():
    """A displacement of zero is then usual."""
    in_place = ((FORWARD_M, 0.0, 0.0), (0.0, 0.0, 0.17), (0.0, 0.0, -0.17))
    for motions in ((), (None, None, None), in_place):
        marks = CollisionMarks(FRAME, Hull(0.1), motions=motions)
        assert not marks.update(1, Action.LEFT, np.zeros(3), np.zeros(3), OPEN)
        assert not marks.blocked.any()
