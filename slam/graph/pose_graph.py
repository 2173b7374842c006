"""A graph of poses and sighted places, with measurements between them.

A constraint gives pose j in the frame of pose i, with a covariance; a sighting gives direction and approximate distance
of a place. With e_ij the difference between measurement and estimate in the frame of i, poses and places minimise

    sum_odometry e^T C^-1 e  +  sum_loops rho(e^T C^-1 e)  +  sum_sightings rho(e^2 / sigma^2)
        +  sum_stretches b^2  +  sum_places rho(a^2),

by Gauss-Newton on a sparse system. Directions on one stretch of the trajectory share an error of b standard
deviations, and distances of one place an error a, so that repeated measurements do not reduce it. Closed loops,
sightings, and all distances of a place may be wrong: rho is the kernel of Geman and McClure, which reduces the weight
of outliers. It is convex at first and gradually less so (graduated non-convexity), so that the result does not depend
on the initial values. The first pose is fixed.
References: Grisetti et al., A tutorial on graph-based SLAM, IEEE Intelligent Transportation Systems Magazine 2 (2010);
Yang et al., Graduated non-convexity for robust spatial perception, IEEE Robotics and Automation Letters 5 (2020).
"""

from copy import deepcopy
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from slam.graph.least_squares import Constraint, Sighting, State, System
from slam.poses import between, compose, rotation, to_map

#: By how much the kernel is made less convex in each round, and how convex it is at first at most.
_STEP, _MOST_CONVEX = 1.6, 100.0
#: Steps with the same weights, and at most; rounds in which the last weights settle.
_FEW_STEPS, _MOST_STEPS, _SETTLING = 2, 30, 3
#: Constraints of more weight are believed.
_BELIEVED = 0.5
#: Distance at which a turn moves points as far as a shift does, for comparing variances of both [m].
_ARM_M = 3.0


