"""The robots that come with the package, by name."""

from robosim.parts import ROBOT

ROBOTS = {name: ROBOT.make(name) for name in ROBOT.names}
