"""Links between robots: where one robot is, seen from another, by submaps that are found on the other's map.

Submaps of the smaller map are searched for on the whole larger one (correlative scan matching), and fitted to its
submaps. Many links are wrong, since places look alike; `slam.graph.joining` decides.
Reference: Olson, Real-time correlative scan matching, ICRA 2009.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from slam.graph.pose_graph import chained
from slam.graph.submaps import Fit, Submap, fit
from slam.graph.tracked_map import TrackedMap
from slam.graph.tracker_config import TrackerConfig
from slam.matching.levels import ARM_M, SurfaceLevels, difference, most_paired, nearest_poses
from slam.matching.scan_matching import match_from
from slam.poses import between, compose, rotation, to_map

#: Step of the places at which a submap is tried, and their largest distance from the other robot's trajectory [m].
_STEP_M, _REACH_M = 0.25, 2.0
#: Most submaps searched for, their points, poses of each that are fitted, and the least distance between these [m].
_SEARCHED, _TRIED, _FITTED, _APART_M = 40, 60, 5, 0.3
#: Submaps that a pose is fitted to, the nearest, and the covariance of a pose that was found on the map [m^2, rad^2].
_AROUND, _PLACED = 3, np.diag([0.03, 0.03, 0.006]) ** 2
#: Prior of a submap that may be anywhere.
_ANYWHERE = 1e6 * np.eye(3)
#: A fit whose place is known no better than this says nothing of the relative pose [m].
_OPEN_M = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Link:
    """Where a robot at one of its scans is, seen from another robot at one of its scans."""

    robots: tuple[int, int]
    """Numbers of both robots; the pose is that of the second."""
    scans: tuple[int, int]
    """Numbers of their scans, which submaps that are merged do not change."""
    pose: Float[np.ndarray, "3"]
    """Pose of the second robot in the frame of the first at that scan: x [m], y [m], yaw [rad]."""
    covariance: Float[np.ndarray, "3 3"]
    """Covariance of the pose, in the frame of the first."""


def find_links(trackers: Sequence[TrackedMap], first: int, second: int) -> list[Link]:
    """Search for submaps of one robot on the map of another.

    Args:
        trackers: Maps of the robots.
        first: Number of one robot.
        second: Number of the other.

    Returns:
        Fits that do not contradict, many of them by chance: places look alike.
    """
    # The smaller map is looked for on the larger.
    if len(trackers[first].submaps) < len(trackers[second].submaps):
        first, second = second, first
    tracker, source = trackers[first], trackers[second]
    if not tracker.poses().size or not source.poses().size:
        return []
    levels, places = _whole_map(tracker), _places(tracker)
    middles = middles_of(tracker.graph.poses, tracker.submaps)
    numbers = np.array([k for k, submap in enumerate(source.submaps) if submap.poses], int)
    sample = np.unique(np.linspace(0, len(numbers) - 1, min(_SEARCHED, len(numbers))).astype(int))
    links = []
    for number in numbers[sample]:
        submap = source.submaps[number]
        for pose in _search(levels, places, submap, tracker.config):
            x, y, _ = submap.circle()
            away_m = np.hypot(*(middles - to_map(pose, np.array([x, y]))).T)
            best: tuple[int, Fit] | None = None
            for node in np.argsort(away_m, kind="stable")[:_AROUND].tolist():
                alignment = _fit(tracker, node, submap, pose)
                if alignment is not None and (best is None or alignment.overlap > best[1].overlap):
                    best = node, alignment
            if best is not None:
                links.append(_link((first, second), (tracker.submaps[best[0]], submap), best[1]))
    return links


def _search(
    levels: SurfaceLevels, places: Float[np.ndarray, "k 2"], submap: Submap, config: TrackerConfig
) -> list[Float[np.ndarray, "3"]]:
    """Poses on a map at which most of a submap lies on surfaces, no two of them neighbours."""
    outline = submap.outline()
    if len(outline.points) < config.match.min_pairs:
        return []
    arm_m = max(ARM_M, float(np.median(np.hypot(*(outline.points - outline.points.mean(axis=0)).T))))
    count = math.ceil(2 * math.pi * arm_m / _STEP_M)
    turns = np.arange(count) * 2 * math.pi / count
    centre = np.append(places[0], 0.0)
    points = outline.every()
    points = points[np.linspace(0, len(points) - 1, min(_TRIED, len(points))).astype(int)]
    starts = np.array(nearest_poses(levels, points, centre, places - places[0], turns, arm_m))
    coarse = match_from(levels.coarse, outline, centre, _ANYWHERE, config.match, starts)
    coarse.sort(key=most_paired, reverse=True)
    distinct: list[Float[np.ndarray, 3]] = []
    for match in coarse:
        if all(math.hypot(*difference(match.pose, pose, arm_m)) > _APART_M for pose in distinct):
            distinct.append(match.pose)
        if len(distinct) == _FITTED:
            break
    fine = match_from(levels.fine, outline, centre, _ANYWHERE, config.match, np.array(distinct))
    return [match.pose for match in fine]


def _fit(tracker: TrackedMap, node: int, submap: Submap, pose: Float[np.ndarray, "3"]) -> Fit | None:
    """Fit a submap to one of a map, near a pose on the map; None if it is a contradiction, or leaves the place open."""
    config, predicted = tracker.config, between(tracker.graph.poses[node], pose)
    alignment = fit(submap, tracker.submaps[node], predicted, _PLACED, config.match, config.submap_error)
    if alignment is None or alignment.overlap < config.overlap:
        return None
    is_open = np.trace(alignment.covariance[:2, :2]) > _OPEN_M**2
    return None if is_open or alignment.agreement < config.searched_agreement else alignment


def _link(robots: tuple[int, int], submaps: tuple[Submap, Submap], alignment: Fit) -> Link:
    """Link between the first scans of two submaps, by a fit of the second to the first."""
    start, end = (submap.poses[0] for submap in submaps)
    pose = compose(compose(between(start, np.zeros(3)), alignment.pose), end)
    turn = rotation(-start[2])
    spread = chained(alignment.pose, alignment.covariance, end, np.zeros((3, 3)))
    scans = submaps[0].numbers[0], submaps[1].numbers[0]
    return Link(robots=robots, scans=scans, pose=pose, covariance=turn @ spread @ turn.T)


def reverse_link(link: Link) -> Link:
    """The same link, seen from the other robot."""
    x, y, yaw = link.pose
    back = -rotation(-yaw) @ np.array([[1.0, 0.0, y], [0.0, 1.0, -x], [0.0, 0.0, 1.0]])
    return Link(
        robots=link.robots[::-1],
        scans=link.scans[::-1],
        pose=between(link.pose, np.zeros(3)),
        covariance=back @ link.covariance @ back.T,
    )


def _whole_map(tracker: TrackedMap) -> SurfaceLevels:
    """Surfaces of all submaps."""
    levels = SurfaceLevels(tracker.config.cell_m)
    for pose, submap in zip(tracker.graph.poses, tracker.submaps, strict=True):
        if submap.poses:
            levels.take(submap.surfaces, pose)
    return levels


def _places(tracker: TrackedMap) -> Float[np.ndarray, "k 2"]:
    """Places (x, y) [m] near the trajectory."""
    cells = np.unique(np.round(tracker.poses()[:, :2] / _STEP_M).astype(int), axis=0)
    n = math.ceil(_REACH_M / _STEP_M)
    disc = np.stack(np.meshgrid(np.arange(-n, n + 1), np.arange(-n, n + 1)), axis=-1).reshape(-1, 2)
    disc = disc[np.hypot(*disc.T) <= n]
    return _STEP_M * np.unique((cells[:, None] + disc).reshape(-1, 2), axis=0)


def middles_of(
    poses: Sequence[Float[np.ndarray, "3"]], submaps: Sequence[Submap]
) -> Float[np.ndarray, "n 2"]:
    """Middle (x, y) [m] of each submap; infinite for one without scans."""
    return np.array(
        [
            to_map(pose, np.array(submap.circle()[:2])) if submap.poses else np.full(2, np.inf)
            for pose, submap in zip(poses, submaps, strict=True)
        ]
    )
