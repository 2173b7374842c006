"""One episode: a robot searches a target in a building it does not know.

This is the whole system on one page. Read `drive`: each turn of its loop is one decision, each line of the loop one
part of the system. `run_episode` looks on and judges; whoever collects frames or teaches looks on in other ways. The
mapper never sees the true pose, and only the oracle sees the target; `shortest`, the physical limit, is told all.
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
from robosim.navigation import Navigator, control_of, make_navigator
from robosim.parts import (
    ClassifierPart,
    ControllerPart,
    ExplorerPart,
    GoalPart,
    MapperPart,
)
from robosim.policies.belief import TargetBelief
from robosim.policies.fused import FusedConfig
from robosim.policies.goals import Driver, GoalPolicy, PolicyContext, make_policy
from robosim.policies.reason import KEPT, UNTOLD, GoalKind, Reason
from robosim.policies.shortest import Shortest, TrueMapper
from robosim.policies.situation import Situation
from robosim.radio.bearings import bearings_of
from robosim.radio.measurement import Interpreter, check_classifier
from robosim.robot.motion import Motion
from robosim.simulator import Observation, Simulator, SimulatorConfig
from robosim.support.checks import SEED, STEPS, checked
from robosim.support.interrupt import noted_interrupt
from robosim.support.stopwatch import Stopwatch
from robosim.task.coverage import Coverage
from robosim.task.record import EpisodeLog
from robosim.task.tasks import Task
from slam.actions import Action
from slam.grid import MapEstimate
from slam.mapping.classical import Listener
from slam.planning.cost_map import CostConfig
from slam.planning.planner import Plan
from slam.planning.rounds import Remedy, Rounds
from wireless.paths import Paths


@dataclass(frozen=True, kw_only=True)
@checked
class EpisodeConfig:
    """How an episode is run."""

    goal: Annotated[GoalPart, tyro.conf.Suppress] = "fused"
    """Who chooses the goals."""
    explorer: ExplorerPart = "learned"
    """Who chooses among frontiers when the goal is to explore."""
    controller: ControllerPart = "planned"
    """Who chooses actions: a search over turns and runs, or a network that has watched it."""
    mapper: MapperPart = "neural"
    """Who makes the map: classical, neural, a .safetensors file of a trained network, or learned-pose."""
    seed: Annotated[int, SEED, tyro.conf.Suppress] = 0
    """Seed of everything random in the episode."""
    max_steps: Annotated[int, STEPS] = 1000
    """Actions before the episode is given up."""
    building: BuildingConfig = field(default_factory=BuildingConfig)
    """How the plan becomes a building."""
    simulator: Annotated[SimulatorConfig, tyro.conf.arg(name="")] = field(default_factory=SimulatorConfig)
    """What is simulated."""
    link_states: ClassifierPart = "generated"
    """Who tells link states: a shipped classifier by name, a .safetensors file, or "true" for the truth."""
    fused: FusedConfig = field(default_factory=FusedConfig)
    """How the goal policy `fused` weighs what it knows."""

    def __post_init__(self) -> None:
        if self.simulator.camera == "none":
            if self.goal in ("visual", "learned"):
                raise ValueError(
                    f"goal is {self.goal!r}, which looks through the camera, but camera is 'none'. Give it one."
                )
            if self.mapper != "classical" and isinstance(self.mapper, str) and ":" not in self.mapper:
                raise ValueError(
                    f"mapper is {self.mapper!r}, which learned from pictures, but camera is 'none'. Give "
                    "--mapper classical."
                )


@dataclass(frozen=True, kw_only=True, eq=False)
class Turn:
    """What was sensed in one turn of the loop, and what was made of it; with the truth beside it, for onlookers."""

    pose: Float[np.ndarray, "3"]
    """True pose: x [m], y [m], yaw [rad] in `map`."""
    before: Action | None
    """The action that led here; None at the first."""
    motion: Motion | None
    """What it truly did; None at the first."""
    view: Observation
    """What the robot sensed."""
    estimate: MapEstimate
    """Map and pose as the robot has them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Decision(Turn):
    """A turn with what was decided in it."""

    situation: Situation
    """What the robot makes of what it sensed."""
    paths: Paths | None
    """True radio paths; None without a radio."""
    belief: TargetBelief | None
    """Where its policy takes the target to be; None if it keeps no such belief."""
    goal: Float[np.ndarray, "2"]
    """Where to go, in `map` [m]."""
    reason: Reason
    """Why to go there."""
    plan: Plan
    """How to get there."""
    action: Action
    """What is done next."""


