"""Frames of a team whose relative starts are unknown: where the frame of each robot lies, as another robot knows it.

A robot reports poses and places relative to its start. Where it receives another in estimated line of sight it also
reports direction and distance. Two robots that saw each other at the same decision had an encounter, and encounters
give relative poses (`slam.graph.encounters`). Those of all pairs are held by one graph, so that a robot that was never
in sight is known through others. Robots that did not meet match their maps instead: submaps of each are looked for on
the other's map, and count once they agree at several places (`slam.graph.joining`).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robosim.radio.link import RadioLinkConfig
from robosim.radio.measurement import Measurement, bearings_of
from slam.graph.encounters import APART_M, Encounter, RelativePose, relative_pose
from slam.graph.joining import match_maps
from slam.graph.least_squares import Constraint
from slam.graph.pose_graph import PoseGraph
from slam.graph.tracked_map import TrackedMap
from slam.poses import between, compose
from wireless.tracing.tracer import OPAQUE_HZ

#: Least probability of a line of sight between robots that counts as one.
_IN_SIGHT = 0.9
#: Standard deviation of directions in line of sight below 10 GHz, where the lines of many paths overlap [rad].
_SIGMA_RAD = np.radians(3.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """Another robot, as it was received in estimated line of sight."""

    pose: Float[np.ndarray, "3"]
    """Pose of the observer, relative to its start."""
    bearing_rad: float
    """Azimuth of the other in the observer's frame."""
    sigma_rad: float
    """Its standard deviation."""
    range_m: float
    """Distance [m]."""
    sigma_m: float
    """Its standard deviation [m]."""


def seen_robots(
    measured: Mapping[str, Measurement], pose: Float[np.ndarray, "3"], radio: RadioLinkConfig
) -> dict[str, Seen]:
    """Robots in estimated line of sight by name, from radio measurements and the observer's pose from its start."""
    return {
        bearing.source: Seen(
            pose=pose,
            bearing_rad=bearing.bearing_rad,
            sigma_rad=float(
                _SIGMA_RAD
                if radio.frequency_hz < OPAQUE_HZ
                else np.hypot(bearing.sigma_rad, bearing.shared_rad)
            ),
            range_m=bearing.range_m,
            sigma_m=bearing.range_m * float(np.hypot(bearing.sigma_log_range, bearing.shared_log_range)),
        )
        for bearing in bearings_of(measured, radio, {})
        if bearing.beyond_m is None and bearing.direct >= _IN_SIGHT
    }


class Frames:
    """Frames of all robots, as one of them knows them."""

    def __init__(self, owner: str) -> None:
        """Begin with no relative pose known."""
        self._owner = owner
        self._seen: dict[tuple[str, str, int], Seen] = {}
        self._encounters: dict[tuple[str, str], dict[int, Encounter]] = {}
        self._pairs: dict[tuple[str, str], RelativePose] = {}
        self._changed: set[tuple[str, str]] = set()
        self._matched: dict[tuple[str, str], RelativePose] = {}
        self._is_new = False
        self.known: dict[str, RelativePose] = {}
        """Pose of each robot's frame in that of the owner, as far as it is known."""

    def add(self, author: str, decision: int, seen: Mapping[str, Seen]) -> None:
        """Add whom a robot saw at a decision."""
        for other, here in seen.items():
            self._seen[author, other, decision] = here
            if (there := self._seen.get((other, author, decision))) is not None:
                pair = (author, other) if author < other else (other, author)
                ends = (here, there) if pair[0] == author else (there, here)
                self._meet(pair, decision, *ends)

    def match(self, other: str, own_map: TrackedMap, its_map: TrackedMap) -> None:
        """Look for the places of another robot's map on the owner's, unless its frame is known."""
        if other not in self.known and (known := match_maps(own_map, its_map)) is not None:
            self._matched[self._owner, other] = known
            self._is_new = True

    def _meet(self, pair: tuple[str, str], decision: int, first: Seen, second: Seen) -> None:
        past = self._encounters.setdefault(pair, {})
        # Two encounters at the same two places say the same, with the same error.
        if any(
            np.hypot(*(first.pose - e.first)[:2]) + np.hypot(*(second.pose - e.second)[:2]) < APART_M
            for e in past.values()
        ):
            return
        weight = np.array([first.sigma_m, second.sigma_m]) ** -2.0
        past[decision] = Encounter(
            first=first.pose,
            second=second.pose,
            bearing_rad=(first.bearing_rad, second.bearing_rad),
            sigma_rad=(first.sigma_rad, second.sigma_rad),
            range_m=float(np.average([first.range_m, second.range_m], weights=weight)),
            # Powers at both ends have the same error, and ranges hardly.
            sigma_m=min(first.sigma_m, second.sigma_m),
        )
        self._changed.add(pair)

    def update(self) -> bool:
        """Estimate what new encounters and matches say; whether that changed anything."""
        is_new, self._is_new = self._is_new, False
        for pair in sorted(self._changed):
            # In the order of decisions: notes arrive in any.
            past = self._encounters[pair]
            before, known = self._pairs.pop(pair, None), relative_pose([past[k] for k in sorted(past)])
            if known is not None:
                self._pairs[pair] = known
            is_new |= before is not None or known is not None
        self._changed.clear()
        if is_new:
            self.known = self._joined()
        return is_new

    def _joined(self) -> dict[str, RelativePose]:
        """Frames of all robots that pairs connect with the owner, by encounters where there are some."""
        node_of, graph = {self._owner: 0}, PoseGraph(np.zeros(3))
        left = {
            pair: known for pair, known in self._matched.items() if pair[::-1] not in self._pairs
        } | self._pairs
        while (pair := next((p for p in left if p[0] in node_of or p[1] in node_of), None)) is not None:
            pose, covariance = left.pop(pair)
            closes = pair[0] in node_of and pair[1] in node_of
            if pair[1] not in node_of:
                node_of[pair[1]] = graph.add(compose(graph.poses[node_of[pair[0]]], pose))
            elif pair[0] not in node_of:
                node_of[pair[0]] = graph.add(
                    compose(graph.poses[node_of[pair[1]]], between(pose, np.zeros(3)))
                )
            ends = {"first": node_of[pair[0]], "second": node_of[pair[1]]}
            graph.hold(Constraint(**ends, pose=pose, covariance=covariance, loop=closes))
        graph.solve()
        spread = graph.uncertainty(0)
        return {name: RelativePose(graph.poses[node], spread[node]) for name, node in node_of.items() if node}
