"""
Several robots
==============

Teams of one, two and four robots explore the same office. Robots report their maps to each other by radio and leave to
the others what these reach sooner, so that a team has seen more of the floor after the same time.
"""

import matplotlib.pyplot as plt
import numpy as np

from robosim import (
    EpisodeConfig,
    TeamConfig,
    make_building,
    make_entrants,
    make_task,
    reach,
    read_plan,
    run_team,
)
from robosim.simulator import SimulatorConfig
from robosim.support.colours import css, robot_colour

building = make_building(read_plan("office"))
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 5), layout="constrained")
for robots in ("1", "2", "4"):
    simulator = SimulatorConfig(physics="kinematic", camera="plan")
    team = TeamConfig(robots=robots)
    config = EpisodeConfig(goal="explore", mapper="classical", max_steps=150, simulator=simulator, team=team)
    places = reach(building, *simulator.robot.hull_m)
    task = make_task(places, np.random.default_rng(1))
    log = run_team(building, make_entrants(building, places, task, config))
    right.plot(100 * np.array(log.coverage or log.first.coverage), label=f"robots: {robots}")
building.plot(left)
for k, (name, robot) in enumerate(log.robots.items()):
    left.plot(*np.array(robot.poses)[:, :2].T, color=css(robot_colour(k)), label=name)
left.legend(loc="lower right")
right.set(xlabel="decisions", ylabel="floor seen [%]")
right.legend()
plt.show()
