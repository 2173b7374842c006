"""Maps of several robots, or of one robot on several days, joined in one frame; relative starts are unknown.

Submaps of one map are searched for on the whole of another (correlative scan matching), and fitted to its submaps. A
fit alone proves nothing: offices, doors and corridors look alike. Two maps are joined only where fits at several
places agree with each other in one relative pose, and far more do than in any other; where maps are laid over each
other by that pose, their surfaces and free space must not contradict. Otherwise maps stay apart.

Joined maps share a pose graph, in which loops between them close as within one map. Relative poses that robots measure
of each other by other sensors are links too.
Reference: Mangelson et al., Pairwise consistent measurement set maximization for robust multi-robot map merging, ICRA
2018; Olson, Real-time correlative scan matching, ICRA 2009.
"""

import copy
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from slam.graph.least_squares import Constraint
from slam.graph.loop_closing import LoopCloser, Pending, compare_fits
from slam.graph.pose_graph import PoseGraph, chained
from slam.graph.submaps import Fit, Submap, fit, judge_fit, poses_of_scans
from slam.graph.tracker import Tracker
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
#: Squared difference, in variances, up to which two links agree, and largest deviation of a chain that compares [m].
_SAME, _VAGUE_M = 16.27, 1.0
#: Additional deviation of links that are compared, as maps bend [m^2, rad^2].
_BENT = np.diag([0.05, 0.05, 0.01]) ** 2
#: Links less than this from each other are of one place [m].
_PLACE_M = 2.0
#: Least places with links that agree, and how many times more they must be than those of any other relative pose.
_PLACES, _LEAD = 4, 2.0
#: Least part of surfaces seen from both maps that must not contradict.
_AGREEMENT = 0.8
#: Submaps whose relative place is known no better than this do not contradict [m].
_SURE_M = 0.15


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


@dataclass(kw_only=True, eq=False)
class JoinedMap:
    """Maps in one frame, that of the first robot."""

    robots: list[int]
    """Numbers of the robots."""
    graph: PoseGraph
    """Poses of all submaps, those of one robot after another."""
    submaps: list[Submap]
    """Submaps of all robots; numbers of scans are the robot's own."""
    first: list[int]
    """Number of the first submap of each robot."""

    def poses(self, robot: int) -> Float[np.ndarray, "n 3"]:
        """Poses of all scans of a robot: x [m], y [m], yaw [rad]."""
        nodes = self.nodes(robot)
        return poses_of_scans(self.graph.poses[nodes], self.submaps[nodes])

    def n_across(self, robot: int) -> int:
        """Number of closed loops between a robot and others, as far as they are believed."""
        nodes = self.nodes(robot)
        inside = range(nodes.start, nodes.stop)
        return sum((c.first in inside) != (c.second in inside) for c in self.graph.believed())

    def nodes(self, robot: int) -> slice:
        """Numbers of a robot's submaps."""
        k = self.robots.index(robot)
        return slice(self.first[k], [*self.first, len(self.submaps)][k + 1])

    def node_of(self, robot: int, scan: int) -> tuple[int, Float[np.ndarray, "3"]]:
        """Number of the submap with a robot's scan, and the scan's pose in it."""
        nodes = self.nodes(robot)
        for node in range(nodes.start, nodes.stop):
            if scan in self.submaps[node].numbers:
                return node, self.submaps[node].poses[self.submaps[node].numbers.index(scan)]
        raise ValueError(
            f"scan {scan} is in no submap of robot {robot}, expected that of a scan it has entered."
        )


