"""The learned search: what happens where the network leads nowhere."""

import numpy as np

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.episode import EpisodeConfig, run_episode
from robosim.policies.fused import Fused
from robosim.policies.goals import PolicyContext
from robosim.policies.learned import Learned
from robosim.policies.search_network import SearchNetwork, initial_weights
from robosim.simulator import SimulatorConfig
from robosim.task.tasks import make_task
from slam.actions import Action
from slam.control.guard import Guard
from tests.plans import two_rooms


def _turning(context: PolicyContext) -> Learned:
    """By a network that turns to the left for ever."""
    weights = initial_weights(np.random.default_rng(0))
    weights["action.bias"][Action.LEFT] = 30
    return Learned(SearchNetwork(weights), Fused(context.explorer, context.fused), Guard(context.control))


def test_fused_takes_over_where_the_network_stays_in_one_place():
    """After 40 decisions on the spot, for good, and arrives; until then all actions are the network's."""
    building = make_building(two_rooms(0.8))
    places = reach(building, 0.1)
    task = make_task(
        places, np.random.default_rng(0), start=np.array([0.7, 0.7, 0.0]), target=np.array([5.4, 2.3])
    )
    config = EpisodeConfig(
        goal=_turning, mapper="classical", seed=1, max_steps=400,
        simulator=SimulatorConfig(physics="kinematic", camera="embree"),
    )  # fmt: skip
    actions, beliefs = [], []

    def look(_, decision) -> None:
        actions.append(decision.action)
        beliefs.append(decision.belief is not None)

    log, _ = run_episode(building, places, task, config, look)
    assert log.ended == "arrived"
    assert actions[:39] == [Action.LEFT] * 39 and Action.FORWARD in actions[39:]
    assert not any(beliefs[:39]) and all(beliefs[39:])
