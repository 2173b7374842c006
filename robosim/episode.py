"""One episode: a robot searches for a target in a building that it does not know.

This is the whole system on one page. Read `run_episode`: a world with a robot in it, an agent that drives the robot, a
judge who knows the truth, and the loop of sensing and acting. `robosim.agent` is what the robot makes of what it
senses.
The agent never sees the truth. Of the policies only the oracle is given the target, and `shortest`, the physical limit,
the building too.
"""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field, replace
from signal import SIGINT, SIGTERM
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Float

from robosim.agent import Agent
from robosim.building.building import Building, BuildingConfig
from robosim.building.reach import Reach
from robosim.episode_log import EpisodeLog
from robosim.judge import Judge
from robosim.navigation import Navigator, control_of, make_navigator
from robosim.parts import ClassifierPart, ControllerPart, ExplorerPart, GoalPart, MapperPart
from robosim.policies.belief import BeliefConfig
from robosim.policies.fused import FusedConfig
from robosim.policies.goals import GoalPolicy, PolicyContext, make_policy
from robosim.policies.shortest import TrueMapper
from robosim.radio.measurement import check_classifier
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.step import Step
from robosim.support.checks import SEED, STEPS, checked
from robosim.support.interrupt import noted_interrupt
from robosim.support.stopwatch import Stopwatch
from robosim.task.tasks import Task
from robosim.world import ROBOT, World
from slam.actions import Command
from slam.grid import MapEstimate
from slam.planning.cost_map import CostConfig


@dataclass(frozen=True, kw_only=True)
@checked
class EpisodeConfig:
    """How an episode is run."""

    goal: Annotated[GoalPart, tyro.conf.Suppress] = "learned"
    """Goal policy."""
    explorer: ExplorerPart = "learned"
    """Explorer: chooses among frontiers when the goal is to explore."""
    controller: ControllerPart = "planned"
    """Controller: planned, a search over turns and runs, or a network that has learned from it; velocity commands
    speeds and turn rates."""
    mapper: MapperPart = "neural"
    """Mapper: classical, neural, learned-pose, or a .safetensors file of a trained network."""
    seed: Annotated[int, SEED, tyro.conf.Suppress] = 0
    """Seed of everything random in the episode."""
    max_steps: Annotated[int, STEPS] = 1000
    """Actions before the episode is given up."""
    building: BuildingConfig = field(default_factory=BuildingConfig)
    """How the plan becomes a building."""
    simulator: Annotated[SimulatorConfig, tyro.conf.arg(name="")] = field(default_factory=SimulatorConfig)
    """What is simulated."""
    link_states: ClassifierPart = "generated"
    """Link-state classifier: a shipped one by name, a .safetensors file, or "true" for the true states."""
    fused: FusedConfig = field(default_factory=FusedConfig)
    """How the goal policy `fused` weighs what it knows."""

    def __post_init__(self) -> None:
        if self.simulator.camera == "none":
            if self.goal == "visual":
                raise ValueError(
                    f"goal is {self.goal!r}, which looks through the camera, but camera is 'none'. Give it one."
                )
            if self.mapper != "classical" and isinstance(self.mapper, str) and ":" not in self.mapper:
                raise ValueError(
                    f"mapper is {self.mapper!r}, which learned from pictures, but camera is 'none'. Give "
                    "--mapper classical."
                )

    def of_robot(self, robot: RobotConfig) -> "EpisodeConfig":
        """The same with another robot, and the sensors that it comes with; without a camera the classical mapper."""
        simulator = self.simulator.of_robot(robot)
        return replace(
            self, simulator=simulator, mapper="classical" if simulator.camera == "none" else self.mapper
        )

    def in_band(self, name: str) -> "EpisodeConfig":
        """The same in a radio band of `wireless.bands`, with the classifier of link states for it."""
        radio = self.simulator.radio.in_band(name)
        simulator = replace(self.simulator, radio=radio)
        return replace(self, simulator=simulator, link_states="generated" if name == "28ghz" else name)


#: Called at each step after the command is chosen and before it is done. If it returns a command, that one is done
#: instead: this is how a person drives.
Observer = Callable[[EpisodeLog, Step], Command | None]


