"""Manoeuvres before turns that would push the hull, compared with a search over all of them, cell by cell."""

import numpy as np
import pytest

from slam.actions import FORWARD_M, TURN_RAD, Action
from slam.control.manoeuvre import easier
from slam.hull import Hull
from slam.planning.clearance import Clearance
from tests.slam.floors import floor

RADIUS_M, PRICE = 0.1, 2.0
MOTION = np.array([[FORWARD_M, 0, 0], [0, 0.02, TURN_RAD], [0, -0.02, -TURN_RAD], [-FORWARD_M, 0, 0]])
IN_PLACE = MOTION * [1, 0, 1]
#: A dead end 0.28 m wide, open towards -x.
DEAD_END = [(-0.4, 0.14, 0.2, 0.2), (-0.4, -0.2, 0.2, -0.14), (0.15, -0.2, 0.2, 0.2)]


def _easier(walls, turns, motion=MOTION, **options):
    estimate = floor(walls=walls)
    around = Clearance.around(estimate, 2.0)
    return easier(np.zeros(3), turns, around, motion, hull=Hull(RADIUS_M), push_price=PRICE, **options)


class _ByCells:
    """The same floor, cell by cell."""

    def __init__(self, walls):
        estimate = floor(walls=walls)
        self._cells = estimate.frame.centres(estimate.obstacle)

    def room(self, pose) -> float:
        return float(np.hypot(*(self._cells - pose[:2]).T).min(initial=0.5)) - RADIUS_M

    def after(self, pose, action):
        dx, dy, turn = MOTION[action]
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return np.array([pose[0] + c * dx - s * dy, pose[1] + s * dx + c * dy, pose[2] + turn])

    def pushes(self, pose, turns) -> int:
        found = 0
        for _ in range(abs(turns)):
            there = self.after(pose, Action.LEFT if turns > 0 else Action.RIGHT)
            found += self.room(there) < 0.005 and self.room(there) < self.room(pose) - 0.002
            pose = there
        return found

    def price(self, before, rest, turns) -> float:
        """What a manoeuvre costs more than turning, pushes included [decisions]; inf where a step meets a wall."""
        pose, price = np.zeros(3), 0.0
        for action in before:
            if action in (Action.LEFT, Action.RIGHT):
                price += 1 + PRICE * self.pushes(pose, 1 if action is Action.LEFT else -1)
            else:
                price += 1
                shift = self.after(pose, action) - pose
                parts = [self.room(pose + part * shift) for part in (0.25, 0.5, 0.75, 1.0)]
                if min(parts) < min(self.room(pose) - 0.011, 0.019):
                    return np.inf
            pose = self.after(pose, action)
        return price + abs(rest) - abs(turns) + PRICE * self.pushes(pose, rest)


@pytest.mark.parametrize("walls", [[], DEAD_END])
def test_a_base_that_turns_about_its_middle_needs_none(walls):
    assert _easier(walls, 18, IN_PLACE) == ([], 18)


def test_nothing_goes_before_turns_in_the_open():
    assert _easier([], -18) == ([], -18) and _easier(DEAD_END, 0) == ([], 0)


@pytest.mark.parametrize("turns", [18, -18, 12])
def test_no_path_into_the_open_is_cheaper(turns):
    """Of all with up to four turns and four steps; none that it gives meets a wall. It costs less than half as much."""
    cells = _ByCells(DEAD_END)
    before, rest = _easier(DEAD_END, turns)
    found = cells.price(before, rest, turns)
    assert Action.BACKWARD in before
    assert found < 0.5 * cells.price([], turns, turns)
    for aside in range(-4, 5):
        first = [Action.LEFT if aside > 0 else Action.RIGHT] * abs(aside)
        for step in (Action.FORWARD, Action.BACKWARD):
            for count in range(1, 5):
                # A few millimetres lie between cells and the distances that are read between them.
                assert found <= cells.price([*first, *[step] * count], turns - aside, turns) + 2 * PRICE


def test_without_steps_back_it_stays_in_the_dead_end():
    before, rest = _easier(DEAD_END, 18, steps=(Action.FORWARD,))
    assert (
        Action.BACKWARD not in before and rest + before.count(Action.LEFT) - before.count(Action.RIGHT) == 18
    )


def test_looking_around_takes_as_many_turns_from_a_place_nearby():
    before, rest = _easier(DEAD_END, 36, around=True)
    assert Action.BACKWARD in before and rest == 36
