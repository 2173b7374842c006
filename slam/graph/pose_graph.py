"""A graph of poses and of what was measured between them, and the poses that fit all measurements best.

A constraint says where pose j lies in the frame of pose i, with a covariance. With e_ij the difference between that and
what the poses say, in the frame of i, the poses minimise

    sum_odometry e^T C^-1 e  +  sum_loops rho(e^T C^-1 e),

by Gauss-Newton on a sparse system. Closed loops may be wrong: rho is Geman and McClure's kernel, under which a wrong
one loses its weight, made convex at first and less and less so (graduated non-convexity), so that what is right does
not depend on where the solver starts. The first pose stands still.
References: Grisetti et al., A tutorial on graph-based SLAM, IEEE Intelligent Transportation Systems Magazine 2 (2010);
Yang et al., Graduated non-convexity for robust spatial perception, IEEE Robotics and Automation Letters 5 (2020).
"""

import heapq
import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from slam.poses import between, rotation

#: Squared error, in variances, at which a loop begins to lose its weight: 99.9 % of a right one's are below (chi
#: square, three degrees of freedom).
_TRUSTED = 16.27
#: By how much the kernel is made less convex in each round.
_STEP = 1.6
#: Steps with the same weights, and at most.
_FEW_STEPS, _MOST_STEPS = 2, 30
#: The solver stops when no pose moves by more [m, rad].
_STILL = 1e-5


@dataclass(frozen=True, kw_only=True, eq=False)
class Constraint:
    """Where one pose lies in the frame of another."""

    first: int
    """Whose frame it is."""
    second: int
    """Whose pose it is."""
    pose: Float[np.ndarray, "3"]
    """x [m], y [m], yaw [rad]."""
    covariance: Float[np.ndarray, "3 3"]
    """Of the pose, in the frame of `first` [m^2, m rad, rad^2]."""
    loop: bool = False
    """Whether it may be wrong altogether."""


class PoseGraph:
    """Poses in `map`, and constraints between them."""

    def __init__(self, first: Float[np.ndarray, "3"]) -> None:
        """Begin with a pose that stands still: x [m], y [m], yaw [rad]."""
        self.poses: list[Float[np.ndarray, 3]] = [np.asarray(first, float)]
        self.constraints: list[Constraint] = []
        self.weights: list[float] = []
        """How far each constraint is believed, 0 to 1."""

    def add(self, pose: Float[np.ndarray, "3"]) -> int:
        """Add a pose, which something has to hold; its number."""
        self.poses.append(np.asarray(pose, float))
        return len(self.poses) - 1

    def hold(self, constraint: Constraint) -> None:
        """Add a constraint."""
        self.constraints.append(constraint)
        self.weights.append(1.0)

    def solve(self) -> float:
        """Find the poses that fit best.

        Returns:
            How far the pose that moved most has moved [m].
        """
        before = np.array(self.poses)
        if len(before) < 2 or not self.constraints:
            return 0.0
        first = np.array([c.first for c in self.constraints])
        second = np.array([c.second for c in self.constraints])
        measured = np.array([c.pose for c in self.constraints])
        information = np.linalg.inv(np.array([c.covariance for c in self.constraints]))
        loop = np.array([c.loop for c in self.constraints])
        weights = np.ones(len(loop))
        poses, convex = before, 0.0
        while loop.any() and convex != 1.0:
            squares = _squares(poses, first, second, measured, information)[loop]
            convex = max(1.0, convex / _STEP if convex else 2 * float(squares.max()) / _TRUSTED)
            # The weights of Geman and McClure's kernel.
            weights[loop] = (convex * _TRUSTED / (squares + convex * _TRUSTED)) ** 2
            poses = _minimised(poses, first, second, measured, information, weights, _FEW_STEPS)
        poses = _minimised(poses, first, second, measured, information, weights, _MOST_STEPS)
        self.weights = weights.tolist()
        self.poses = list(poses)
        return float(np.hypot(*(poses - before)[:, :2].T).max())

    def uncertainty(self, start: int) -> dict[int, Float[np.ndarray, "3 3"]]:
        """Covariance of each pose in the frame of one of them, at most.

        Along the chain of constraints whose covariances add up to least: what else holds the poses makes it smaller.
        Loops that are hardly believed hold nothing.

        Args:
            start: The pose in whose frame.
        """
        neighbours: dict[int, list[tuple[int, Constraint]]] = defaultdict(list)
        for constraint, weight in zip(self.constraints, self.weights, strict=True):
            if weight > 0.5:
                neighbours[constraint.first].append((constraint.second, constraint))
                neighbours[constraint.second].append((constraint.first, constraint))
        found: dict[int, Float[np.ndarray, "3 3"]] = {}
        queue: list[tuple[float, int, Float[np.ndarray, "3 3"]]] = [(0.0, start, np.zeros((3, 3)))]
        while queue:
            _, node, covariance = heapq.heappop(queue)
            if node in found:
                continue
            found[node] = covariance
            here = between(self.poses[start], self.poses[node])
            for other, constraint in neighbours[node]:
                if other in found:
                    continue
                step = between(self.poses[node], self.poses[other])
                own = constraint.covariance
                if constraint.first != node:  # known in the other's frame
                    own = _inverted(constraint.pose, own)
                further = chained(here, covariance, step, own)
                size = math.sqrt(further[0, 0] + further[1, 1]) + 2 * math.sqrt(further[2, 2])
                heapq.heappush(queue, (size, other, further))
        return found


