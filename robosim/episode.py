"""One episode: a robot searches for a target in a building that it does not know.

This is the whole system on one page. Read `drive`: each turn of its loop is one step, each line of the loop one part of
the system. `run_episode` judges a search and keeps its log; data collection and training call `drive` with other
functions. The mapper never sees the true pose. Of the policies only the oracle is given the target, and `shortest`, the
physical limit, the building too.
"""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field, replace
from signal import SIGINT, SIGTERM
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Float

from robosim.building.building import Building, BuildingConfig
from robosim.building.reach import Reach
from robosim.episode_log import EpisodeLog
from robosim.navigation import Navigator, control_of, make_navigator
from robosim.parts import ClassifierPart, ControllerPart, ExplorerPart, GoalPart, MapperPart
from robosim.policies.belief import BeliefConfig
from robosim.policies.estimates import Estimates
from robosim.policies.fused import FusedConfig
from robosim.policies.goals import Driver, GoalPolicy, PolicyContext, make_policy
from robosim.policies.reason import LOOP_DETECTED, UNKNOWN_REASON, GoalKind
from robosim.policies.shortest import Shortest, TrueMapper
from robosim.radio.measurement import Interpreter, bearings_of, check_classifier
from robosim.robot.robots import RobotConfig
from robosim.simulator import Observation, Simulator, SimulatorConfig
from robosim.step import Decision, Step, Truth
from robosim.support.checks import SEED, STEPS, checked
from robosim.support.interrupt import noted_interrupt
from robosim.support.stopwatch import Stopwatch
from robosim.task.coverage import Coverage
from robosim.task.tasks import Task
from slam.actions import Action
from slam.control.avoidance import Avoidance, AvoidanceConfig
from slam.control.controller import Controller
from slam.grid import MapEstimate
from slam.mapping.classical import RadioMapper
from slam.planning.cost_map import CostConfig
from slam.planning.loop_detector import LoopDetector, Remedy


@dataclass(frozen=True, kw_only=True)
@checked
class EpisodeConfig:
    """How an episode is run."""

    goal: Annotated[GoalPart, tyro.conf.Suppress] = "learned"
    """Goal policy."""
    explorer: ExplorerPart = "learned"
    """Explorer: chooses among frontiers when the goal is to explore."""
    controller: ControllerPart = "planned"
    """Controller: planned, a search over turns and runs, or a network that has learned from it."""
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


#: Decides whether the robot goes on, from what it sensed, what it made of it, and the truth.
Judge = Callable[[Observation, Estimates, Truth], bool]
#: Called at each step after the action is chosen and before it is done. If it returns an action, that one is done
#: instead: this is how a person drives.
Observer = Callable[[EpisodeLog, Step], Action | None]


def check_weights(config: EpisodeConfig) -> None:
    """Read the weights that an episode needs, so that a bad file is found before the work begins.

    Without a radio no link state is classified, and the classifier's weights are not read.
    """
    navigator = make_navigator(config.simulator, config.explorer, config.mapper, config.controller)
    if _policy(config, navigator, np.zeros(2)).uses_radio:
        check_classifier(config.link_states, config.simulator.radio)


def _policy(config: EpisodeConfig, navigator: Navigator, target: Float[np.ndarray, "2"]) -> GoalPolicy:
    """The goal policy; without a camera none of the floor counts as seen to be empty."""
    looks = config.simulator.camera != "none"
    control, fused, cost = control_of(config.simulator), config.fused, config.fused.cost
    # A radius or carrier that differs from the default is deliberate; else those of robot and radio are used.
    if cost.radius_m == CostConfig.radius_m:
        cost = cost.for_hull(control.hull)
    belief = fused.belief
    if belief.frequency_hz == BeliefConfig.frequency_hz:
        belief = replace(belief, frequency_hz=config.simulator.radio.frequency_hz)
    fused = replace(fused, belief=belief, cost=cost, uses_camera=fused.uses_camera and looks)
    context = PolicyContext(
        explorer=navigator.explorer,
        fused=fused,
        control=control,
        hfov_deg=config.simulator.image.hfov_deg,
        target=target,
    )
    return make_policy(config.goal, context)


