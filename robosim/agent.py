"""The agent: the mind of one robot. It turns what the robot senses into what the robot does next.

    agent.reset(start)
    decision = agent.act(observation)          # decision.command, decision.goal, decision.estimates, ...

The mapper estimates map and pose, the interpreter the link state; the goal policy chooses a goal, the planner a path to
it, and the controller a command along the path. An agent knows no simulator, no truth and no log: the same agent drives
in an episode (`robosim.episode`), in a Gymnasium environment, through a recorded bag, and on a real robot.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from robosim.episode_config import EpisodeConfig
from robosim.navigation import Navigator, calibrated_robot, make_navigator
from robosim.policies.belief import BeliefConfig
from robosim.policies.estimates import Estimates
from robosim.policies.goals import GoalPolicy, PolicyContext, make_policy
from robosim.policies.reason import LOOP_DETECTED, UNKNOWN_REASON, YIELDS, GoalKind
from robosim.radio.link import RadioLinkConfig
from robosim.radio.measurement import Interpret, Measurement, bearings_of, check_classifier
from robosim.simulator import Observation
from robosim.step import Decision
from robosim.support.parts import accepted
from robosim.support.stopwatch import Stopwatch
from robosim.task.tasks import Task
from robosim.team.member import Member
from robosim.team.yielding import turn_along
from slam.actions import Action, Command
from slam.control.avoidance import Avoidance
from slam.grid import MapEstimate
from slam.planning.loop_detector import LoopDetector, Remedy
from slam.robot import Robot


class Agent:
    """Maps, localises, chooses goals, plans and steers."""

    def __init__(
        self,
        navigator: Navigator,
        policy: GoalPolicy,
        robot: Robot,
        *,
        radio: RadioLinkConfig | None = None,
        anchor_places: Mapping[str, Float[np.ndarray, "2"]] | None = None,
        watch: Stopwatch | None = None,
    ) -> None:
        """Combine the parts.

        Args:
            navigator: Mapper, planner and controller.
            policy: Chooses the goals.
            robot: The robot.
            radio: Carrier and waveform of the radio, for bearings.
            anchor_places: Places in `map` [m] of the transmitters whose places are known, by name.
            watch: Collects the time by stage.
        """
        self.policy, self.mapper = policy, navigator.mapper
        self.interpret: Interpret | None = None
        """Interprets radio measurements; None without a radio."""
        self.measurements: dict[str, Measurement] = {}
        """Radio measurements of the last decision by transmitter, "target" first; empty without a radio."""
        self.member: Member | None = None
        """Membership in a team; None alone."""
        self._planner, self._controller = navigator.planner, navigator.controller
        self._robot, self._radio, self._anchor_places = robot, radio, anchor_places or {}
        self._watch = watch or Stopwatch()
        self._sensed: Observation | None = None
        self._map: MapEstimate | None = None

    def reset(self, start: Float[np.ndarray, "3"]) -> None:
        """Forget the last episode, and begin at a pose x [m], y [m], yaw [rad] in `map`."""
        self.mapper.reset(start)
        self.policy.reset()
        self._planner.reset()
        self._controller.reset()
        self._loop_detector, self._avoidance = LoopDetector(), Avoidance(self._robot)
        self._mapper_inputs = accepted(self.mapper.update, ("laser", "time_s", "others"))
        self._chosen: Command | None = None
        self._sensed = self._map = None

    def act(self, sensed: Observation) -> Decision | None:
        """Decide what to do next; None if nothing is left to do."""
        self.observe(sensed)
        return self.decide()

    def observe(self, sensed: Observation) -> MapEstimate:
        """Add an observation to the map, and return the estimates of map and pose."""
        if sensed.action is not None and sensed.action != self._chosen:
            self._controller.withdraw()  # another action was done, such as a wait for people
        others = None if self.member is None else self.member.places
        measured = {"laser": sensed.laser, "time_s": sensed.time_s, "others": others}
        inputs = {name: measured[name] for name in self._mapper_inputs if measured[name] is not None}
        with self._watch.stage("mapper"):
            self._map = self.mapper.update(sensed.depth, sensed.action, sensed.odometry, **inputs)
        self._sensed = sensed
        return self._map

    def decide(self) -> Decision | None:
        """Decide what to do after the last observation; None if nothing is left to do."""
        sensed, map_ = self._sensed, self._map
        if sensed is None or map_ is None:
            raise RuntimeError("The agent has observed nothing yet. Call reset, then observe or act.")
        with self._watch.stage("link state"):
            estimates = self._estimates(sensed, map_)
        if self.member is not None:
            with self._watch.stage("team"):
                self.member.begin(map_, self.mapper.tracked_map())
                map_ = self.shared_map(map_)
                estimates = replace(
                    estimates,
                    map=map_,
                    received=self.member.received(),
                    measure_robots=self.member.measure_robots,
                )
        with self._watch.stage("goal"):
            around = self._avoidance.around(map_)
            requested = self.policy.goal(sensed, replace(estimates, map=around))
            waited = math.inf if requested is None else self._avoidance.waited
            away = None if self.member is None else self.member.place_to_yield(waited, map_)
        if requested is None:
            if away is None:
                return self._decided(None)
            requested = away
        with self._watch.stage("planner"):
            goal = self._loop_detector.goal(requested, map_.pose) if away is None else away
            reason = (self.policy.reason if goal is requested else LOOP_DETECTED) or UNKNOWN_REASON
            reason = reason if away is None else YIELDS
            # A robot sees the floor of a niche from outside; but a target may stand in it.
            look = reason.kind is GoalKind.EXPLORE and not self.policy.seeks_target
            plan = self._planner.plan(around, goal, look=look)
            if self._loop_detector.watch(map_.pose, goal, plan) is Remedy.PLAN_CLOSELY:
                self._planner.look_closely()
            self._chosen = self.policy.action()
            if self.member is not None and away is not None:
                self._chosen = self.member.back_along(map_.pose, plan)
                if self._chosen is not None:
                    self._controller.withdraw()
            if self._chosen is None:
                self._chosen = self._controller.act(map_.pose, plan)
            command = self._avoidance.checked(map_, self._chosen)
            if away is not None and command is Action.WAIT:
                command = self._avoidance.checked(map_, turn_along(map_.pose, plan.path))
        return self._decided(
            Decision(
                goal=goal,
                reason=reason,
                path=plan.path,
                command=command,
                estimates=estimates,
                belief=self.policy.belief,
            )
        )

    def shared_map(self, own_map: MapEstimate) -> MapEstimate:
        """The robot's own map, continued by what the team has reported of theirs; alone, its own one."""
        return own_map if self.member is None else self.member.merged(own_map)

    def _decided(self, decision: Decision | None) -> Decision | None:
        """Report a decision to the team, and return it."""
        if self.member is not None and self._map is not None:
            self.member.report(self._map, decision)
        return decision

    def _estimates(self, sensed: Observation, map_: MapEstimate) -> Estimates:
        """Map, pose, and what the robot makes of its radio measurements; the mapper is given their bearings."""
        if self.interpret is None or self._radio is None:
            return Estimates(map_)
        paths = {"target": sensed.paths, **sensed.anchors}
        self.measurements = {name: self.interpret(name, paths[name], map_.pose) for name in paths}
        target, anchors = self.measurements["target"], dict(self.measurements)
        del anchors["target"]
        if not self.policy.uses_directions:
            target = target.power_only()
        bearings = bearings_of({"target": target, **anchors}, self._radio, self._anchor_places)
        self.mapper.listen(bearings)
        return Estimates(map_, target, anchors, self._anchor_places, self.mapper.transmitters)


