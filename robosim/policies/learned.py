"""The learned search: a recurrent network chooses each action from what the robot senses, without map or planner.

It has learned in invented homes, first from a guide that knows the way, then from its own arrivals
(`robosim.training.search`). Actions are drawn by their probabilities: a robot that always takes the most likely one can
stand before two doors for ever. The draws are the same in every search, so that one seed gives one episode.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.policies.belief import TargetBelief
from robosim.policies.goals import PolicyContext
from robosim.policies.search_network import SearchNetwork, drawn_actions, load_search, no_memory
from robosim.policies.search_senses import SearchSenses
from robosim.policies.situation import Situation
from slam.actions import TURN_RAD, Action
from slam.poses import to_map

#: Seed of what is drawn.
_SEED = 28
#: How far ahead the goal is drawn [m].
_AHEAD_M = 0.5
#: Where the robot looks after an action.
_TURNS = {Action.FORWARD: 0.0, Action.LEFT: TURN_RAD, Action.RIGHT: -TURN_RAD}


class Learned:
    """Chooses actions by a network."""

    seeks_target, uses_radio, uses_camera = True, True, False
    belief: TargetBelief | None = None

    def __init__(self, network: SearchNetwork) -> None:
        """A robot at the start of its search."""
        self._network, self._senses, self._memory = network, SearchSenses(), no_memory()
        self._rng = np.random.default_rng(_SEED)
        self._action = Action.FORWARD

    def goal(self, situation: Situation) -> Float[np.ndarray, "2"]:
        """A point in the direction of the action that it chooses now, for the log.

        Raises:
            ValueError: If the robot has no radio or no camera.
        """
        heard, view = situation.measured(), situation.view
        if view is None or not view.depth.size:
            raise ValueError(
                "The learned search needs the depth that a camera measures, but the robot has none."
            )
        told = self._senses.told(
            view.depth,
            view.odometry,
            # In the robot's frame again, so without the map's error of heading.
            heard.aoa_rad - heard.pose[2],
            heard.snr_db,
            heard.delay_s,
            heard.probability,
        )
        scores, _, self._memory = self._network(told, self._memory)
        self._action = Action(int(drawn_actions(scores[None], self._rng)[0]))
        turn = _TURNS[self._action]
        return to_map(situation.estimate.pose, _AHEAD_M * np.array([np.cos(turn), np.sin(turn)]))

    def action(self) -> Action:
        """What it chose with its last goal."""
        return self._action


def learned_of_file(path: Path, context: PolicyContext) -> Learned:
    """Chooses actions by the network of a file."""
    return Learned(load_search(path))