def drive(
    simulator: Simulator,
    navigator: Navigator,
    policy: GoalPolicy,
    task: Task,
    rng: np.random.Generator,
    judge: Judge,
    on_step: Callable[[Step], Action | None] = lambda step: None,
    *,
    interpret: Callable[[Observation, MapEstimate], Estimates] = lambda sensed, map_: Estimates(map_),
    watch: Stopwatch | None = None,
) -> tuple[MapEstimate, bool]:
    """Let a robot drive, one step after another.

    Args:
        simulator: The robot in its building.
        navigator: Mapper, planner and controller.
        policy: Chooses the goals.
        task: Where the robot starts, and where the target stands.
        rng: Source of all noise.
        judge: Whether the robot goes on; called at each step before anything is decided.
        on_step: Called at each step before its action is done. If it returns an action, that one is done instead.
        interpret: Adds to the map what the robot makes of its radio measurements.
        watch: Collects the time by stage.

    Returns:
        The map in the end, and whether the policy ended the drive by having no goal, rather than the judge.
    """
    watch = watch or Stopwatch()
    mapper, planner, controller, _ = navigator
    loop_detector = LoopDetector()
    avoidance = Avoidance(AvoidanceConfig(radius_m=simulator.config.robot.hull.turning_m))
    sensed, motion, action, number = simulator.reset(task, rng), None, None, 0
    mapper.reset(task.start)
    while True:
        with watch.stage("mapper"):
            map_ = mapper.update(sensed.depth, action, sensed.odometry, **sensed.mapper_inputs)
        true = Truth(pose=simulator.pose, action=action, motion=motion)
        with watch.stage("judging"):
            if not judge(sensed, Estimates(map_), true):
                return map_, False
        with watch.stage("link state"):
            estimated = interpret(sensed, map_)
        with watch.stage("goal"):
            around = avoidance.around(map_)
            wanted = policy.goal(sensed, estimated if around is map_ else replace(estimated, map=around))
        if wanted is None:
            return map_, True
        with watch.stage("planner"):
            goal = loop_detector.goal(wanted, map_.pose)
            # A policy of a user need not give reasons.
            given = getattr(policy, "reason", None) if goal is wanted else LOOP_DETECTED
            reason = given or UNKNOWN_REASON
            # A robot sees the floor of a niche from outside; but a target may stand in it.
            look = reason.kind is GoalKind.EXPLORE and not policy.seeks_target
            plan = planner.plan(around, goal, look=look)
            if loop_detector.watch(map_.pose, goal, plan) is Remedy.PLAN_CLOSELY:
                planner.look_closely()
            chosen = policy.action() if isinstance(policy, Driver) else None
            chosen = controller.act(map_.pose, plan) if chosen is None else chosen
            action = avoidance.checked(map_, chosen)
        decided = Decision(goal=goal, reason=reason, path=plan.path, action=action, belief=policy.belief)
        step = Step(number=number, sensed=sensed, estimated=estimated, decided=decided, true=true)
        replacement = on_step(step)
        action = action if replacement is None else replacement
        if action is not chosen and isinstance(controller, Controller):
            controller.withdraw()
        sensed, motion = simulator.step(action)
        number += 1


def run_episode(
    building: Building,
    reach: Reach,
    task: Task,
    config: EpisodeConfig,
    on_step: Observer = lambda log, step: None,
    watch: Stopwatch | None = None,
) -> tuple[EpisodeLog, MapEstimate]:
    """Drive one robot until it arrives, has explored everything, or is out of steps; returns log and last map.

    Ctrl-C or SIGTERM ends the episode after the current step; what was done until then is returned.

    Args:
        building: Where.
        reach: What the robot's hull can reach there; coverage is counted over it.
        task: From where to where.
        config: How.
        on_step: Called at each step, after the action is chosen, to draw or report; or to drive by hand.
        watch: Collects the time by stage.
    """
    watch = watch or Stopwatch()
    log = EpisodeLog(task, seconds=watch.seconds)
    navigator = make_navigator(config.simulator, config.explorer, config.mapper, config.controller)
    policy = _policy(config, navigator, task.target)
    log.seeks_target = policy.seeks_target
    simulator = Simulator(
        building, config.simulator, watch, uses_radio=policy.uses_radio, uses_camera=policy.uses_camera
    )
    if isinstance(policy, Shortest):
        robot = config.simulator.robot
        navigator = navigator._replace(mapper=TrueMapper(building, lambda: simulator.pose, robot.height_m))
    radio = simulator.radio
    interpreter = Interpreter(radio, config.link_states) if radio else None
    floor = reach.swept(reach.part_near(task.start[:2], reach.radius_m))
    image = config.simulator.image
    coverage = Coverage(building.plan, floor, np.radians(image.hfov_deg), image.ahead_m)
    rng = np.random.default_rng([config.seed, 1])
    known_places = {anchor.name: anchor.place for anchor in task.anchors if anchor.known}

    def judge(sensed: Observation, estimated: Estimates, true: Truth) -> bool:
        coverage.update(true.pose, simulator.true_depth, simulator.true_laser)
        log.add_pose(true.motion, true.pose, estimated.pose, coverage.fraction)
        if interrupt.is_requested:
            log.ended = interrupt.word
        elif policy.seeks_target and log.arrived:  # by the true pose, one rule for every policy
            log.ended = "arrived"
        elif log.steps >= config.max_steps:
            log.ended = "out of steps"
        return log.ended == "running"

    def interpret(sensed: Observation, map_: MapEstimate) -> Estimates:
        if radio is None or interpreter is None:
            return Estimates(map_)
        measurement = interpreter.interpret(sensed.paths, map_.pose)
        log.add_link(measurement, radio)
        # A policy of a user need not say so.
        if not getattr(policy, "uses_directions", True):
            measurement = measurement.power_only()
        anchors = {}
        for name, link in simulator.anchors.items():
            anchors[name] = interpreter.interpret(sensed.anchors[name], map_.pose, link)
            log.add_link(anchors[name], link, name)
        estimated = Estimates(map_, measurement, anchors, known_places)
        if isinstance(navigator.mapper, RadioMapper):
            measured = {"target": measurement, **anchors}
            navigator.mapper.listen(bearings_of(measured, radio.config, known_places))
            estimated = replace(estimated, locate_transmitters=navigator.mapper.transmitters)
        return estimated

    def observe(step: Step) -> Action | None:
        true = replace(step.true, coverage=coverage.fraction)
        if radio is not None:
            true = replace(true, link_state=radio.state, aoa_rad=radio.bearing, paths=radio.paths)
        if simulator.movers is not None:
            true = replace(true, bodies=simulator.movers.present)
        return on_step(log, replace(step, true=true))

    with closing(simulator), noted_interrupt("this step", (SIGINT, SIGTERM)) as interrupt:
        map_, explored = drive(
            simulator, navigator, policy, task, rng, judge, observe, interpret=interpret, watch=watch
        )
    if explored:
        log.ended = "explored"
    log.contacts = None if simulator.movers is None else simulator.movers.contacts
    if isinstance(navigator.mapper, RadioMapper):
        log.transmitters = navigator.mapper.transmitters()
    return log, map_