def make_agent(config: EpisodeConfig, task: Task | None = None, watch: Stopwatch | None = None) -> Agent:
    """Make the agent of an episode's configuration.

    Args:
        config: Parts and robot.
        task: Places of anchors that the robot knows, and the target, which is for oracles only; None if unknown.
        watch: Collects the time by stage.

    Raises:
        ValueError: If there is no such part, or its weights cannot be read.
    """
    simulator, robot = config.simulator, calibrated_robot(config.simulator)
    navigator = make_navigator(
        simulator,
        config.explorer,
        config.mapper,
        config.controller,
        config.known_map,
        others_m=2 * max(r.hull.turning_m for r in config.robots) if config.team.size > 1 else 0.0,
    )
    fused, belief = config.fused, config.fused.belief
    # A carrier that differs from the default is deliberate; else that of the radio is used.
    if belief.frequency_hz == BeliefConfig.frequency_hz:
        belief = replace(belief, frequency_hz=simulator.radio.frequency_hz)
    # Without a camera none of the floor counts as seen to be empty.
    fused = replace(fused, belief=belief, uses_camera=fused.uses_camera and simulator.renderer != "none")
    target = None if task is None else task.target
    context = PolicyContext(explorer=navigator.explorer, fused=fused, robot=robot, target=target)
    return Agent(
        navigator,
        make_policy(config.goal, context),
        robot,
        radio=simulator.radio,
        anchor_places={} if task is None else {a.name: a.place for a in task.anchors if a.known},
        watch=watch,
    )


def check_weights(config: EpisodeConfig) -> None:
    """Read the weights that an episode needs, so that a bad file is found before the work begins.

    Without a radio no link state is classified, and the classifier's weights are not read.
    """
    nowhere = Task(start=np.zeros(3), target=np.zeros(2), shortest_m=0.0)
    if make_agent(config, nowhere).policy.uses_radio:
        check_classifier(config.link_states, config.simulator.radio)
