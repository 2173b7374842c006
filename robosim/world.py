"""The world: a building, what moves in it, transmitters, and robots.

Robots are known by name; most worlds have one, `ROBOT`. The robots of a world share walls, scene and radio tables, and
each has its own motion, sensors, radio and noise. They act in turn: each meets the others where they are after their
last actions, as bodies that stop it, that its camera and lidar see, and that weaken its radio paths. Among
people, a step takes as long as the longest of their actions, and people walk once in it (`robosim.movers.crowd`). What
robots sense is for their agents (`robosim.agent`); the truth is for judges, logs and drawings only.
"""

from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from itertools import combinations

import numpy as np

from robosim.building.building import Building
from robosim.movers.crowd import Crowd, CrowdAsMet
from robosim.movers.movers import movers_of
from robosim.robot.robots import RobotConfig
from robosim.simulator import Observation, Simulator, SimulatorConfig
from robosim.step import Truth
from robosim.support.randomness import named_generator
from robosim.support.stopwatch import Stopwatch
from robosim.task.tasks import Task
from slam.actions import Command
from slam.poses import to_map

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
            ValueError: If there is no robot, or several have different movers.
        """
        if not robots:
            raise ValueError("robots is empty, expected the configuration of at least one robot by its name.")
        if any(config.movers != next(iter(robots.values())).movers for config in robots.values()):
            raise ValueError("movers differ between the robots of a world, expected the same ones for all.")
        self.building = building
        self.robots: dict[str, Simulator] = {}
        self._gather(robots)
        for name, config in robots.items():
            others = self._others(name, robots)
            equal = (robot for robot in self.robots.values() if robot.config == config)
            if (twin := next(equal, None)) is not None:
                self.robots[name] = twin.clone(others, self._met_by.get(name))
            else:
                self.robots[name] = Simulator(
                    building,
                    config,
                    watch,
                    uses_radio=uses_radio,
                    uses_camera=uses_camera,
                    others=others,
                    crowd=self._met_by.get(name),
                )

    def _gather(self, robots: Mapping[str, SimulatorConfig]) -> None:
        """Make the movers that several robots meet; a single robot has its own."""
        self._crowd: Crowd | None = None
        self._met_by: dict[str, CrowdAsMet] = {}
        movers = next(iter(robots.values())).movers
        if len(robots) > 1 and movers.any:
            radii_m = [config.robot.hull.turning_m for config in robots.values()]
            self._crowd = Crowd(movers_of(movers), radii_m)
            self._met_by = {name: CrowdAsMet(self._crowd, number) for number, name in enumerate(robots)}

    @staticmethod
    def _others(name: str, robots: Mapping[str, SimulatorConfig]) -> list[RobotConfig]:
        return [config.robot for other, config in robots.items() if other != name]

    def clone(self) -> "World":
        """Return a world of other robots in the same building; both share what is built for the building."""
        other, configs = copy(self), {name: robot.config for name, robot in self.robots.items()}
        other._gather(configs)
        other.robots = {
            name: robot.clone(self._others(name, configs), other._met_by.get(name))
            for name, robot in self.robots.items()
        }
        return other

    def reset(self, tasks: Mapping[str, Task], rng: np.random.Generator) -> dict[str, Observation]:
        """Put each robot at the start of its task, and the target in its place; all noise depends on the generator.

        Raises:
            ValueError: If two robots stand in each other, or one where its hull does not fit.
        """
        alone = len(self.robots) == 1
        for (name, robot), (other, mate) in combinations(self.robots.items(), 2):
            apart_m = float(np.hypot(*(tasks[name].start - tasks[other].start)[:2]))
            if apart_m < (least_m := robot.config.robot.hull.inner_m + mate.config.robot.hull.inner_m):
                raise ValueError(
                    f"{other} starts {apart_m:.2f} m from {name}, expected {least_m:.2f} m or more, or their hulls "
                    "meet. robosim.make_entrants chooses starts with room."
                )
        for name, robot in self.robots.items():
            others = [tasks[other].start for other in self.robots if other != name]
            robot.teammates.place(np.reshape(others, (-1, 3)))
        if alone:
            return {name: robot.reset(tasks[name], rng) for name, robot in self.robots.items()}
        if self._crowd is not None:
            starts = np.array([tasks[name].start for name in self.robots])
            self._crowd.reset(self.building, starts, named_generator(rng, "movers"))
        # What people look like is drawn once for all robots.
        return {
            name: robot.reset(tasks[name], named_generator(rng, name), named_generator(rng, "clothes"))
            for name, robot in self.robots.items()
        }

    def step(self, commands: Mapping[str, Command]) -> dict[str, Observation]:
        """Carry out a command of each of these robots, one after the other; the others stand still."""
        if self._crowd is not None:
            time_s = max(robot.movers.time_s for robot in self.robots.values() if robot.movers is not None)
            for name in commands:
                self.robots[name].wait_until(time_s)
            ahead_m = {name: commands[name].ahead_m if name in commands else 0.0 for name in self.robots}
            poses = {name: robot.pose for name, robot in self.robots.items()}
            goals = [to_map(pose, np.array([ahead_m[name], 0.0])) for name, pose in poses.items()]
            self._crowd.begin_step(time_s, np.array([*poses.values()]), np.array(goals))
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
