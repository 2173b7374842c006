"""Episode: robots search for a target in a building that they do not know.

This is the whole system on one page: a world with robots in it, an agent that drives each robot, a judge who knows the
truth, and the loop of sensing and acting. `robosim.agent` is what a robot makes of what it senses; it never sees the
truth. Of the policies only the oracle is given the target, and `shortest`, the physical limit, the building too. Most
episodes have one robot; those of a team exchange what they know, as far as their radio allows (`robosim.team`).
"""

from collections.abc import Callable, Mapping
from contextlib import closing
from signal import SIGINT, SIGTERM

import numpy as np

from robosim.agent import Agent, make_agent
from robosim.building.building import Building
from robosim.building.reach import Reach
from robosim.entrants import Entrant, check_entrants
from robosim.episode_config import EpisodeConfig
from robosim.episode_log import EpisodeLog
from robosim.judge import Judge
from robosim.policies.shortest import TrueMapper
from robosim.simulator import Observation
from robosim.step import Decision, Step, idle
from robosim.support.interrupt import noted_interrupt
from robosim.support.randomness import named_generator
from robosim.support.stopwatch import Stopwatch
from robosim.task.tasks import Task
from robosim.team.team import Team
from robosim.team.team_log import TeamLog
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
    team = run_team(building, {ROBOT: Entrant(task, config, reach)}, on_step, watch)
    return team.robots[ROBOT], team.maps[ROBOT]


def run_team(
    building: Building,
    entrants: Mapping[str, Entrant],
    on_step: Observer = lambda log, step: None,
    watch: Stopwatch | None = None,
) -> TeamLog:
    """Drive robots by name until the first one arrives, as `run_episode` does with one; return the log of all.

    All have the team's settings of the first.

    Raises:
        ValueError: If there is no robot, or the reach of one is in another plan.
    """
    check_entrants(building, entrants)
    watch, first = watch or Stopwatch(), next(iter(entrants.values())).config
    agents = {name: make_agent(entrant.config, entrant.task, watch) for name, entrant in entrants.items()}
    world = World(
        building,
        {name: entrant.config.simulator for name, entrant in entrants.items()},
        watch,
        uses_radio=any(agent.policy.uses_radio for agent in agents.values()),
        uses_camera=any(agent.policy.uses_camera for agent in agents.values()),
    )
    searches = {name: _Search(name, entrants[name], agents[name], world, watch) for name in entrants}
    rng = np.random.default_rng([first.seed, 1])
    team = Team(
        first.team,
        world.robots,
        {name: entrant.task.start for name, entrant in entrants.items()},
        first.link_states,
        named_generator(rng, "radio between robots"),
    )
    for name, member in team.members.items():
        agents[name].member = member
    log = TeamLog({name: search.log for name, search in searches.items()})
    with closing(world), noted_interrupt("this step", (SIGINT, SIGTERM)) as interrupt:
        sensed = world.reset({name: entrant.task for name, entrant in entrants.items()}, rng)
        for name, agent in agents.items():
            agent.reset(entrants[name].task.start)
        while True:
            for name, observation in sensed.items():
                searches[name].observe(observation)
            if len(searches) > 1:
                log.add_seen([search.judge.coverage for search in searches.values()])
            if interrupt.is_requested:
                _end(searches, interrupt.word)
            if any(searches[name].log.ended != "running" for name in sensed):
                break
            going, decisions = team.next_decision(), {}
            for name in searches.keys() - going:
                searches[name].log.ended = "lost"
            for name in going:
                team.deliver(name)
                decisions[name] = agents[name].decide()
            if all(decision is None for decision in decisions.values()):
                _end(searches, "explored")
                break
            sensed = world.step(
                {name: searches[name].command(decision, on_step) for name, decision in decisions.items()}
            )
    for name, search in searches.items():
        if search.log.ended == "running":
            search.log.ended = "another arrived"
        log.maps[name] = search.finish()
    log.sent_bytes = team.exchange.sent_bytes
    log.frames = {name: member.frames.known for name, member in team.members.items() if member.frames}
    return log


class _Search:
    """The search of one robot: its agent, and a judge with the log."""

    def __init__(self, name: str, entrant: Entrant, agent: Agent, world: World, watch: Stopwatch) -> None:
        self._name, self._agent, self._world, self._watch = name, agent, world, watch
        self._robot = robot = world.robots[name]
        agent.interpret = robot.interpreter(entrant.config.link_states)
        if agent.policy.uses_true_map:
            agent.mapper = TrueMapper(world.building, lambda: robot.pose, robot.config.robot.height_m)
        seeks_target = agent.policy.seeks_target
        self.log = EpisodeLog(entrant.task, seconds=watch.seconds, seeks_target=seeks_target, robot=name)
        self.judge = Judge(self.log, robot, entrant.reach, entrant.config.max_steps)

    def observe(self, sensed: Observation) -> None:
        """Show measurements to the agent, and the truth to the judge."""
        self._sensed, self._estimate = sensed, self._agent.observe(sensed)
        with self._watch.stage("judging"):
            self._truth = self.judge.observe(self._world.truth(self._name), self._estimate.pose)

    def command(self, decision: Decision | None, on_step: Observer) -> Command:
        """Log a decision, and return its command; a robot with nothing left to do waits for the others."""
        decision = decision or idle(self._estimate)
        self.log.add_links(self._agent.measurements, self._robot.links)
        step = Step(number=self.log.steps, sensed=self._sensed, decided=decision, true=self._truth)
        replacement = on_step(self.log, step)
        return decision.command if replacement is None else replacement

    def finish(self) -> MapEstimate:
        """Complete the log, and return the last map."""
        movers = self._robot.movers
        self.log.contacts = None if movers is None else movers.contacts
        self.log.transmitters = self._agent.mapper.transmitters()
        return self._agent.shared_map(self._estimate)


def _end(searches: Mapping[str, _Search], word: str) -> None:
    for search in searches.values():
        if search.log.ended != "lost":
            search.log.ended = word