#: Is told of each decision, after the action is chosen and before it is done. It may give another action, which is done
#: instead: so a person drives.
Onlooker = Callable[[EpisodeLog, Decision], Action | None]


def check_weights(config: EpisodeConfig) -> None:
    """Read the weights that an episode asks for, so that a bad file is found before the work begins.

    Without a radio nobody tells link states, and their weights are not read.

    Raises:
        ValueError: If a file is missing, damaged or of something else, or tells link states by what is not measured.
    """
    navigator = make_navigator(config.simulator, config.explorer, config.mapper, config.controller)
    if _policy(config, navigator, np.zeros(2)).uses_radio:
        check_classifier(config.link_states)


def _policy(config: EpisodeConfig, navigator: Navigator, target: Float[np.ndarray, "2"]) -> GoalPolicy:
    """Who chooses the goals; without a camera nothing was seen to be empty."""
    looks = config.simulator.camera != "none"
    control, fused, cost = control_of(config.simulator), config.fused, config.fused.cost
    # One that was set on purpose counts; else it is the robot's own.
    if cost.radius_m == CostConfig.radius_m:
        cost = replace(cost, radius_m=control.radius_m)
    fused = replace(fused, cost=cost, uses_camera=fused.uses_camera and looks)
    context = PolicyContext(explorer=navigator.explorer, fused=fused, control=control, target=target)
    return make_policy(config.goal, context)


def without_radio(view: Observation, estimate: MapEstimate) -> Situation:
    """What a robot without a radio makes of what it sensed."""
    return Situation(estimate, target=view.target, view=view)


def drive(
    simulator: Simulator,
    navigator: Navigator,
    policy: GoalPolicy,
    task: Task,
    rng: np.random.Generator,
    judge: Callable[[Turn], bool],
    on_decision: Callable[[Decision], Action | None] = lambda decision: None,
    *,
    interpret: Callable[[Observation, MapEstimate], Situation] = without_radio,
    watch: Stopwatch | None = None,
) -> tuple[Turn, bool]:
    """Let a robot drive, one decision after another.

    Args:
        simulator: The robot in its building.
        navigator: Who maps, plans and steers.
        policy: Who chooses the goals.
        task: Where the robot starts, and where the target stands.
        rng: Source of all noise.
        judge: Whether the robot goes on; asked in each turn before anything is decided.
        on_decision: Is told of each decision before it is done; another action that it gives is done instead.
        interpret: What the robot makes of what it sensed.
        watch: Collects the time by stage.

    Returns:
        The last turn, and whether it was the policy that had no goal any more, rather than the judge who ended it.
    """
    watch = watch or Stopwatch()
    mapper, planner, controller, _ = navigator
    rounds = Rounds()
    view, motion, action = simulator.reset(task, rng), None, None
    mapper.reset(task.start)
    while True:
        with watch.stage("mapper"):
            estimate = mapper.update(view.depth, action, view.odometry, **view.beside)
        turn = Turn(pose=simulator.pose, before=action, motion=motion, view=view, estimate=estimate)
        with watch.stage("judging"):
            if not judge(turn):
                return turn, False
        with watch.stage("link state"):
            situation = interpret(view, estimate)
        with watch.stage("goal"):
            goal = policy.goal(situation)
        if goal is None:
            return turn, True
        with watch.stage("planner"):
            asked, goal = goal, rounds.goal(goal, estimate.pose)
            # A policy that somebody has written may not say.
            reason = KEPT if goal is not asked else getattr(policy, "reason", None) or UNTOLD
            # Floor is seen from before a niche; a target that is searched may stand in it.
            look = reason.kind is GoalKind.EXPLORE and not policy.seeks_target
            plan = planner.plan(estimate, goal, look=look)
            if rounds.watch(estimate.pose, goal, plan) is Remedy.PLAN_CLOSELY:
                planner.look_closely()
            own = policy.action() if isinstance(policy, Driver) else None
            action = controller.act(estimate.pose, plan) if own is None else own
        paths = simulator.radio.paths if simulator.radio else None
        other = on_decision(
            Decision(
                **vars(turn),
                situation=situation,
                paths=paths,
                belief=policy.belief,
                goal=goal,
                reason=reason,
                plan=plan,
                action=action,
            )
        )
        action = action if other is None else other
        view, motion = simulator.step(action)