class PoseGraph:
    """Poses and places in `map`, and what was measured between them."""

    def __init__(self, first: Float[np.ndarray, "3"]) -> None:
        """Begin with a pose that stands still: x [m], y [m], yaw [rad]."""
        self.poses: list[Float[np.ndarray, 3]] = [np.asarray(first, float)]
        self.constraints: list[Constraint] = []
        self.weights: list[float] = []
        """How far each constraint is believed, 0 to 1."""
        self.places: list[Float[np.ndarray, 2]] = []
        self.sightings: list[Sighting] = []
        self._known: list[bool] = []
        self._shared = np.zeros(0)
        self._scales = np.zeros(0)
        self._seen_weights, self._scale_weights = np.ones((2, 0)), np.ones(0)
        self._uncertain: dict[int, Float[np.ndarray, "n 3 3"]] = {}

    def add(self, pose: Float[np.ndarray, "3"]) -> int:
        """Add a pose, which something has to hold; its number."""
        self.poses.append(np.asarray(pose, float))
        self._uncertain.clear()
        return len(self.poses) - 1

    def add_place(self, xy: Float[np.ndarray, "2"], *, known: bool = False) -> int:
        """Add a place [m], which sightings have to hold unless it is known; its number."""
        self.places.append(np.asarray(xy, float))
        self._known.append(known)
        return len(self.places) - 1

    def hold(self, constraint: Constraint) -> None:
        """Add a constraint."""
        self.constraints.append(constraint)
        self.weights.append(1.0)
        self._uncertain.clear()

    def transformed(self, by: Float[np.ndarray, "3"]) -> "PoseGraph":
        """The graph in the frame in which its frame lies at a pose."""
        other = deepcopy(self)
        other.poses = [compose(by, pose) for pose in self.poses]
        other.places = [to_map(by, place) for place in self.places]
        other._uncertain = {}
        return other

    def include(self, other: "PoseGraph", at: Float[np.ndarray, "3"]) -> int:
        """Add all poses, places and measurements of another graph, whose frame lies at a pose.

        Places that are known in the other's frame have to be held by their sightings in this one.

        Returns:
            The number of the other's first pose here; the others follow.
        """
        first, n_places = len(self.poses), len(self.places)
        n_stretches = 1 + max((sighting.stretch for sighting in self.sightings), default=-1)
        self.poses += [compose(at, pose) for pose in other.poses]
        self.constraints += [
            replace(c, first=c.first + first, second=c.second + first) for c in other.constraints
        ]
        self.weights += other.weights
        self.places += [to_map(at, place) for place in other.places]
        self._known += [False] * len(other.places)
        self.sightings += [
            replace(
                s,
                pose=s.pose + first,
                place=s.place + n_places,
                beyond=None if s.beyond is None else s.beyond + n_places,
                stretch=s.stretch + n_stretches,
            )
            for s in other.sightings
        ]
        self._uncertain.clear()
        return first

    def forget_loop(self, first: int, second: int) -> None:
        """Remove loops between two poses."""
        others = [
            k
            for k, c in enumerate(self.constraints)
            if not (c.loop and {c.first, c.second} == {first, second})
        ]
        self.constraints = [self.constraints[k] for k in others]
        self.weights = [self.weights[k] for k in others]
        self._uncertain.clear()

    def merge(self, pose: int, other: int) -> Float[np.ndarray, "3"]:
        """Remove a pose, which stays where it is relative to another. Numbers of later poses decrease by one.

        Its measurements now count for the other pose, with the covariance between both in addition. Two poses keep
        one displacement by odometry, the most certain, and get no loop if they have a constraint, so that places
        visited again add no constraints.
        Reference: Johannsson et al., Temporally scalable visual SLAM using a reduced pose graph, ICRA 2013.

        Returns:
            The removed pose in the frame of the other: x [m], y [m], yaw [rad].
        """
        at = between(self.poses[other], self.poses[pose])
        back, ahead, behind = (
            between(at, np.zeros(3)),
            self.uncertainty(other)[pose],
            self.uncertainty(pose)[other],
        )
        rest, transferred = [], []
        for c, weight in zip(self.constraints, self.weights, strict=True):
            if pose not in (c.first, c.second):
                rest.append((c, weight))
            elif other in (c.first, c.second):
                continue
            elif c.first == pose:
                spread = chained(at, ahead, c.pose, c.covariance)
                transferred.append(
                    (replace(c, first=other, pose=compose(at, c.pose), covariance=spread), weight)
                )
            else:
                spread = chained(c.pose, c.covariance, back, behind)
                transferred.append(
                    (replace(c, second=other, pose=compose(c.pose, back), covariance=spread), weight)
                )
        for c, weight in transferred:
            same = [k for k, (o, _) in enumerate(rest) if {o.first, o.second} == {c.first, c.second}]
            alike = [k for k in same if not rest[k][0].loop]
            if (c.loop and not same and weight > _BELIEVED) or not (c.loop or alike):
                rest.append((c, weight))
            elif not c.loop and _size(c.covariance) < _size(rest[alike[0]][0].covariance):
                rest[alike[0]] = c, weight
        self.constraints = [
            replace(c, first=c.first - (c.first > pose), second=c.second - (c.second > pose)) for c, _ in rest
        ]
        self.weights = [weight for _, weight in rest]
        self.sightings = [
            replace(s, pose=other - (other > pose), at=compose(at, s.at))
            if s.pose == pose
            else replace(s, pose=s.pose - (s.pose > pose))
            for s in self.sightings
        ]
        del self.poses[pose]
        self._uncertain.clear()
        return at

    def believed(self) -> list[Constraint]:
        """Constraints that are believed more than half."""
        return [c for c, weight in zip(self.constraints, self.weights, strict=True) if weight > _BELIEVED]

    def see(self, sighting: Sighting) -> None:
        """Add a sighting of a place."""
        self.sightings.append(sighting)

    def solve(self) -> float:
        """Find the poses and places that fit best; returns how far the pose that moved most has moved [m]."""
        if len(self.poses) < 2 or not self.constraints:
            return 0.0
        before = np.array(self.poses)
        system = self._system()
        # Constraints that were rejected before remain so, unless the poses themselves change its weight.
        seen = np.pad(
            self._seen_weights,
            ((0, 0), (0, len(self.sightings) - self._seen_weights.shape[1])),
            constant_values=1.0,
        )
        alike = np.pad(
            self._scale_weights, (0, len(self.places) - len(self._scale_weights)), constant_values=1.0
        )
        believed = np.concatenate([self.weights, seen.ravel(), alike]) > _BELIEVED
        state, convex = system.state, min(2 * system.worst(system.state, believed), _MOST_CONVEX)
        while convex > 1.0:
            state = system.minimised(state, system.weighed(state, convex), _FEW_STEPS)
            convex /= _STEP
        state = system.minimised(state, system.weighed(state), _MOST_STEPS)
        for _ in range(_SETTLING if system.doubtful.any() else 0):
            state = system.minimised(state, system.weighed(state), _FEW_STEPS)
        bounds = np.cumsum([len(self.constraints), 2 * len(self.sightings)])
        weights, seen, self._scale_weights = np.split(system.weighed(state), bounds)
        self.weights, self._seen_weights = weights.tolist(), seen.reshape(2, -1)
        self.poses = list(state.poses)
        self.places = list(state.places)
        self._shared, self._scales = state.shared, state.scales
        self._uncertain.clear()
        return float(np.hypot(*(state.poses - before)[:, :2].T).max())

    def place_covariance(self, place: int) -> Float[np.ndarray, "2 2"]:
        """How well a place is known in `map` [m^2], all that is believed taken together."""
        system = self._system()
        return system.place_covariance(system.weighed(system.state), place)

    def _system(self) -> System:
        poses, places = np.array(self.poses), np.array(self.places).reshape(-1, 2)
        stretches = 1 + max((sighting.stretch for sighting in self.sightings), default=-1)
        shared = np.concatenate([self._shared, np.zeros(stretches - len(self._shared))])
        scales = np.concatenate([self._scales, np.zeros(len(places) - len(self._scales))])
        state = State(poses, places, shared, scales)
        return System(state, self.constraints, self.sightings, np.array(self._known, bool))

    def uncertainty(self, start: int) -> Float[np.ndarray, "n 3 3"]:
        """Covariance of each pose in the frame of the pose `start`, at most.

        Along the chain of constraints whose variances add up to least: what else holds the poses makes it smaller.
        Loops that are hardly believed hold nothing.
        """
        if start in self._uncertain:
            return self._uncertain[start]
        poses, n = np.array(self.poses), len(self.poses)
        held = [c for c, weight in zip(self.constraints, self.weights, strict=True) if weight > _BELIEVED]
        first, second = np.array([(c.first, c.second) for c in held], int).reshape(-1, 2).T
        covariance = np.array([c.covariance for c in held]).reshape(-1, 3, 3)
        size = _size(covariance)
        _, before = dijkstra(
            csr_matrix((size, (first, second)), shape=(n, n)),
            directed=False,
            indices=start,
            return_predecessors=True,
        )
        # Errors as motions of the plane, seen where the chains begin: they add up along a chain.
        shift = _lever(poses[start, :2] - poses[second, :2]) @ _turned(poses[first, 2])
        motion = shift @ covariance @ shift.transpose(0, 2, 1)
        is_linked = before >= 0
        node = np.flatnonzero(is_linked)
        keys = np.minimum(first, second) * n + np.maximum(first, second)
        order = np.argsort(keys)
        wanted = np.minimum(node, before[node]) * n + np.maximum(node, before[node])
        total = np.zeros((n, 3, 3))
        total[node] = motion[order[np.searchsorted(keys[order], wanted)]]
        before = np.where(is_linked, before, start)
        while (before != start).any():
            total += total[before]
            before = before[before]
        back = rotation(-poses[start, 2]) @ _lever(poses[:, :2] - poses[start, :2])
        relative = back @ total @ back.transpose(0, 2, 1)
        self._uncertain[start] = relative
        return relative


