"""Step of an episode: measurements, estimates, decision, and ground truth.

Mapper and goal policy are given parts of `sensed` and `estimated`, never a `Step`, so that none of them can use the
truth. Code that draws, records or judges an episode is given steps: from the running loop (`robosim.episode`), or from
a recorded episode (`robosim.recording.episode_file`).
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from robosim.layers import Belief, Layer, layer_of_belief, layer_of_map
from robosim.policies.estimates import Estimates
from robosim.policies.reason import IDLE, Reason, decisions_along
from robosim.robot.motion import Motion
from robosim.simulator import Observation
from slam.actions import Action, Command
from slam.grid import MapEstimate
from slam.poses import wrap
from wireless.paths import LinkState, Paths


@dataclass(frozen=True, kw_only=True, eq=False)
class Decision:
    """Decision in a step."""

    goal: Float[np.ndarray, "2"]
    """Where to go, in `map` [m]."""
    reason: Reason
    """Why to go there."""
    path: Float[np.ndarray, "n 2"]
    """Corners of the planned path, from the robot on [m]; empty if there is none."""
    command: Command
    """Command for the next step."""
    estimates: Estimates
    """Map, pose and link that it was decided by."""
    belief: Belief | None = None
    """Where the policy believes the target to be; None if it has no such belief."""


def idle(estimate: MapEstimate) -> Decision:
    """The decision of a robot with nothing left to do: it waits where it is."""
    return Decision(
        goal=estimate.pose[:2],
        reason=IDLE,
        path=np.zeros((0, 2)),
        command=Action.WAIT,
        estimates=Estimates(estimate),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """Ground truth at a step, hidden from the robot."""

    pose: Float[np.ndarray, "3"]
    """x [m], y [m], yaw [rad] in `map`."""
    motion: Motion | None = None
    """The motion that the action before it caused; None at the first step, and in recorded episodes."""
    coverage: float = float("nan")
    """Part of the reachable floor that was seen so far, 0 to 1."""
    link_state: LinkState | None = None
    """State of the link to the target; None without a radio."""
    aoa_rad: float = float("nan")
    """Azimuth of arrival of the strongest path in `map`; NaN if there is none."""
    paths: Paths | None = None
    """Radio paths from the target; None without a radio, and in recorded episodes."""
    bodies: Float[np.ndarray, "n 4"] = field(default_factory=lambda: np.zeros((0, 4)))
    """People and others who move: x [m], y [m], yaw [rad], radius [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Step:
    """Step: measurements, estimates and decision of the robot, and the ground truth, which it does not know."""

    number: int
    """Actions done before it."""
    sensed: Observation
    decided: Decision
    true: Truth

    @property
    def estimated(self) -> Estimates:
        """Map, pose and link as the robot estimates them."""
        return self.decided.estimates

    @cached_property
    def map_layer(self) -> Layer:
        """Kinds of the cells of the estimated map."""
        return layer_of_map(self.estimated.map)

    @cached_property
    def belief_layer(self) -> Layer | None:
        """Levels of the policy's belief; None if it has none."""
        return None if self.decided.belief is None else layer_of_belief(self.decided.belief)

    @property
    def position_error_m(self) -> float:
        """Distance between estimated and true position [m]."""
        return float(np.hypot(*(self.estimated.pose - self.true.pose)[:2]))

    @property
    def heading_error_rad(self) -> float:
        """Estimated minus true heading, -pi to pi [rad]."""
        return wrap(float((self.estimated.pose - self.true.pose)[2]))

    @property
    def snr_db(self) -> float:
        """Signal-to-noise ratio of the strongest estimated path [dB]; NaN if there is none."""
        measured = self.estimated.measurement
        return float("nan") if measured is None or not len(measured.snr_db) else float(measured.snr_db[0])

    @property
    def actions_to_goal(self) -> float:
        """Actions that the planned path takes if nothing blocks it; NaN without a path."""
        path = self.decided.path
        return decisions_along(path, float(self.estimated.pose[2])) if len(path) else float("nan")