def run_episode(
    building: Building,
    reach: Reach,
    task: Task,
    config: EpisodeConfig,
    on_decision: Onlooker = lambda log, decision: None,
    watch: Stopwatch | None = None,
) -> tuple[EpisodeLog, MapEstimate]:
    """Drive one robot until it arrives, has explored everything, or is out of steps.

    Ctrl-C or SIGTERM ends the episode after the step that is under way; what was done until then is returned.

    Args:
        building: Where.
        reach: What the robot's hull can reach there; coverage is counted over it.
        task: From where to where.
        config: How.
        on_decision: Called once a decision, after the action is chosen, to draw or report; or to drive by hand.
        watch: Collects the time by stage.

    Returns:
        The log, and the map as built in the end.
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
    coverage = Coverage(building.plan, floor, np.radians(config.simulator.image.hfov_deg))
    rng = np.random.default_rng([config.seed, 1])
    known_places = {anchor.name: anchor.place for anchor in task.anchors if anchor.known}

    def judge(turn: Turn) -> bool:
        coverage.update(turn.pose, simulator.true_depth, simulator.true_laser)
        log.add_pose(turn.motion, turn.pose, turn.estimate.pose, coverage.fraction)
        log.ended = interrupt.word if interrupt.asked else _verdict(log, policy, config)
        return log.ended == "running"

    def interpret(view: Observation, estimate: MapEstimate) -> Situation:
        if radio is None or interpreter is None:
            return without_radio(view, estimate)
        measurement = interpreter.interpret(view.paths, estimate.pose)
        log.add_link(measurement, radio)
        anchors = {}
        for name, link in simulator.anchors.items():
            anchors[name] = interpreter.interpret(view.anchors[name], estimate.pose, link)
            log.add_link(anchors[name], link, name)
        situation = Situation(estimate, measurement, anchors, known_places, view.target, view)
        if isinstance(navigator.mapper, Listener):
            heard = {"target": measurement, **anchors}
            navigator.mapper.listen(bearings_of(heard, radio.config, known_places))
            situation = replace(situation, located=navigator.mapper.transmitters)
        return situation

    def look(decision: Decision) -> Action | None:
        return on_decision(log, decision)

    with closing(simulator), noted_interrupt("this step", (SIGINT, SIGTERM)) as interrupt:
        last, explored = drive(
            simulator, navigator, policy, task, rng, judge, look, interpret=interpret, watch=watch
        )
    if explored:
        log.ended = "explored"
    if isinstance(navigator.mapper, Listener):
        log.transmitters = navigator.mapper.transmitters()
    return log, last.estimate


def _verdict(log: EpisodeLog, policy: GoalPolicy, config: EpisodeConfig) -> str:
    """Whether the episode goes on, judged on the true pose by one rule for every policy."""
    if policy.seeks_target and log.arrived:
        return "arrived"
    return "out of steps" if log.steps >= config.max_steps else "running"