def make_agent_parts(
    config: EpisodeConfig, target: Float[np.ndarray, "2"] | None = None
) -> tuple[Navigator, GoalPolicy]:
    """Make mapper, planner, controller, and the goal policy; `target` is for oracles only [m].

    Raises:
        ValueError: If there is no such part, or its weights cannot be read.
    """
    navigator = make_navigator(config.simulator, config.explorer, config.mapper, config.controller)
    control, fused, cost = control_of(config.simulator), config.fused, config.fused.cost
    # A radius or carrier that differs from the default is deliberate; else those of robot and radio are used.
    if cost.radius_m == CostConfig.radius_m:
        cost = cost.for_hull(control.hull)
    belief = fused.belief
    if belief.frequency_hz == BeliefConfig.frequency_hz:
        belief = replace(belief, frequency_hz=config.simulator.radio.frequency_hz)
    # Without a camera none of the floor counts as seen to be empty.
    looks = config.simulator.camera != "none"
    fused = replace(fused, belief=belief, cost=cost, uses_camera=fused.uses_camera and looks)
    context = PolicyContext(
        explorer=navigator.explorer,
        fused=fused,
        control=control,
        hfov_deg=config.simulator.image.hfov_deg,
        target=target,
    )
    return navigator, make_policy(config.goal, context)


def check_weights(config: EpisodeConfig) -> None:
    """Read the weights that an episode needs, so that a bad file is found before the work begins.

    Without a radio no link state is classified, and the classifier's weights are not read.
    """
    _, policy = make_agent_parts(config, np.zeros(2))
    if policy.uses_radio:
        check_classifier(config.link_states, config.simulator.radio)


def run_episode(
    building: Building,
    reach: Reach,
    task: Task,
    config: EpisodeConfig,
    on_step: Observer = lambda log, step: None,
    watch: Stopwatch | None = None,
) -> tuple[EpisodeLog, MapEstimate]:
    """Drive one robot until it arrives, has explored everything, or is out of steps; return log and last map.

    Ctrl-C or SIGTERM ends the episode after the current step; what was done until then is returned.

    Args:
        building: Where.
        reach: What the robot's hull can reach there; coverage is counted over it.
        task: From where to where.
        config: How.
        on_step: Called at each step, after the command is chosen, to draw or report; or to drive by hand.
        watch: Collects the time by stage.
    """
    watch = watch or Stopwatch()
    navigator, policy = make_agent_parts(config, task.target)
    world = World(
        building,
        {ROBOT: config.simulator},
        watch,
        uses_radio=policy.uses_radio,
        uses_camera=policy.uses_camera,
    )
    robot = world.robots[ROBOT]
    if policy.uses_true_map:
        height_m = config.simulator.robot.height_m
        navigator = navigator._replace(mapper=TrueMapper(building, lambda: robot.pose, height_m))
    agent = Agent(
        navigator,
        policy,
        turning_m=config.simulator.robot.hull.turning_m,
        radio=config.simulator.radio,
        interpret=robot.interpreter(config.link_states),
        anchor_places={anchor.name: anchor.place for anchor in task.anchors if anchor.known},
        watch=watch,
    )
    judge = Judge(robot, building, reach, task, config.max_steps, policy.seeks_target)
    log = judge.log
    log.seconds = watch.seconds
    with closing(world), noted_interrupt("this step", (SIGINT, SIGTERM)) as interrupt:
        sensed = world.reset({ROBOT: task}, np.random.default_rng([config.seed, 1]))[ROBOT]
        agent.reset(task.start)
        while True:
            estimate, truth = agent.observe(sensed), world.truth(ROBOT)
            with watch.stage("judging"):
                truth = judge.observe(truth, estimate.pose)
            if interrupt.is_requested:
                log.ended = interrupt.word
            if log.ended != "running":
                break
            decision = agent.decide()
            if decision is None:
                log.ended = "explored"
                break
            log.add_links(agent.measurements, robot.links)
            step = Step(number=log.steps, sensed=sensed, decided=decision, true=truth)
            replacement = on_step(log, step)
            command = decision.command if replacement is None else replacement
            sensed = world.step({ROBOT: command})[ROBOT]
    log.contacts = None if robot.movers is None else robot.movers.contacts
    log.transmitters = agent.mapper.transmitters()
    return log, estimate
