"""Member of a team: what a robot tells the others, and what it knows by them.

It tells its status (pose, goal, path), its map in tiles, and its measurements of the target, of which those taken
closer together than a metre say little new. Of the others it knows the same. Its own goal policy is given the merged
map, measurements of all, and where the others are bound, so that it leaves to them what they reach sooner.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from robosim.policies.reason import GoalKind
from robosim.radio.measurement import Measurement
from robosim.step import Decision
from robosim.team.giving_way import AROUND_M, NEAR_M, GivingWay
from robosim.team.notes import Note, Notebook
from robosim.team.shared_map import SharedMap, TileChanges
from slam.actions import ahead_m
from slam.grid import Claim, MapEstimate, MovingThing
from slam.hull import Hull
from slam.poses import to_map

#: Least distance between two measurements that are told [m].
_APART_M = 1.0
#: A track nearer than this to where a robot says it is, is that robot [m].
_SAME_M = 0.6
#: A robot that was not heard for so many decisions is bound for nothing any more.
_SILENT = 40


@dataclass(frozen=True, eq=False)
class Status:
    """What a robot does."""

    decision: int
    """Number of its decision."""
    pose: Float[np.ndarray, "3"]
    """Estimated pose in `map`."""
    next_xy: Float[np.ndarray, "2"]
    """Where it will be after what it does now [m]."""
    radius_m: float
    """Radius in which it turns [m]."""
    stood: int
    """Decisions for which it has stayed in its place."""
    goal: Float[np.ndarray, "2"] | None = None
    """Where it is bound, in `map` [m]; None if it has nothing to do."""
    path: Float[np.ndarray, "n 2"] | None = None
    """Corners of its way there [m]."""
    kind: GoalKind | None = None
    """Why it goes there."""

    @property
    def left_m(self) -> float:
        """Length of its way to the goal [m]."""
        if self.path is None or self.goal is None:
            return math.inf
        points = np.vstack([self.pose[:2], self.path, self.goal])
        return float(np.hypot(*np.diff(points, axis=0).T).sum())


class Member:
    """A robot of a team."""

    def __init__(self, name: str, order: int, hull: Hull, every: int) -> None:
        """Begin with nothing known; `order` counts the robots of the team from 0."""
        self.name, self._radius_m, self._every = name, hull.turning_m, every
        self._giving_way = GivingWay(order, hull)
        self.notes = Notebook(name)
        self.others: dict[str, Status] = {}
        """Last status of each other robot that was heard."""
        self._map, self._changes = SharedMap(), TileChanges()
        self._decision, self._stood = 0, 0
        self._at = np.full(3, np.nan)
        self._told: np.ndarray | None = None
        self._measurements = 0
        self._heard: list[Measurement] = []
        self._inbox: list[Note] = []

    def hear(self, note: Note) -> None:
        """Receive a note of another robot."""
        self.notes.hear(note)
        self._inbox.append(note)

    def know(self, own: MapEstimate) -> MapEstimate:
        """The robot's own map, continued by what the others have told."""
        self._decision += 1
        for note in self._inbox:
            content, author = note.read(), note.topic.author
            if note.topic.subject == "status":
                self.others[author] = content
            elif note.topic.subject == "measurement":
                self._heard.append(content)
            else:
                self._map.add(author, content, own)
        self._inbox.clear()
        if self._decision % self._every == 1:
            self._map.refresh()
            for number, tile in self._changes.of(own):
                self.notes.write("tile", tile, number)
        merged = self._map.merge(own)
        there = [status for status in self.others.values() if self._decision - status.decision <= _SILENT]
        claims = [Claim(xy=s.goal, cost_m=s.left_m) for s in there if s.goal is not None]
        robots = [_thing(k, status, self._decision) for k, status in enumerate(self.others.values())]
        # A track of a robot that tells where it is is that robot.
        tracks = [
            track
            for track in own.moving
            if all(math.hypot(*(track.xy - robot.xy)) > _SAME_M for robot in robots)
        ]
        return replace(merged, claims=tuple(claims), moving=(*tracks, *robots))

    def give_way(self, waited: int, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """The place to back off to, if another robot has kept this one from going on for a while; else None."""
        here, paths, another = estimate.pose[:2], [], False
        for thing in estimate.moving:
            if not self.others and math.hypot(*(thing.xy - here)) < NEAR_M:
                # It comes this way, as far as nothing else is known.
                paths.append((np.array([thing.xy, 2 * here - thing.xy]), self._radius_m))
        for status in self.others.values():
            if math.hypot(*(status.pose[:2] - here)) < AROUND_M and status.path is not None:
                paths.append((np.vstack([status.pose[:2], status.path]), status.radius_m))
                another |= status.kind is GoalKind.AWAY
        return self._giving_way.place(waited, estimate, paths, another=another, hears=bool(self.others))

    def heard(self) -> list[Measurement]:
        """Measurements of the target by others since the last call."""
        heard, self._heard = self._heard, []
        return heard

    def tell(self, own: MapEstimate, decided: Decision | None) -> None:
        """Write down what the robot has measured and decided."""
        self._stood = self._stood + 1 if np.allclose(own.pose, self._at, atol=0.02) else 0
        self._at = np.array(own.pose)
        command = None if decided is None else decided.command
        ahead = np.array([ahead_m(command), 0.0])
        status = Status(self._decision, self._at, to_map(own.pose, ahead), self._radius_m, self._stood)
        if decided is not None:
            status = replace(status, goal=decided.goal, path=decided.path, kind=decided.reason.kind)
            measured = decided.estimates.measurement
            place = own.pose[:2]
            if measured is not None and (self._told is None or math.hypot(*(place - self._told)) >= _APART_M):
                self._told = place.copy()
                self._measurements += 1
                self.notes.write("measurement", measured, (self._measurements,))
        self.notes.write("status", status)


def _thing(number: int, status: Status, decision: int) -> MovingThing:
    """Another robot, as something to keep away from, at a decision; `number` is not that of a track.

    One that has nothing to do, or is not heard any more, is an obstacle to plan around; others will go on.
    """
    silent = decision - status.decision
    # It has not moved yet if its last decision is as late as this one.
    waits_to_move = silent <= 0
    return MovingThing(
        xy=status.pose[:2] if waits_to_move else status.next_xy,
        velocity=status.next_xy - status.pose[:2] if waits_to_move else np.zeros(2),
        covariance=1e-4 * np.eye(4),
        stood_s=float(status.stood) + silent,
        unseen_s=0.0,
        number=-1 - number,
        radius_m=status.radius_m,
    )
