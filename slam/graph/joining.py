"""Maps of several robots, or of one robot on several days, joined in one frame; relative starts are unknown.

Links between robots (`slam.graph.links`) prove nothing alone: offices, doors and corridors look alike. Two maps are
joined only where links at several places agree with each other in one relative pose, and far more do than in any
other. Where maps are laid over each other by that pose, their surfaces and free space must not contradict. Otherwise
maps stay apart.

Joined maps share a pose graph, in which loops between them close as within one map. Relative poses that robots measure
of each other by other sensors are links too.
Reference: Mangelson et al., Pairwise consistent measurement set maximization for robust multi-robot map merging, ICRA
2018.
"""

import copy
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from slam.graph.encounters import RelativePose
from slam.graph.least_squares import Constraint
from slam.graph.links import Link, find_links, middles_of, reverse_link
from slam.graph.loop_closing import LoopCloser, Pending, compare_fits
from slam.graph.pose_graph import PoseGraph, chained
from slam.graph.submaps import Fit, Submap, judge_fit, poses_of_scans
from slam.graph.tracked_map import TrackedMap
from slam.poses import between, compose, rotation

#: Squared difference, in variances, up to which two links agree, and largest deviation of a chain that compares [m].
_SAME, _VAGUE_M = 16.27, 1.0
#: Additional deviation of links that are compared, as maps bend [m^2, rad^2].
_BENT = np.diag([0.05, 0.05, 0.01]) ** 2
#: Links less than this from each other are of one place [m].
_PLACE_M = 2.0
#: Least places with links that agree, and how many times more they must be than those of any other relative pose.
_PLACES, _LEAD = 4, 2.0
#: Submaps of others, the nearest, that a submap is compared with on the joined map.
_AROUND = 3
#: Least part of surfaces seen from both maps that must not contradict.
_AGREEMENT = 0.8
#: Both for maps that are small as yet, of sensors whose errors are known: equal rooms in two wings of a building agree
#: at up to four places and in 0.95 of the surfaces, one place seen twice in 0.99.
_SMALL_PLACES, _SMALL_AGREEMENT = 2, 0.98
#: Submaps whose relative place is known no better than this do not contradict [m].
_SURE_M = 0.15


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
    agreement: float = 1.0
    """Least part, over all joins, of surfaces seen from both maps that do not contradict."""

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


def join_maps(
    trackers: Sequence[TrackedMap],
    links: Sequence[Link],
    watched: Callable[[range], Iterable[int]] = iter,
    *,
    n_places: int = _PLACES,
    least_agreement: float = _AGREEMENT,
) -> list[JoinedMap]:
    """Join the maps of robots whose relative poses follow from links; the trackers remain as they are.

    Args:
        trackers: Maps of the robots.
        links: Measurements between robots, of which any may be wrong.
        watched: Progress display: iterates over numbers of submaps.
        n_places: Least places with links that agree.
        least_agreement: Least part of surfaces seen from both maps that must not contradict.

    Returns:
        Maps with one frame each, the first that of robot 0; robots whose relative pose is not known have maps of their
        own.
    """
    maps = [_alone(robot, tracker) for robot, tracker in enumerate(trackers)]
    rejected: set[tuple[tuple[int, ...], tuple[int, ...]]] = set()
    while True:
        agreeing = {
            (k, j): agreeing_links(maps[k], maps[j], links, n_places)
            for k, j in combinations(range(len(maps)), 2)
            if (tuple(maps[k].robots), tuple(maps[j].robots)) not in rejected
        }
        best = max(agreeing, key=lambda pair: len(agreeing[pair]), default=(0, 0))
        if not agreeing.get(best):
            return maps
        base, other = maps[best[0]], maps[best[1]]
        joined = _joined(base, other, agreeing[best])
        config = max((tracker.config for tracker in trackers), key=lambda each: each.submap_error)
        LoopCloser(config, joined.graph, joined.submaps).fit_again(joined.graph.solve, watched=watched)
        joined.agreement = min(agreement(joined, base.robots), base.agreement, other.agreement)
        if joined.agreement < least_agreement:
            rejected.add((tuple(base.robots), tuple(other.robots)))
            continue
        maps[best[0]] = joined
        del maps[best[1]]


def match_maps(first: TrackedMap, second: TrackedMap) -> RelativePose | None:
    """Pose at which the second robot began, seen from where the first did; None while it does not follow."""
    maps = (first, second)
    joined = join_maps(maps, find_links(maps, 0, 1), n_places=_SMALL_PLACES, least_agreement=_SMALL_AGREEMENT)
    return relative_pose(joined, 1, 0)


