"""The round robots whose sizes and speeds the tests use, by name."""

from robosim.parts import ROBOT

ROBOTS = {name: ROBOT.make(name) for name in ("turtlebot", "locobot")}
