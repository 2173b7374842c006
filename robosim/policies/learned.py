"""The learned search: a recurrent network chooses each action from what the robot senses, without planner.

It has learned in invented homes, first from a guide that knows the way, then from its own arrivals
(`robosim.training.search`). Actions are drawn by the third power of their probabilities, likely ones more often than in
training, so that the robot turns to and fro less; one that always took the likeliest could stand before two doors for
ever. The draws are the same in every search, so that one seed gives one episode. What it has learned does not always
lead on: where the robot stays in one place, or drives round without seeing anything new, `fused` takes over for good,
with the map that was made all along. Actions that end at something which this map shows are not drawn.
"""

from collections import deque
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.policies.arrival import Dwelling
from robosim.policies.belief import TargetBelief
from robosim.policies.estimates import Estimates
from robosim.policies.fused import Fused
from robosim.policies.goals import PolicyContext
from robosim.policies.reason import Reason
from robosim.policies.search_network import SearchNetwork, drawn_actions, load_search, no_memory
from robosim.policies.search_senses import SearchSenses
from robosim.simulator import Observation
from robosim.support.assets import shipped_network
from slam.actions import TURN_RAD, Action
from slam.control.guard import Guard
from slam.grid import MapEstimate
from slam.poses import to_map

#: Seed of what is drawn.
_SEED = 28
#: Actions are drawn by this power of their probabilities.
_POWER = 3.0
#: The robot gets no further if it was so near to one place [m] for so many decisions.
_DWELL_M, _DWELL_STEPS = 0.5, 40
#: Nor if it has seen less new floor than this [m2] in so many decisions: it drives round.
_NEW_M2, _NEW_STEPS = 1.0, 100
#: How far ahead the goal is drawn [m].
_AHEAD_M = 0.5
#: Where the robot looks after an action.
_TURNS = {Action.FORWARD: 0.0, Action.LEFT: TURN_RAD, Action.RIGHT: -TURN_RAD}


class Learned:
    """Chooses actions by a network, and leaves goals to `fused` once it gets no further."""

    seeks_target, uses_radio = True, True

    def __init__(self, network: SearchNetwork, fused: Fused, guard: Guard) -> None:
        """A robot at the start of its search."""
        self._network, self._senses, self._memory = network, SearchSenses(), no_memory()
        self._rng = np.random.default_rng(_SEED)
        self._dwelling = Dwelling(_DWELL_STEPS, _DWELL_M)
        self._seen_m2: deque[float] = deque(maxlen=_NEW_STEPS)
        self._action: Action | None = None
        self._fused, self._taken_over = fused, False
        self._guard = guard
        self.uses_camera = fused.uses_camera

    @property
    def belief(self) -> TargetBelief | None:
        """Where the target may be, once `fused` has taken over."""
        return self._fused.belief

    @property
    def reason(self) -> Reason | None:
        """Why the last goal was chosen, once `fused` has taken over."""
        return self._fused.reason

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """A point in the direction of the action that it chooses now, for the log; the goal of `fused` later on.

        Raises:
            ValueError: If the robot has no radio or no camera.
        """
        pose = estimated.pose
        self._taken_over |= self._gets_no_further(estimated.map)
        if self._taken_over:
            self._action = None
            return self._fused.goal(sensed, estimated)
        measured = estimated.require_measurement()
        if not sensed.depth.size:
            raise ValueError(
                "The learned search needs the depth that a camera measures, but the robot has none."
            )
        told = self._senses.told(
            sensed.depth,
            sensed.odometry,
            # In the robot's frame again, so without the map's error of heading.
            measured.aoa_rad - measured.pose[2],
            measured.snr_db,
            measured.delay_s,
            measured.probability,
        )
        scores, _, self._memory = self._network(told, self._memory)
        bumps = self._guard.bumps(estimated.map)
        if not bumps.all():
            scores[bumps] = -np.inf
        self._action = Action(int(drawn_actions(_POWER * scores[None], self._rng)[0]))
        turn = _TURNS[self._action]
        return to_map(pose, _AHEAD_M * np.array([np.cos(turn), np.sin(turn)]))

    def _gets_no_further(self, estimate: MapEstimate) -> bool:
        """Whether the robot stays in one place, or drives round what it knows."""
        seen_m2 = float(estimate.explored.sum()) * estimate.frame.resolution_m**2
        drives_round = len(self._seen_m2) == _NEW_STEPS and seen_m2 - self._seen_m2[0] < _NEW_M2
        self._seen_m2.append(seen_m2)
        return self._dwelling.at(estimate.pose[:2]) or drives_round

    def action(self) -> Action | None:
        """What it chose with its last goal; None once `fused` has taken over."""
        return self._action


def learned(context: PolicyContext) -> Learned:
    """Chooses actions by the shipped network."""
    return learned_of_file(shipped_network("search"), context)


def learned_of_file(path: Path, context: PolicyContext) -> Learned:
    """Chooses actions by the network of a file."""
    return Learned(load_search(path), Fused(context.explorer, context.fused), Guard(context.control))