def find_links(trackers: Sequence[Tracker], first: int, second: int) -> list[Link]:
    """Search for submaps of one robot on the map of another.

    Args:
        trackers: What the robots hold.
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
    middles = _middles(tracker.graph.poses, tracker.submaps)
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


def join_maps(
    trackers: Sequence[Tracker],
    links: Sequence[Link],
    watched: Callable[[range], Iterable[int]] = iter,
) -> list[JoinedMap]:
    """Join the maps of robots whose relative poses follow from links; the trackers remain as they are.

    Args:
        trackers: What the robots hold.
        links: Measurements between robots, of which any may be wrong.
        watched: Progress display: iterates over numbers of submaps.

    Returns:
        Maps with one frame each, the first that of robot 0; robots whose relative pose is not known have maps of their
        own.
    """
    maps = [_alone(robot, tracker) for robot, tracker in enumerate(trackers)]
    rejected: set[tuple[tuple[int, ...], tuple[int, ...]]] = set()
    while True:
        agreeing = {
            (k, j): agreeing_links(maps[k], maps[j], links)
            for k, j in combinations(range(len(maps)), 2)
            if (tuple(maps[k].robots), tuple(maps[j].robots)) not in rejected
        }
        best = max(agreeing, key=lambda pair: len(agreeing[pair]), default=(0, 0))
        if not agreeing.get(best):
            return maps
        one, other = maps[best[0]], maps[best[1]]
        joined = _joined(one, other, agreeing[best])
        config = max((tracker.config for tracker in trackers), key=lambda each: each.submap_error)
        LoopCloser(config, joined.graph, joined.submaps).fit_again(joined.graph.solve, watched=watched)
        if agreement(joined, one.robots) < _AGREEMENT:
            rejected.add((tuple(one.robots), tuple(other.robots)))
            continue
        maps[best[0]] = joined
        del maps[best[1]]


def relative_pose(
    maps: Sequence[JoinedMap], robot: int, other: int
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]] | None:
    """Pose at which a robot began, seen from where another began, and its covariance; None while it is not known."""
    for joined in maps:
        if robot in joined.robots and other in joined.robots:
            node, origin = joined.nodes(robot).start, joined.nodes(other).start
            pose = between(joined.graph.poses[origin], joined.graph.poses[node])
            return pose, joined.graph.uncertainty(origin)[node]
    return None


def agreeing_links(one: JoinedMap, other: JoinedMap, links: Sequence[Link]) -> list[Pending]:
    """Links that agree in the relative pose of two maps; none if they are too few, or hardly more than for another."""
    fits = []
    for link in links:
        if link.robots[0] in one.robots and link.robots[1] in other.robots:
            fits.append(_between_submaps(one, other, link))
        elif link.robots[1] in one.robots and link.robots[0] in other.robots:
            fits.append(_between_submaps(one, other, _reversed(link)))
    if not fits:
        return []
    graph = copy.deepcopy(one.graph)
    offset = graph.include(other.graph, np.zeros(3))
    fits = [link._replace(there=link.there + offset) for link in fits]
    agrees, contradicts = np.zeros((2, len(fits), len(fits)), bool)
    for k, j in combinations(range(len(fits)), 2):
        away, spread = compare_fits(graph, fits[k], fits[j])
        is_same = away @ np.linalg.solve(spread + _BENT, away) < _SAME
        is_known = np.trace(spread[:2, :2]) < _VAGUE_M**2
        agrees[k, j] = agrees[j, k] = is_same and is_known and fits[k][:2] != fits[j][:2]
        contradicts[k, j] = contradicts[j, k] = not is_same
    places = np.array(one.graph.poses)[:, :2]

    def n_places(group: list[int]) -> int:
        return _n_apart(places[[fits[k].here for k in group]])

    best = _largest_group(agrees, np.ones(len(fits), bool))
    rival = _largest_group(agrees, 2 * contradicts[:, best].sum(axis=1) > len(best))
    if n_places(best) < max(_PLACES, _LEAD * n_places(rival)):
        return []
    return [fits[k]._replace(there=fits[k].there - offset) for k in best]


def agreement(joined: JoinedMap, robots: Sequence[int]) -> float:
    """Part of the surfaces seen by submaps of robots and by those of others on a joined map that do not contradict."""
    is_mine = np.zeros(len(joined.submaps), bool)
    for robot in robots:
        is_mine[joined.nodes(robot)] = True
    has_scans = np.array([bool(submap.poses) for submap in joined.submaps])
    theirs, middles = np.flatnonzero(~is_mine & has_scans), _middles(joined.graph.poses, joined.submaps)
    seen = contradicted = 0.0
    for here in np.flatnonzero(is_mine & has_scans).tolist():
        away_m, spread = np.hypot(*(middles[theirs] - middles[here]).T), joined.graph.uncertainty(here)
        for there in theirs[np.argsort(away_m, kind="stable")[:_AROUND]].tolist():
            if spread[there, 0, 0] + spread[there, 1, 1] > _SURE_M**2:
                continue
            pose = between(joined.graph.poses[here], joined.graph.poses[there])
            overlap, fraction = judge_fit(joined.submaps[there], joined.submaps[here], pose)
            seen += overlap
            contradicted += overlap / max(fraction, 1e-9) - overlap
    return seen / (seen + contradicted) if seen else 1.0


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


def _fit(tracker: Tracker, node: int, submap: Submap, pose: Float[np.ndarray, "3"]) -> Fit | None:
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


def _between_submaps(one: JoinedMap, other: JoinedMap, link: Link) -> Pending:
    """A link as a fit between the submaps that hold its scans."""
    here, start = one.node_of(link.robots[0], link.scans[0])
    there, end = other.node_of(link.robots[1], link.scans[1])
    turn, back = rotation(start[2]), between(end, np.zeros(3))
    pose = compose(compose(start, link.pose), back)
    spread = chained(compose(start, link.pose), turn @ link.covariance @ turn.T, back, np.zeros((3, 3)))
    alignment = Fit(pose=pose, covariance=spread, overlap=0, agreement=1.0)
    return Pending(here, there, alignment, True)


def _reversed(link: Link) -> Link:
    """The same link, seen from the other robot."""
    x, y, yaw = link.pose
    back = -rotation(-yaw) @ np.array([[1.0, 0.0, y], [0.0, 1.0, -x], [0.0, 0.0, 1.0]])
    return Link(
        robots=link.robots[::-1],
        scans=link.scans[::-1],
        pose=between(link.pose, np.zeros(3)),
        covariance=back @ link.covariance @ back.T,
    )


def _largest_group(agrees: Bool[np.ndarray, "n n"], allowed: Bool[np.ndarray, " n"]) -> list[int]:
    """Links that all agree with each other, as many as a greedy search finds from each."""
    best: list[int] = []
    for seed in np.flatnonzero(allowed).tolist():
        group, others = [seed], agrees[seed] & allowed
        while others.any():
            link = int(np.argmax(np.where(others, agrees[:, others].sum(axis=1), -1)))
            group.append(link)
            others = others & agrees[link]
        if len(group) > len(best):
            best = group
    return best


def _n_apart(points: Float[np.ndarray, "n 2"]) -> int:
    """Number of places among points (x, y) [m]."""
    places: list[Float[np.ndarray, 2]] = []
    for point in points:
        if all(math.hypot(*(point - place)) > _PLACE_M for place in places):
            places.append(point)
    return len(places)


def _alone(robot: int, tracker: Tracker) -> JoinedMap:
    """The map of one robot, as a copy."""
    submaps = [copy.copy(submap) for submap in tracker.submaps]
    for submap in submaps:
        submap.loops = 0
    return JoinedMap(robots=[robot], graph=copy.deepcopy(tracker.graph), submaps=submaps, first=[0])


def _joined(one: JoinedMap, other: JoinedMap, links: Sequence[Pending]) -> JoinedMap:
    """Both maps in the frame of the first, with links between them as closed loops."""
    graph, first = copy.deepcopy(one.graph), links[0]
    place = compose(one.graph.poses[first.here], first.fit.pose)
    at = compose(place, between(other.graph.poses[first.there], np.zeros(3)))
    offset = graph.include(other.graph, at)
    for link in links:
        graph.hold(
            Constraint(
                first=link.here,
                second=link.there + offset,
                pose=link.fit.pose,
                covariance=link.fit.covariance,
                loop=True,
            )
        )
    graph.solve()
    return JoinedMap(
        robots=[*one.robots, *other.robots],
        graph=graph,
        submaps=[*one.submaps, *other.submaps],
        first=[*one.first, *(offset + k for k in other.first)],
    )


def _whole_map(tracker: Tracker) -> SurfaceLevels:
    """Surfaces of all submaps."""
    levels = SurfaceLevels(tracker.config.cell_m)
    for pose, submap in zip(tracker.graph.poses, tracker.submaps, strict=True):
        if submap.poses:
            levels.take(submap.surfaces, pose)
    return levels


def _places(tracker: Tracker) -> Float[np.ndarray, "k 2"]:
    """Places (x, y) [m] near the trajectory."""
    cells = np.unique(np.round(tracker.poses()[:, :2] / _STEP_M).astype(int), axis=0)
    n = math.ceil(_REACH_M / _STEP_M)
    disc = np.stack(np.meshgrid(np.arange(-n, n + 1), np.arange(-n, n + 1)), axis=-1).reshape(-1, 2)
    disc = disc[np.hypot(*disc.T) <= n]
    return _STEP_M * np.unique((cells[:, None] + disc).reshape(-1, 2), axis=0)


def _middles(poses: Sequence[Float[np.ndarray, "3"]], submaps: Sequence[Submap]) -> Float[np.ndarray, "n 2"]:
    """Middle (x, y) [m] of each submap; infinite for one without scans."""
    return np.array(
        [
            to_map(pose, np.array(submap.circle()[:2])) if submap.poses else np.full(2, np.inf)
            for pose, submap in zip(poses, submaps, strict=True)
        ]
    )
