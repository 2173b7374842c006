"""Episode: a robot searches for a target in a building that it does not know.

This is the whole system on one page: a world with a robot in it, an agent that drives the robot, a judge who knows the
truth, and the loop of sensing and acting. `robosim.agent` is what the robot makes of what it senses; it never sees the
truth. Of the policies only the oracle is given the target, and `shortest`, the physical limit, the building too.
"""

from collections.abc import Callable
from contextlib import closing
from signal import SIGINT, SIGTERM

import numpy as np

from robosim.agent import make_agent
from robosim.building.building import Building
from robosim.building.reach import Reach
from robosim.episode_config import EpisodeConfig
from robosim.episode_log import EpisodeLog
from robosim.judge import Judge
from robosim.policies.shortest import TrueMapper
from robosim.step import Step
from robosim.support.interrupt import noted_interrupt
from robosim.support.stopwatch import Stopwatch
from robosim.task.tasks import Task
from robosim.world import ROBOT, World
from slam.actions import Command
from slam.grid import MapEstimate

#: Called at each step after the command is chosen and before it is done. If it returns a command, that one is done
#: instead: this is how a person drives.
Observer = Callable[[EpisodeLog, Step], Command | None]


def run_episode(
    building: Building,
    reach: Reach,
    task: Task,
    config: EpisodeConfig,
    on_step: Observer = lambda log, step: None,
    watch: Stopwatch | None = None,
) -> tuple[EpisodeLog, MapEstimate]:
    """Drive one robot until it arrives, has explored everything, or is out of steps; return log and last map.

    Ctrl-C or SIGTERM ends the episode after the current step; the log until then is returned.

    Args:
        building: Where.
        reach: What the robot's hull can reach there; coverage is counted over it.
        task: From where to where.
        config: How.
        on_step: Called at each step, after the command is chosen, to draw or report; or to drive by hand.
        watch: Collects the time by stage.
    """
    watch = watch or Stopwatch()
    agent = make_agent(config, task, watch)
    uses = {"uses_radio": agent.policy.uses_radio, "uses_camera": agent.policy.uses_camera}
    world = World(building, {ROBOT: config.simulator}, watch, **uses)
    robot = world.robots[ROBOT]
    agent.interpret = robot.interpreter(config.link_states)
    if agent.policy.uses_true_map:
        agent.mapper = TrueMapper(building, lambda: robot.pose, config.simulator.robot.height_m)
    log = EpisodeLog(task, seconds=watch.seconds, seeks_target=agent.policy.seeks_target)
    judge = Judge(log, robot, reach, config.max_steps)
    with closing(world), noted_interrupt("this step", (SIGINT, SIGTERM)) as interrupt:
        sensed = world.reset({ROBOT: task}, np.random.default_rng([config.seed, 1]))[ROBOT]
        agent.reset(task.start)
        while True:
            estimate = agent.observe(sensed)
            with watch.stage("judging"):
                truth = judge.observe(world.truth(ROBOT), estimate.pose)
            if interrupt.is_requested:
                log.ended = interrupt.word
            if log.ended != "running":
                break
            decision = agent.decide()
            if decision is None:
                log.ended = "explored"
                break
            log.add_links(agent.measurements, robot.links)
            replacement = on_step(log, Step(number=log.steps, sensed=sensed, decided=decision, true=truth))
            command = decision.command if replacement is None else replacement
            sensed = world.step({ROBOT: command})[ROBOT]
    log.contacts = None if robot.movers is None else robot.movers.contacts
    log.transmitters = agent.mapper.transmitters()
    return log, estimate
