"""Bumps that the map shows beforehand: of steps forward, and of turns that swing the hull."""

import math

import pytest

from slam.actions import FORWARD_M, PUBLISHED, TURN_RAD, Action
from slam.control.guard import Guard
from tests.slam.floors import floor, robot_of

RADIUS_M = 0.11
#: A base that swings 2 cm to the side with each turn of 10 degrees.
SWINGS = ((FORWARD_M, 0.0, 0.0), (0.0, 0.02, TURN_RAD), (0.0, -0.02, -TURN_RAD))


def _bumps(wall, yaw=0.0, motions=SWINGS) -> set[Action]:
    """Of a robot at the origin, on cells of 5 cm whose surfaces are their centres."""
    guard = Guard(robot_of(motions, radius_m=RADIUS_M))
    found = guard.bumps(floor((0.0, 0.0, yaw), walls=[wall]))
    return {action for action in PUBLISHED if found[action]}


@pytest.mark.parametrize(("surface_m", "bumps"), [(0.325, True), (0.375, False)])
def test_a_step_bumps_if_the_wall_is_nearer_than_step_and_hull(surface_m, bumps):
    """36 cm are needed, less 1 cm that a map may err by; a wall behind or at the side bars no step."""
    wall = (surface_m - 0.02, -1.0, surface_m + 0.02, 1.0)
    assert _bumps(wall) == ({Action.FORWARD} if bumps else set())
    assert not _bumps(wall, yaw=math.pi) and not _bumps(wall, yaw=math.pi / 2)


def test_a_turn_bumps_that_swings_the_hull_against_a_wall():
    """A wall 1.5 cm to the left of the hull, and turns that swing it by 2 cm; to the right of a robot that looks back.

    No turn bumps of a base that turns about its middle, or whose turns are unknown.
    """
    wall = (-1.0, 0.11, 1.0, 0.14)
    assert _bumps(wall) == {Action.LEFT}
    assert _bumps(wall, yaw=math.pi) == {Action.RIGHT}
    in_place = ((FORWARD_M, 0.0, 0.0), (0.0, 0.0, TURN_RAD), (0.0, 0.0, -TURN_RAD))
    assert not _bumps(wall, motions=in_place)
    assert not _bumps(wall, motions=(None, None, None))
