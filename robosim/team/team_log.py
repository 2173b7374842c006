"""Log of a team: the logs of its robots, the floor that they have seen together, and the scores computed from them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.episode_log import EpisodeLog
from robosim.task.coverage import Coverage
from slam.graph.encounters import RelativePose
from slam.grid import MapEstimate
from slam.poses import between, wrap


@dataclass(eq=False)
class TeamLog:
    """Logs by robot."""

    robots: dict[str, EpisodeLog]
    """Log of each robot by its name."""
    maps: dict[str, MapEstimate] = field(default_factory=dict)
    """Last map of each robot, as far as it was reported of the others' maps: continued by them."""
    coverage: list[float] = field(default_factory=list)
    """Part of the floor that a robot or more can reach, which those have seen together, after each decision; empty for
    one robot."""
    overlap: list[float] = field(default_factory=list)
    """Part of what was seen that several robots have seen, after each decision."""
    sent_bytes: Mapping[str, int] = field(default_factory=dict)
    """Bytes that each robot has sent to others."""
    frames: Mapping[str, Mapping[str, RelativePose]] = field(default_factory=dict)
    """Starts of others relative to that of each robot, as it has estimated them; empty if starts are known."""

    def add_seen(self, coverages: Sequence[Coverage]) -> None:
        """Add what the robots have seen so far."""
        seen = np.sum([coverage.seen for coverage in coverages], axis=0, dtype=np.uint8)
        region = np.any([coverage.region for coverage in coverages], axis=0)
        reachable, together, twice = (int(np.count_nonzero(cells)) for cells in (region, seen, seen > 1))
        self.coverage.append(together / max(reachable, 1))
        self.overlap.append(twice / max(together, 1))

    def frame_errors(self) -> Float[np.ndarray, "n 3"]:
        """Errors of relative starts that robots have estimated: x [m], y [m], yaw [rad] in the frame of each."""
        starts = {name: log.task.start for name, log in self.robots.items()}
        errors = np.reshape(
            [
                known.pose - between(starts[name], starts[other])
                for name, frames in self.frames.items()
                for other, known in frames.items()
            ],
            (-1, 3),
        )
        errors[:, 2] = wrap(errors[:, 2])
        return errors

    @property
    def first(self) -> EpisodeLog:
        """Log of the robot that arrived first; if none did, of the first one that was not lost."""

        def rank(log: EpisodeLog) -> tuple[float, bool]:
            return math.inf if log.arrived_at is None else log.arrived_at, log.ended == "lost"

        return min(self.robots.values(), key=rank)

    def result(self) -> dict[str, Any]:
        """Scores of the robot that arrived first, or of the only one; with others also those of the team."""
        first = self.first.result()
        if len(self.robots) == 1:
            return first
        logs = self.robots.values()
        # To the end: robots that explore go on past the target.
        legs_m = [np.diff(np.array(log.poses)[:, :2], axis=0) for log in logs]
        contacts = [contact for log in logs for contact in log.contacts or ()]
        # The first bodies that a robot meets are the other robots.
        with_robots = [contact for contact in contacts if contact.body < len(logs) - 1]
        by_robot = sum(contact.by_robot for contact in contacts)
        of_robots = sum(contact.by_robot for contact in with_robots)
        return {
            **first,
            "coverage": self.coverage[-1],
            "robots": len(logs),
            "path_length_all_m": sum(float(np.hypot(*legs.T).sum()) for legs in legs_m),
            "collisions": sum(motion.collided for log in logs for motion in log.motions),
            "overlap": self.overlap[-1],
            "contacts_between_robots": of_robots,
            "contacts_by_robot": by_robot - of_robots,
            "contacts_by_others": len(contacts) - len(with_robots) - (by_robot - of_robots),
            "sent_bytes": sum(self.sent_bytes.values()),
            **self._frames_result(),
        }

    def _frames_result(self) -> dict[str, Any]:
        """Part of the relative starts that are known, and their largest errors, if starts were unknown."""
        if not self.frames:
            return {}
        errors, n = self.frame_errors(), len(self.robots)
        return {
            "frames_known": len(errors) / (n * (n - 1)),
            "frame_error_m": float(np.hypot(*errors[:, :2].T).max()) if len(errors) else None,
            "frame_error_deg": float(np.degrees(np.abs(errors[:, 2]).max())) if len(errors) else None,
        }
