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
from robosim.team.notes import Note, Notebook
from robosim.team.shared_map import SharedMap, TileChanges
from slam.grid import Claim, MapEstimate, MovingThing

#: Least distance between two measurements that are told [m].
_APART_M = 1.0
#: A robot that was not heard for so many decisions is bound for nothing any more.
_SILENT = 40


@dataclass(frozen=True, eq=False)
class Status:
    """What a robot does."""

    decision: int
    """Number of its decision."""
    pose: Float[np.ndarray, "3"]
    """Estimated pose in `map`."""
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

    def __init__(self, name: str, radius_m: float, every: int) -> None:
        self.name, self._radius_m, self._every = name, radius_m, every
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
        moving = (*own.moving, *(_thing(k, status) for k, status in enumerate(self.others.values())))
        return replace(merged, claims=tuple(claims), moving=moving)

    def heard(self) -> list[Measurement]:
        """Measurements of the target by others since the last call."""
        heard, self._heard = self._heard, []
        return heard

    def tell(self, own: MapEstimate, decided: Decision | None) -> None:
        """Write down what the robot has measured and decided."""
        self._stood = self._stood + 1 if np.allclose(own.pose, self._at, atol=0.02) else 0
        self._at = np.array(own.pose)
        status = Status(self._decision, self._at, self._radius_m, self._stood)
        if decided is not None:
            status = replace(status, goal=decided.goal, path=decided.path, kind=decided.reason.kind)
            measured = decided.estimates.measurement
            place = own.pose[:2]
            if measured is not None and (
                self._told is None or math.hypot(*(place - self._told)) >= _APART_M
            ):
                self._told = place.copy()
                self._measurements += 1
                self.notes.write("measurement", measured, (self._measurements,))
        self.notes.write("status", status)


def _thing(number: int, status: Status) -> MovingThing:
    """Another robot, as something to keep away from; `number` is not that of a track."""
    return MovingThing(
        xy=status.pose[:2],
        velocity=np.zeros(2),
        covariance=1e-4 * np.eye(4),
        stood_s=float(status.stood),
        unseen_s=0.0,
        number=-1 - number,
        radius_m=status.radius_m,
    )
