"""Member of a team: what a robot reports to the others, and what it knows from them.

It reports its status (pose, goal, path), its map in tiles, and its measurements of the target, of which those taken
closer together than a metre add little. Of the others it knows the same. Its own goal policy is given the merged
map, measurements of all, and where the others are bound, so that it leaves to them what they reach sooner.

If starts are unknown, all that it reports is relative to its start, and it uses nothing of a robot whose frame it does
not know (`robosim.team.frames`) but stores it until then.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.policies.reason import TO_TARGET, GoalKind
from robosim.radio.link import RadioLinkConfig
from robosim.radio.measurement import Measurement
from robosim.step import Decision
from robosim.team.frames import Frames, seen_robots
from robosim.team.notes import Note, Notebook, Topic
from robosim.team.shared_map import SharedMap, TileChanges
from robosim.team.team_radio import PairMeasurements
from robosim.team.yielding import AROUND_M, NEAR_M, Yielding
from slam.actions import FORWARD_M, Action
from slam.graph.tracked_map import TrackedMap
from slam.grid import Claim, MapEstimate, MovingThing
from slam.hull import Hull
from slam.planning.planner import Plan
from slam.poses import between, compose, to_map, wrap

#: Least distance between two measurements that are reported [m].
_APART_M = 1.0
#: A track nearer than this to where a robot says it is, is that robot [m].
_SAME_M = 0.6
#: A robot that turns stays within this distance of its place [m]; floor so far from its hull is left to it [m].
_TURNS_M, _LEFT_M = 0.15, 0.3
#: A step forward, in the frame of a robot [m].
_STEP = np.array([FORWARD_M, 0.0])
#: Decisions for which a status says where a robot is.
_FRESH = 2
#: Maps of others are put to their places again if their frames move by more [m, rad].
_SHIFT_M, _TURN_RAD = 0.02, math.radians(0.1)
#: Subjects of notes that only say where frames lie.
_OF_FRAMES = ("robots", "submaps")
#: A robot whose last status is older than so many decisions is bound for nothing.
_SILENT = 40
#: Decision at which submaps are first sent to those whose frames are unknown, and the factor to the next such one.
_FIRST_SUBMAPS, _LATER = 50, 1.25


@dataclass(frozen=True, eq=False)
class Status:
    """Pose, goal and path of a robot at a decision."""

    decision: int
    """Number of its decision."""
    pose: Float[np.ndarray, "3"]
    """Estimated pose in `map`."""
    next_xy: Float[np.ndarray, "2"]
    """Where it will be after what it does now [m]."""
    radius_m: float
    """Radius in which it turns [m]."""
    stood: int
    """Decisions for which it has stayed in its place, turning or not."""
    goal: Float[np.ndarray, "2"] | None = None
    """Where it is bound, in `map` [m]; None if it has nothing to do."""
    path: Float[np.ndarray, "n 2"] | None = None
    """Corners of its path there [m]."""
    kind: GoalKind | None = None
    """Why it goes there."""

    @property
    def left_m(self) -> float:
        """Length of its path to the goal [m]."""
        if self.path is None or self.goal is None:
            return math.inf
        points = np.vstack([self.pose[:2], self.path, self.goal])
        return float(np.hypot(*np.diff(points, axis=0).T).sum())

    def transformed(self, by: Float[np.ndarray, "3"]) -> "Status":
        """The status in the frame in which its frame lies at a pose."""
        return replace(
            self,
            pose=compose(by, self.pose),
            next_xy=to_map(by, self.next_xy),
            goal=None if self.goal is None else to_map(by, self.goal),
            path=None if self.path is None else to_map(by, self.path),
        )


class Member:
    """A robot of a team."""

    def __init__(self, name: str, order: int, hull: Hull, every: int) -> None:
        """Begin with nothing known; `order` counts the robots of the team from 0."""
        self.name, self._radius_m, self._every = name, hull.turning_m, every
        self._yielding = Yielding(order, hull)
        self.notes = Notebook(name)
        self.others: dict[str, Status] = {}
        """Last status of each other robot that was received."""
        self._map, self._changes = SharedMap(hull), TileChanges()
        self._decision, self._stood = 0, 0
        self._at = np.full(2, np.inf)
        self._reported: np.ndarray | None = None
        self._measurements = 0
        self._received: list[Measurement] = []
        self._inbox: list[Note] = []
        self.measure_robots: Callable[[], Mapping[str, Measurement]] = dict
        """Returns radio measurements of other robots as of the last occasion, by robot, with azimuths in `map`."""
        self._measured: Callable[[], PairMeasurements] | None = None
        self.frames: Frames | None = None
        """Where the frames of the others lie; None if all know their starts in one frame."""
        self._start, self._radio = np.zeros(3), RadioLinkConfig()
        self._placed: dict[str, np.ndarray] = {}
        self._added: set[Topic] = set()
        """Measurements that were read, while starts are unknown."""
        self._send_submaps_at = _FIRST_SUBMAPS
        self._starts: Mapping[str, Status] = {}

    def begin_apart(self, start: Float[np.ndarray, "3"], radio: RadioLinkConfig) -> None:
        """Report relative to the start, a pose in `map`, without knowing the starts of the others."""
        self.frames, self._start, self._radio = Frames(self.name), np.asarray(start, float), radio

    def begin_together(self, others: Mapping[str, Status]) -> None:
        """Know where all others start, and that nothing else moves."""
        self._starts = others

    @property
    def places(self) -> Float[np.ndarray, "k 3"] | None:
        """Where all that moves may be now, as disks (x, y, radius) [m]; None if that is not known."""
        places, known = [], {**self._starts, **self.others}
        if not self._starts or any(self._decision - status.decision >= _FRESH for status in known.values()):
            return None
        for status in known.values():
            places.append([*status.next_xy, status.radius_m])
            if status.decision < self._decision:
                # What it has done since is not reported yet.
                there = to_map(np.array([*status.next_xy, status.pose[2]]), _STEP)
                places.append([*there, status.radius_m])
        return np.array(places)

    def measured(self, measured: Callable[[], PairMeasurements]) -> None:
        """Receive the radio of other robots; it is sounded when it is first needed."""
        self._measured = measured

    def receive(self, note: Note) -> None:
        """Receive a note of another robot."""
        self.notes.receive(note)
        self._inbox.append(note)

    def begin(self, own_map: MapEstimate, tracked: TrackedMap | None = None) -> None:
        """Begin a decision: read what the others have reported, and report the robot's own map.

        Maps of robots whose starts are unknown are matched by submaps, if the mapper has some (`tracked`).
        """
        self._decision += 1
        if self._measured is not None:
            self._interpret(self._measured, np.array(own_map.pose))
            self._measured = None
        for note in self._inbox if self.frames is None else self._in_frame(self.frames, tracked):
            content, author = note.read(), note.topic.author
            if author in self._placed:
                content = content.transformed(self._placed[author])
            if note.topic.subject == "status":
                self.others[author] = content
            elif note.topic.subject == "measurement":
                self._received.append(content)
            else:
                self._map.add(author, content, own_map)
        self._inbox.clear()
        if (self._decision - 1) % self._every == 0:
            self._map.refresh()
            for number, tile in self._changes.of(own_map):
                self._write("tile", tile, number)
            if self.frames is not None and tracked is not None and self._decision > self._send_submaps_at:
                self._send_submaps_at = math.ceil(_LATER * self._decision)
                self._write("submaps", tracked)

    def merged(self, own_map: MapEstimate) -> MapEstimate:
        """The robot's own map, continued by what the others have reported."""
        merged = self._map.merge(own_map)
        there = [status for status in self.others.values() if self._decision - status.decision <= _SILENT]
        claims = [Claim(s.goal, s.left_m, s.kind in TO_TARGET) for s in there if s.goal is not None]
        # Where a robot is that has not reported lately, only sensors show.
        robots = [
            _thing(k, status, self._decision)
            for k, status in enumerate(self.others.values())
            if self._decision - status.decision <= _FRESH
        ]
        # A track of a robot that reports where it is is that robot.
        tracks = [
            track
            for track in own_map.moving
            if all(math.hypot(*(track.xy - robot.xy)) > _SAME_M for robot in robots)
        ]
        explored = merged.explored.copy() if robots else merged.explored
        for status in robots:
            # What is to be seen at its place, it sees as it leaves.
            rows, columns, covered = merged.frame.disc(status.xy, (status.radius_m or 0.0) + _LEFT_M)
            explored[rows, columns][covered] = True
        return replace(merged, explored=explored, claims=tuple(claims), moving=(*tracks, *robots))

    def _interpret(self, measured: Callable[[], PairMeasurements], pose: Float[np.ndarray, "3"]) -> None:
        """Turn measurements of other robots into `map`; while starts are unknown, report those in sight."""
        self.measure_robots = lambda: {
            name: replace(m, pose=pose, aoa_rad=wrap(m.aoa_rad + pose[2]))
            for name, m in measured()[self.name].items()
        }
        if self.frames is None:
            return
        if seen := seen_robots(self.measure_robots(), between(self._start, pose), self._radio):
            self.notes.write("robots", seen, (self._decision,))
            self.frames.add(self.name, self._decision, seen)

    def _in_frame(self, frames: Frames, tracked: TrackedMap | None) -> list[Note]:
        """Notes to read: received ones of robots whose frames are known, and all of those whose frames have moved."""
        for note in self._inbox:
            if note.topic.subject == "robots":
                frames.add(note.topic.author, note.topic.number[0], note.read())
            elif note.topic.subject == "submaps" and tracked is not None:
                frames.match(note.topic.author, tracked, note.read())
        notes = [note for note in self._inbox if note.topic.subject not in _OF_FRAMES]
        for author in sorted({*self._placed, *frames.known}) if frames.update() else ():
            known, before = frames.known.get(author), self._placed.pop(author, None)
            if known is not None:
                at = compose(self._start, known.pose)
                if before is not None and _is_same(at, before):
                    self._placed[author] = before
                    continue
                self._placed[author] = at
            self._map.remove(author)
            self.others.pop(author, None)
            # The belief has measurements that were read before.
            again = [
                n
                for n in self.notes.of(author)
                if n.topic.subject not in _OF_FRAMES and n.topic not in self._added
            ]
            notes = [note for note in notes if note.topic.author != author] + again
        notes = [note for note in notes if note.topic.author in self._placed]
        self._added |= {note.topic for note in notes if note.topic.subject == "measurement"}
        return notes

    def _write(self, subject: str, content: Any, number: tuple[int, ...] = ()) -> None:
        """Write a note, relative to the start if that is unknown to the others."""
        if self.frames is not None:
            content = content.transformed(between(self._start, np.zeros(3)))
        self.notes.write(subject, content, number)

    def place_to_yield(self, waited: float, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """The place to back off to, if another robot has blocked this one for a while; else None (see `Yielding`)."""
        here, paths, another = estimate.pose[:2], [], False
        for thing in estimate.moving:
            if not self.others and math.hypot(*(thing.xy - here)) < NEAR_M:
                # Its path is unknown: it may come straight on.
                paths.append((np.array([thing.xy, 2 * here - thing.xy]), self._radius_m))
        for status in self.others.values():
            if math.hypot(*(status.pose[:2] - here)) < AROUND_M and status.path is not None:
                paths.append((np.vstack([status.pose[:2], status.path]), status.radius_m))
                another |= status.kind is GoalKind.AWAY
        return self._yielding.place(waited, estimate, paths, another=another, receives=bool(self.others))

    def back_along(self, pose: Float[np.ndarray, "3"], plan: Plan) -> Action | None:
        """The action that leads backwards to that place; None if the robot is to go forwards."""
        return self._yielding.back_along(pose, plan)

    def received(self) -> list[Measurement]:
        """Measurements of the target by others since the last call."""
        received, self._received = self._received, []
        return received

    def report(self, own_map: MapEstimate, decided: Decision | None) -> None:
        """Write down what the robot has measured and decided."""
        pose = np.array(own_map.pose)
        stays = math.hypot(*(pose[:2] - self._at)) < _TURNS_M
        self._stood, self._at = (self._stood + 1, self._at) if stays else (0, pose[:2])
        ahead = np.array([0.0 if decided is None else decided.command.ahead_m, 0.0])
        status = Status(self._decision, pose, to_map(pose, ahead), self._radius_m, self._stood)
        if decided is not None:
            status = replace(status, goal=decided.goal, path=decided.path, kind=decided.reason.kind)
            measured = decided.estimates.measurement
            place = own_map.pose[:2]
            if measured is not None and (
                self._reported is None or math.hypot(*(place - self._reported)) >= _APART_M
            ):
                self._reported = place.copy()
                self._measurements += 1
                self._write("measurement", measured, (self._measurements,))
        self._write("status", status)


def _is_same(pose: Float[np.ndarray, "3"], other: Float[np.ndarray, "3"]) -> bool:
    """Whether tiles need not be put to another place."""
    x, y, yaw = between(pose, other)
    return math.hypot(x, y) < _SHIFT_M and abs(float(yaw)) < _TURN_RAD


def _thing(number: int, status: Status, decision: int) -> MovingThing:
    """Another robot, as something to keep away from, at a decision; `number` is not that of a track.

    One that has stood for a while is an obstacle to plan around (`slam.control.avoidance`).
    """
    # It has not moved yet if its last decision is as late as this one; else a wall may have stopped it before.
    waits_to_move, step = status.decision >= decision, status.next_xy - status.pose[:2]
    return MovingThing(
        xy=status.pose[:2] if waits_to_move else status.next_xy,
        velocity=step if waits_to_move else -step,
        covariance=1e-4 * np.eye(4),
        stood_s=float(status.stood),
        unseen_s=0.0,
        number=-1 - number,
        radius_m=status.radius_m,
    )