def chained(
    pose: Float[np.ndarray, "3"],
    covariance: Float[np.ndarray, "3 3"],
    step: Float[np.ndarray, "3"],
    step_covariance: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "3 3"]:
    """Covariance of a pose and a step from it, both uncertain, in the frame of the pose's coordinates."""
    turn = rotation(pose[2])
    turned_step = turn[:2, :2] @ step[:2]
    lever = np.array([[1.0, 0.0, -turned_step[1]], [0.0, 1.0, turned_step[0]], [0.0, 0.0, 1.0]])
    return np.asarray(lever @ covariance @ lever.T + turn @ step_covariance @ turn.T)


def _size(covariance: Float[np.ndarray, "*n 3 3"]) -> Float[np.ndarray, "*n"]:
    """Variance of shifts and of a turn together [m^2]."""
    size = covariance[..., 0, 0] + covariance[..., 1, 1] + _ARM_M**2 * covariance[..., 2, 2]
    return np.asarray(size)


def _lever(away: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3 3"]:
    """Motion of a plane at one point to that at another: x, y [m], turn [rad]."""
    lever = np.tile(np.eye(3), (len(away), 1, 1))
    lever[:, 0, 2], lever[:, 1, 2] = -away[:, 1], away[:, 0]
    return lever


def _turned(yaw_rad: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3 3"]:
    """Rotations of the plane."""
    c, s, n = np.cos(yaw_rad), np.sin(yaw_rad), len(yaw_rad)
    turned = np.zeros((n, 3, 3))
    turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 0], turned[:, 1, 1], turned[:, 2, 2] = c, -s, s, c, 1.0
    return turned
