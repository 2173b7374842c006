"""The learned search where its network gets stuck."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.episode_log import EpisodeLog
from robosim.policies.fused import Fused
from robosim.policies.goals import PolicyContext
from robosim.policies.learned import Learned
from robosim.policies.reason import GoalKind
from robosim.policies.search_network import HIDDEN, SENSES, SearchNetwork, initial_weights
from robosim.simulator import SimulatorConfig
from robosim.task.tasks import make_task
from slam.actions import Action
from tests.plans import two_rooms
from wireless.paths import LinkState


def _biased(*actions: Action, made: type[Learned] = Learned) -> Callable[[PolicyContext], Learned]:
    """A network that always draws some actions with equal probability."""
    weights = initial_weights(np.random.default_rng(0))
    weights["action.weight"][:] = 0
    weights["action.bias"][list(actions)] = 30

    def policy(context: PolicyContext) -> Learned:
        return made(SearchNetwork(weights), Fused(context.explorer, context.fused), context.robot)

    return policy


def _search(policy, max_steps: int, look) -> EpisodeLog:
    """From one room to another."""
    building = make_building(two_rooms(0.8))
    places = reach(building, 0.1)
    task = make_task(
        places, np.random.default_rng(0), start=np.array([0.7, 0.7, 0.0]), target=np.array([5.4, 2.3])
    )
    config = EpisodeConfig(
        goal=policy, mapper="classical", seed=1, max_steps=max_steps,
        simulator=SimulatorConfig(physics="kinematic", camera="embree"),
    )  # fmt: skip
    return run_episode(building, places, task, config, look)[0]


def test_it_falls_back_to_fused_in_one_place():
    """After 40 decisions on the spot, permanently, and arrives; until then all actions are the network's."""
    actions, is_network = [], []

    def look(_, step) -> None:
        actions.append(step.decided.command)
        is_network.append(step.decided.reason.kind is GoalKind.ACTION)

    log = _search(_biased(Action.LEFT), 400, look)
    assert log.ended == "arrived"
    assert actions[:39] == [Action.LEFT] * 39 and Action.FORWARD in actions[39:]
    assert all(is_network[:39]) and not any(is_network[39:])


def test_it_falls_back_to_fused_without_new_floor():
    """At the first decision that has seen less than 1 m2 more than 100 decisions before.

    Steps and left turns with equal probability lead along circles of more than a metre.
    """
    seen_m2, is_network, places = [], [], []

    def look(_, step) -> None:
        frame = step.estimated.map.frame
        seen_m2.append(step.estimated.map.explored.sum() * frame.resolution_m**2)
        is_network.append(step.decided.reason.kind is GoalKind.ACTION)
        places.append(step.estimated.map.pose[:2].copy())

    _search(_biased(Action.LEFT, Action.FORWARD), 300, look)
    first = is_network.index(False)
    grown = np.array(seen_m2[100:]) - seen_m2[:-100]
    assert first == 100 + int(np.argmax(grown < 1.0))
    assert all(is_network[:first]) and not any(is_network[first:])
    lately = np.array(places[first - 39 : first + 1])
    assert (np.hypot(*(lately - lately[-1]).T) > 0.5).any()


def test_it_gives_the_inputs_that_speak_for_an_action():
    """A network that turns left by the first radio path alone: its reason is the radio; the belief grows with it."""
    weights = {
        name: np.zeros_like(value) for name, value in initial_weights(np.random.default_rng(0)).items()
    }
    weights["encoder.weight"][SENSES["radio paths"].start, 0] = 1
    weights["memory.input_weight"][0, -HIDDEN] = 5  # the candidate of the memory's first unit
    weights["action.weight"][0, Action.LEFT] = 10
    steps = []

    def policy(context: PolicyContext) -> Learned:
        return Learned(SearchNetwork(weights), Fused(context.explorer, context.fused), context.robot)

    _search(policy, 30, lambda _, step: steps.append(step.decided))
    assert all(one.belief is not None for one in steps)
    because = [one.reason.because for one in steps if one.reason.because.startswith("left,")]
    assert len(because) > 5
    assert all(text.endswith("without radio paths)") for text in because)


class _Silent(Learned):
    """Receives nothing in its first 70 decisions."""

    decisions = 0

    def goal(self, sensed, estimated):
        self.decisions += 1
        measured, nothing = estimated.measurement, np.zeros(0)
        if self.decisions <= 70:
            measured = replace(
                measured, aoa_rad=nothing, aod_rad=nothing, snr_db=nothing, gain_db=nothing, delay_s=nothing,
                probability=np.eye(4)[LinkState.OUTAGE],
            )  # fmt: skip
        return super().goal(sensed, replace(estimated, measurement=measured))


def test_fused_decides_in_outage_where_little_is_new_until_something_is_received():
    """A network that circles on a floor of 17 m2, far below 100 m2, where nothing is received 70 decisions long.

    `fused` decides from the first decision that has seen less than 4 m2 more than 40 before, and then the network.
    """
    seen_m2, is_network = [], []

    def look(_, step) -> None:
        frame = step.estimated.map.frame
        seen_m2.append(step.estimated.map.explored.sum() * frame.resolution_m**2)
        is_network.append(step.decided.reason.kind is GoalKind.ACTION)

    _search(_biased(Action.LEFT, Action.FORWARD, made=_Silent), 72, look)
    first = is_network.index(False)
    grown = np.array(seen_m2[40:]) - seen_m2[:-40]
    assert first == 40 + int(np.argmax(grown < 4.0)) < 70
    assert all(is_network[:first]) and not any(is_network[first:70]) and all(is_network[70:])