def chained(
    pose: Float[np.ndarray, "3"],
    covariance: Float[np.ndarray, "3 3"],
    step: Float[np.ndarray, "3"],
    step_covariance: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "3 3"]:
    """Covariance of a pose and a step from it, both uncertain, in the frame that the pose is told in."""
    turn = rotation(pose[2])
    moved = turn[:2, :2] @ step[:2]
    lever = np.array([[1.0, 0.0, -moved[1]], [0.0, 1.0, moved[0]], [0.0, 0.0, 1.0]])
    return np.asarray(lever @ covariance @ lever.T + turn @ step_covariance @ turn.T)


def _inverted(pose: Float[np.ndarray, "3"], covariance: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Covariance of the inverse of a displacement, in the frame at its end."""
    turn = rotation(pose[2]).T
    back = turn[:2, :2] @ pose[:2]
    lever = np.array([[1.0, 0.0, back[1]], [0.0, 1.0, -back[0]], [0.0, 0.0, 1.0]])
    return np.asarray(lever @ turn @ covariance @ turn.T @ lever.T)


def _squares(
    poses: Float[np.ndarray, "n 3"],
    first: np.ndarray,
    second: np.ndarray,
    measured: Float[np.ndarray, "m 3"],
    information: Float[np.ndarray, "m 3 3"],
) -> Float[np.ndarray, " m"]:
    """Squared error of each constraint, in variances."""
    error, _ = _errors(poses, first, second, measured)
    return np.asarray(np.einsum("mi,mij,mj->m", error, information, error))


def _errors(
    poses: Float[np.ndarray, "n 3"], first: np.ndarray, second: np.ndarray, measured: Float[np.ndarray, "m 3"]
) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "m 3 6"]]:
    """Errors in the frame of the first pose, and their derivatives by the first and the second pose."""
    yaw = poses[first, 2]
    c, s = np.cos(yaw), np.sin(yaw)
    dx, dy = (poses[second, :2] - poses[first, :2]).T
    ahead, left = c * dx + s * dy, c * dy - s * dx
    turn = poses[second, 2] - yaw - measured[:, 2]
    turn = (turn + math.pi) % (2 * math.pi) - math.pi
    error = np.column_stack([ahead - measured[:, 0], left - measured[:, 1], turn])
    derivative = np.zeros((len(first), 3, 6))
    derivative[:, 0, 0], derivative[:, 0, 1], derivative[:, 0, 2] = -c, -s, left
    derivative[:, 1, 0], derivative[:, 1, 1], derivative[:, 1, 2] = s, -c, -ahead
    derivative[:, 2, 2], derivative[:, 2, 5] = -1, 1
    derivative[:, 0, 3], derivative[:, 0, 4] = c, s
    derivative[:, 1, 3], derivative[:, 1, 4] = -s, c
    return error, derivative


def _minimised(
    poses: Float[np.ndarray, "n 3"],
    first: np.ndarray,
    second: np.ndarray,
    measured: Float[np.ndarray, "m 3"],
    information: Float[np.ndarray, "m 3 3"],
    weights: Float[np.ndarray, " m"],
    steps: int,
) -> Float[np.ndarray, "n 3"]:
    """The poses after Gauss-Newton with fixed weights; the first stands still."""
    weighted = information * weights[:, None, None]
    columns = np.concatenate([3 * first[:, None] + np.arange(3), 3 * second[:, None] + np.arange(3)], axis=1)
    rows = np.repeat(columns, 6, axis=1).ravel()
    across = np.tile(columns, (1, 6)).ravel()
    size = 3 * len(poses)
    for _ in range(steps):
        error, derivative = _errors(poses, first, second, measured)
        projected = np.einsum("mia,mij->maj", derivative, weighted)
        blocks = np.einsum("maj,mjb->mab", projected, derivative)
        gradient = np.zeros(size)
        np.add.at(gradient, columns.ravel(), np.einsum("maj,mj->ma", projected, error).ravel())
        hessian = csc_matrix((blocks.ravel(), (rows, across)), shape=(size, size))[3:, 3:]
        step = splu(hessian).solve(-gradient[3:]).reshape(-1, 3)
        poses = poses.copy()
        poses[1:] += step
        if np.abs(step).max() < _STILL:
            break
    poses[:, 2] = (poses[:, 2] + math.pi) % (2 * math.pi) - math.pi
    return poses