def relative_pose(maps: Sequence[JoinedMap], robot: int, other: int) -> RelativePose | None:
    """Pose at which a robot began, seen from where another began, and its covariance; None while it is not known."""
    for joined in maps:
        if robot in joined.robots and other in joined.robots:
            node, origin = joined.nodes(robot).start, joined.nodes(other).start
            pose = between(joined.graph.poses[origin], joined.graph.poses[node])
            return RelativePose(pose, joined.graph.uncertainty(origin)[node])
    return None


def agreeing_links(
    base: JoinedMap, other: JoinedMap, links: Sequence[Link], least: int = _PLACES
) -> list[Pending]:
    """Links that agree in the relative pose of two maps; none if they are too few, or hardly more than for another."""
    fits = []
    for link in links:
        if link.robots[0] in base.robots and link.robots[1] in other.robots:
            fits.append(_between_submaps(base, other, link))
        elif link.robots[1] in base.robots and link.robots[0] in other.robots:
            fits.append(_between_submaps(base, other, reverse_link(link)))
    if not fits:
        return []
    graph = copy.deepcopy(base.graph)
    offset = graph.include(other.graph, np.zeros(3))
    fits = [link._replace(there=link.there + offset) for link in fits]
    agrees, contradicts = np.zeros((2, len(fits), len(fits)), bool)
    for k, j in combinations(range(len(fits)), 2):
        away, spread = compare_fits(graph, fits[k], fits[j])
        is_same = away @ np.linalg.solve(spread + _BENT, away) < _SAME
        is_known = np.trace(spread[:2, :2]) < _VAGUE_M**2
        agrees[k, j] = agrees[j, k] = is_same and is_known and fits[k][:2] != fits[j][:2]
        contradicts[k, j] = contradicts[j, k] = not is_same
    places = np.array(graph.poses)[:, :2]

    def n_places(group: list[int]) -> int:
        nodes = np.array([fits[k][:2] for k in group], int).reshape(-1, 2)
        return max(_n_apart(places[side]) for side in nodes.T)

    best = _largest_group(agrees, np.ones(len(fits), bool))
    rival = _largest_group(agrees, 2 * contradicts[:, best].sum(axis=1) > len(best))
    if n_places(best) < max(least, _LEAD * n_places(rival)):
        return []
    return [fits[k]._replace(there=fits[k].there - offset) for k in best]


def agreement(joined: JoinedMap, robots: Sequence[int]) -> float:
    """Part of the surfaces seen by submaps of robots and by those of others on a joined map that do not contradict."""
    is_mine = np.zeros(len(joined.submaps), bool)
    for robot in robots:
        is_mine[joined.nodes(robot)] = True
    has_scans = np.array([bool(submap.poses) for submap in joined.submaps])
    theirs, middles = np.flatnonzero(~is_mine & has_scans), middles_of(joined.graph.poses, joined.submaps)
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


def _between_submaps(base: JoinedMap, other: JoinedMap, link: Link) -> Pending:
    """A link as a fit between the submaps that hold its scans."""
    here, start = base.node_of(link.robots[0], link.scans[0])
    there, end = other.node_of(link.robots[1], link.scans[1])
    turn, back = rotation(start[2]), between(end, np.zeros(3))
    pose = compose(compose(start, link.pose), back)
    spread = chained(compose(start, link.pose), turn @ link.covariance @ turn.T, back, np.zeros((3, 3)))
    alignment = Fit(pose=pose, covariance=spread, overlap=0, agreement=1.0)
    return Pending(here, there, alignment, True)


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


def _alone(robot: int, tracker: TrackedMap) -> JoinedMap:
    """The map of one robot, as a copy."""
    submaps = [copy.copy(submap) for submap in tracker.submaps]
    for submap in submaps:
        submap.loops = 0
    return JoinedMap(robots=[robot], graph=copy.deepcopy(tracker.graph), submaps=submaps, first=[0])


def _joined(base: JoinedMap, other: JoinedMap, links: Sequence[Pending]) -> JoinedMap:
    """Both maps in the frame of the first, with links between them as closed loops."""
    graph, first = copy.deepcopy(base.graph), links[0]
    place = compose(base.graph.poses[first.here], first.fit.pose)
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
        robots=[*base.robots, *other.robots],
        graph=graph,
        submaps=[*base.submaps, *other.submaps],
        first=[*base.first, *(offset + k for k in other.first)],
    )
