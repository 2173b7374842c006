"""The world: a building, what moves in it, transmitters, and robots.

Robots are known by name; most worlds have one, `ROBOT`. The robots of a world share walls, scene and radio tables, and
each has its own motion, sensors, radio and noise. They act in turn: each meets the others where they are after their
last actions, as bodies that stop it, that its camera and lidar see, and that weaken its radio paths. What they sense is
for their agents (`robosim.agent`); the truth is for judges, logs and drawings only.
"""

from collections.abc import Mapping
from copy import copy
from dataclasses import replace

import numpy as np

from robosim.building.building import Building
from robosim.robot.robots import RobotConfig
from robosim.simulator import Observation, Simulator, SimulatorConfig
from robosim.step import Truth
from robosim.support.randomness import named_generator
from robosim.support.stopwatch import Stopwatch
from robosim.task.tasks import Task
from slam.actions import Command

#: Name of the robot in worlds of one.
ROBOT = "robot"


class World:
    """A building with robots."""

    def __init__(
        self,
        building: Building,
        robots: Mapping[str, SimulatorConfig],
        watch: Stopwatch | None = None,
        *,
        uses_radio: bool = False,
        uses_camera: bool = False,
    ) -> None:
        """Build the scene.

        Args:
            building: Where.
            robots: Body, sensors and surroundings of each robot, by name.
            watch: Collects the time by stage.
            uses_radio: Whether robots measure the radio.
            uses_camera: Whether they look for the target in pictures.

        Raises:
            ValueError: If there is no robot, or people are to walk among several.
        """
        if not robots:
            raise ValueError("robots is empty, expected the configuration of at least one robot by its name.")
        if len(robots) > 1 and any(config.movers.any for config in robots.values()):
            raise ValueError(
                f"{len(robots)} robots among people or other movers are not supported. Leave out the movers."
            )
        self.building = building
        self.robots: dict[str, Simulator] = {}
        for name, config in robots.items():
            others = self._others(name, robots)
            equal = (robot for robot in self.robots.values() if robot.config == config)
            if (twin := next(equal, None)) is not None:
                self.robots[name] = twin.clone(others)
            else:
                self.robots[name] = Simulator(
                    building, config, watch, uses_radio=uses_radio, uses_camera=uses_camera, others=others
                )

    @staticmethod
    def _others(name: str, robots: Mapping[str, SimulatorConfig]) -> list[RobotConfig]:
        return [config.robot for other, config in robots.items() if other != name]

    def clone(self) -> "World":
        """Return a world of other robots in the same building; both share what is built for the building."""
        other, configs = copy(self), {name: robot.config for name, robot in self.robots.items()}
        other.robots = {name: robot.clone(self._others(name, configs)) for name, robot in self.robots.items()}
        return other

    def reset(self, tasks: Mapping[str, Task], rng: np.random.Generator) -> dict[str, Observation]:
        """Put each robot at the start of its task, and the target in its place; all noise depends on the generator."""
        alone = len(self.robots) == 1
        for name, robot in self.robots.items():
            others = [tasks[other].start for other in self.robots if other != name]
            robot.teammates.place(np.reshape(others, (-1, 3)))
        return {
            name: robot.reset(tasks[name], rng if alone else named_generator(rng, name))
            for name, robot in self.robots.items()
        }

    def step(self, commands: Mapping[str, Command]) -> dict[str, Observation]:
        """Carry out a command of each of these robots, one after the other; the others stand still."""
        return {name: self._meet_others(name).step(command)[0] for name, command in commands.items()}

    def _meet_others(self, name: str) -> Simulator:
        """Return a robot, after it was shown where the others are now."""
        robot = self.robots[name]
        if len(self.robots) > 1 and robot.movers is not None:
            robot.teammates.place(np.array([r.pose for other, r in self.robots.items() if other != name]))
            robot.movers.look_again()
        return robot

    def truth(self, name: str) -> Truth:
        """Return the ground truth of a robot after its last command."""
        robot, radio, movers = self.robots[name], self.robots[name].radio, self.robots[name].movers
        truth = Truth(pose=robot.pose, motion=robot.motion)
        if radio is not None:
            truth = replace(truth, link_state=radio.state, aoa_rad=radio.bearing, paths=radio.paths)
        return truth if movers is None else replace(truth, bodies=movers.present)

    def close(self) -> None:
        """Free the cameras."""
        for robot in self.robots.values():
            robot.close()
