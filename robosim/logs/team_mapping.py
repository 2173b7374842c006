"""Joint map of several logs: of several robots, or of one robot on several days, with unknown relative starts."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float

from robosim.logs.log_mapping import LogConfig, Mapped, map_log
from robosim.logs.robot_log import RobotLog
from slam.graph.joining import JoinedMap, join_maps, relative_pose
from slam.graph.links import find_links
from slam.graph.pose_graph import chained
from slam.poses import between, compose


@dataclass(frozen=True, kw_only=True, eq=False)
class Session:
    """A log on a map that it may share with others."""

    number: int
    """Number of the log among those given."""
    log: RobotLog
    """The log, with scans corrected for the motion between their beams."""
    poses: Float[np.ndarray, "n 3"]
    """Pose of the robot at each scan in the frame of the map: x [m], y [m], yaw [rad]."""
    start_covariance: Float[np.ndarray, "3 3"]
    """Covariance of the first pose relative to that of the map's first session, at most [m^2, m rad, rad^2]."""
    loops_across: int
    """Number of loops closed with other sessions."""
    agreement: float
    """Least part of the surfaces seen by several sessions of the map that do not contradict; 1 for one session."""


def map_team(
    logs: Sequence[RobotLog],
    config: LogConfig = LogConfig(),
    watched: Callable[[range, str], Iterable[int]] = lambda numbers, _: numbers,
) -> list[list[Session]]:
    """Map logs, and join their maps where they show the same places.

    Args:
        logs: Logs of robots.
        config: How maps are made.
        watched: Progress display: iterates over numbers, given them and their name.

    Returns:
        Sessions of each map, whose frame begins with its first session; the map of most scans is the first. A log
        that could not be placed relative to others has a map of its own.

    Raises:
        FileError: If no beam of a log hits anything, or odometry jumps farther than scans overlap.
        ValueError: If poses make a map of too many cells.
    """
    mapped = []
    for log in logs:

        def watched_log(numbers: range, stage: str, name: str = log.name) -> Iterable[int]:
            return watched(numbers, f"{name}, {stage}")

        mapped.append(map_log(log, config, watched=watched_log))
    trackers, pairs = [each.tracker for each in mapped], list(combinations(range(len(logs)), 2))
    links = [link for k in watched(range(len(pairs)), "search") for link in find_links(trackers, *pairs[k])]
    maps = []
    joined_maps = join_maps(trackers, links, lambda numbers: watched(numbers, "loops of the team"))
    for joined in joined_maps:
        origin = mapped[joined.robots[0]].log.mount
        maps.append(
            [
                Session(
                    number=robot,
                    log=mapped[robot].log,
                    poses=mapped[robot].robot_poses(joined.poses(robot), origin),
                    start_covariance=_start_covariance(joined, robot, origin, mapped[robot]),
                    loops_across=joined.n_across(robot),
                    agreement=joined.agreement,
                )
                for robot in joined.robots
            ]
        )
    return sorted(maps, key=lambda sessions: -sum(len(session.poses) for session in sessions))


def _start_covariance(
    joined: JoinedMap, robot: int, origin: Float[np.ndarray, "3"], mapped: Mapped
) -> Float[np.ndarray, "3 3"]:
    """Covariance of a robot's first pose, of that of its laser in a frame at `origin`."""
    pose, covariance = relative_pose([joined], robot, joined.robots[0]) or (np.zeros(3), np.zeros((3, 3)))
    nothing, back = np.zeros((3, 3)), between(mapped.log.mount, np.zeros(3))
    return chained(compose(origin, pose), chained(origin, nothing, pose, covariance), back, nothing)
