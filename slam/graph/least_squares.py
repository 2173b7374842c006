"""Least squares of poses and sighted places: measurements, their errors and derivatives, Gauss-Newton steps.

A constraint gives pose j in the frame of pose i, with a covariance; a sighting gives direction and approximate distance
of a place. `slam.graph.pose_graph` says what is minimised.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import SuperLU, splu

from slam.poses import wrap

#: Squared error, in variances, at which a loop, or a number of a sighting, begins to lose its weight: 99.9 % of right
#: ones are below (chi square of three degrees of freedom, and of one).
_TRUSTED, _TRUSTED_ONE = 16.27, 10.83
#: Least weight of the scale that distances share: without information it stays unchanged.
_LEAST = 1e-6
#: The solver stops when no pose moves by more [m, rad].
_STILL = 1e-4
#: A place moves in one step by no more than this part of its distance from where it was seen: beyond, bearings are
#: not linear.
_PLACE_STEP = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Constraint:
    """Where one pose lies in the frame of another."""

    first: int
    """Number of the pose whose frame it is."""
    second: int
    """Number of the pose that is constrained."""
    pose: Float[np.ndarray, "3"]
    """x [m], y [m], yaw [rad]."""
    covariance: Float[np.ndarray, "3 3"]
    """Covariance of the pose, in the frame of `first` [m^2, m rad, rad^2]."""
    loop: bool = False
    """Whether it may be wrong altogether."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sighting:
    """A place, as it appeared from a pose of the graph."""

    pose: int
    """Number of the pose whose frame `at` is in."""
    at: Float[np.ndarray, "3"]
    """Where it was seen from: x [m], y [m], yaw [rad]."""
    place: int
    """Which place."""
    bearing_rad: float
    """Direction, from `at` [rad]."""
    sigma_rad: float
    """Standard deviation of that [rad], `shared_rad` apart."""
    range_m: float
    """Distance [m]; with `beyond`, how much larger it is than that of the other place."""
    sigma_range: float
    """Standard deviation of the distance's natural logarithm; with `beyond`, of the difference [m]."""
    beyond: int | None = None
    """The place whose distance is compared, if one is."""
    stretch: int = 0
    """Number of the stretch of the trajectory on which directions share an error."""
    shared_rad: float = 0.0
    """Standard deviation of the error that directions on that stretch have in common [rad]."""
    shared_range: float = 0.0
    """Standard deviation of the error that all distances of the place have in common (natural logarithm), unless they
    are wrong altogether."""


class State(NamedTuple):
    """Poses and places in `map`, and what errors of directions and distances have in common."""

    poses: Float[np.ndarray, "n 3"]
    places: Float[np.ndarray, "m 2"]
    shared: Float[np.ndarray, " g"]
    """Errors of directions on stretches, in standard deviations."""
    scales: Float[np.ndarray, " m"]
    """Errors of distances of places, in standard deviations."""


class System:
    """All measurements as arrays: constraints, sightings' bearings and distances, what distances have in common."""

    def __init__(
        self,
        state: State,
        constraints: Sequence[Constraint],
        sightings: Sequence[Sighting],
        known: Bool[np.ndarray, " m"],
    ) -> None:
        self.state = state
        self._first = np.array([c.first for c in constraints], int)
        self._second = np.array([c.second for c in constraints], int)
        self._measured = np.array([c.pose for c in constraints]).reshape(-1, 3)
        self._information = np.linalg.inv(np.array([c.covariance for c in constraints]).reshape(-1, 3, 3))
        self._from = np.array([s.pose for s in sightings], int)
        self._at = np.array([s.at for s in sightings]).reshape(-1, 3)
        self._place = np.array([s.place for s in sightings], int)
        self._bearing = np.array([s.bearing_rad for s in sightings])
        # Where nothing is compared, the other place is the same one.
        self._other = np.array([s.place if s.beyond is None else s.beyond for s in sightings], int)
        self._alone = np.array([s.beyond is None for s in sightings], bool)
        self._range = np.array([s.range_m for s in sightings])
        self._sigma = np.array([(s.sigma_rad, s.sigma_range) for s in sightings]).reshape(-1, 2)
        self._stretch = np.array([s.stretch for s in sightings], int)
        self._shared = np.array([(s.shared_rad, s.shared_range) for s in sightings]).reshape(-1, 2)
        loops, ones = [c.loop for c in constraints], 2 * len(sightings) + len(known)
        self.doubtful = np.array([*loops, *[True] * ones])
        """Which may be wrong altogether."""
        # Squared error, in variances, at which each begins to lose its weight.
        self._trusted = np.array([_TRUSTED] * len(loops) + [_TRUSTED_ONE] * ones)
        count = 3 * len(state.poses)
        alike = np.ones(len(state.shared) + len(known), bool)
        self._free = np.concatenate([np.arange(count) > 2, np.repeat(~known, 2), alike])
        self._priors = np.arange(len(self._free) - len(alike), len(self._free))
        blocks = [3 * self._first[:, None] + np.arange(3), 3 * self._second[:, None] + np.arange(3)]
        self._columns = np.concatenate(blocks, axis=1)
        seen = [3 * self._from[:, None] + np.arange(3)]
        seen += [count + 2 * place[:, None] + np.arange(2) for place in (self._place, self._other)]
        seen += [self._priors[of][:, None] for of in (self._stretch, len(state.shared) + self._place)]
        self._seen_columns = np.concatenate(seen, axis=1)
        # Where the numbers of each measurement's block stand among those that are free.
        place = np.where(self._free, np.cumsum(self._free) - 1, -1)
        shapes = [(self._columns, 6), (self._seen_columns, 9), (self._priors[:, None], 1)]
        rows = np.concatenate([place[np.repeat(columns, n, axis=1)].ravel() for columns, n in shapes])
        across = np.concatenate([place[np.tile(columns, (1, n))].ravel() for columns, n in shapes])
        self._is_free_pair = (rows >= 0) & (across >= 0)
        # Numbers of the matrix in the order of its columns, and to which of them each number of a block adds.
        size = self.size = int(self._free.sum())
        entries, self._entry = np.unique(
            across[self._is_free_pair] * size + rows[self._is_free_pair], return_inverse=True
        )
        self._rows, self._starts = entries % size, np.searchsorted(entries, size * np.arange(size + 1))

    def weighed(self, state: State, convex: float = 1.0) -> Float[np.ndarray, " k"]:
        """Weight of each measurement under Geman and McClure's kernel, made so much more convex."""
        return np.where(self.doubtful, (convex / (self._over(state) + convex)) ** 2, 1.0)

    def worst(self, state: State, believed: Bool[np.ndarray, " k"]) -> float:
        """Largest squared error of what is believed and may be wrong, over that at which it begins to lose weight."""
        return float(self._over(state)[self.doubtful & believed].max(initial=0.0))

    def _over(self, state: State) -> Float[np.ndarray, " k"]:
        error, _ = _errors(state.poses, self._first, self._second, self._measured)
        held = np.einsum("mi,mij,mj->m", error, self._information, error)
        seen, _ = self._sighted(state)
        return np.asarray(np.concatenate([held, *(seen**2).T, state.scales**2]) / self._trusted)

    def minimised(self, state: State, weights: Float[np.ndarray, " k"], steps: int) -> State:
        """Poses and places after Gauss-Newton with fixed weights."""
        for _ in range(steps):
            hessian, gradient = self._normal(state, weights)
            step = np.zeros(len(self._free))
            step[self._free] = _factorised(hessian).solve(-gradient[self._free])
            shift = step[: state.poses.size].reshape(-1, 3)
            others = step[state.poses.size :]
            far = self._short_enough(state, others[: state.places.size].reshape(-1, 2))
            alike = others[state.places.size :]
            shared, scales = (
                state.shared + alike[: len(state.shared)],
                state.scales + alike[len(state.shared) :],
            )
            state = State(state.poses + shift, state.places + far, shared, scales)
            if max(np.abs(shift).max(), np.abs(far).max(initial=0.0)) < _STILL:
                break
        state.poses[:, 2] = wrap(state.poses[:, 2])
        return state

    def place_covariance(self, weights: Float[np.ndarray, " k"], place: int) -> Float[np.ndarray, "2 2"]:
        """Return the covariance of a place [m^2]."""
        hessian, _ = self._normal(self.state, weights)
        columns = np.zeros((len(self._free), 2))
        rows = self.state.poses.size + 2 * place + np.arange(2)
        columns[rows] = np.eye(2)
        spread = np.zeros_like(columns)
        spread[self._free] = _factorised(hessian).solve(columns[self._free])
        return np.asarray(spread[rows])

    def _normal(self, state: State, weights: Float[np.ndarray, " k"]) -> tuple[csc_matrix, np.ndarray]:
        """Hessian of what is free, and gradient of all."""
        count, sightings = len(self._first), len(self._place)
        error, derivative = _errors(state.poses, self._first, self._second, self._measured)
        weighted = self._information * weights[:count, None, None]
        projected = np.einsum("mia,mij->maj", derivative, weighted)
        blocks = np.einsum("maj,mjb->mab", projected, derivative)
        gradient = np.zeros(len(self._free))
        np.add.at(gradient, self._columns.ravel(), np.einsum("maj,mj->ma", projected, error).ravel())
        values = [blocks.ravel()]
        if sightings:
            error, derivative = self._sighted(state)
            projected = derivative * weights[count : count + 2 * sightings].reshape(2, -1).T[:, :, None]
            np.add.at(gradient, self._seen_columns.ravel(), np.einsum("mia,mi->ma", projected, error).ravel())
            values.append(np.einsum("mia,mib->mab", projected, derivative).ravel())
        prior = np.concatenate([np.ones(len(state.shared)), weights[count + 2 * sightings :] + _LEAST])
        gradient[self._priors] += prior * np.concatenate([state.shared, state.scales])
        values.append(prior)
        entries = np.bincount(self._entry, np.concatenate(values)[self._is_free_pair])
        return csc_matrix((entries, self._rows, self._starts), shape=(self.size, self.size)), gradient

    def _sighted(self, state: State) -> tuple[Float[np.ndarray, "s 2"], Float[np.ndarray, "s 2 9"]]:
        """Errors of bearings and distances, in standard deviations, and their derivatives."""
        # By pose, place, other place, and what the stretch and the place have in common.
        yaw, arm = state.poses[self._from, 2], np.column_stack(self._arm(state))
        seen_from = state.poses[self._from, :2] + arm
        away, square, gap = _gaps(state.places[self._place] - seen_from)
        other, _, other_gap = _gaps(state.places[self._other] - seen_from)
        turn = wrap(np.arctan2(away[:, 1], away[:, 0]) - yaw - self._at[:, 2] - self._bearing)
        turn += self._shared[:, 0] * state.shared[self._stretch]
        beyond = gap - other_gap - self._range
        far = np.where(self._alone, np.log(gap / np.where(self._alone, self._range, 1.0)), beyond)
        far += self._shared[:, 1] * state.scales[self._place]
        across = np.column_stack([-away[:, 1], away[:, 0]]) / square[:, None]
        along = away / np.where(self._alone, square, gap)[:, None]
        along_other = np.where(self._alone[:, None], 0.0, -other / other_gap[:, None])
        derivative = np.zeros((len(gap), 2, 9))
        derivative[:, 0, 7], derivative[:, 1, 8] = self._shared.T
        for k, (place, opposite) in enumerate(((across, 0.0 * across), (along, along_other))):
            both = place + opposite
            derivative[:, k, :2] = -both
            # Turning the frame moves the point that was seen from.
            derivative[:, k, 2] = both[:, 0] * arm[:, 1] - both[:, 1] * arm[:, 0] - (k == 0)
            derivative[:, k, 3:5], derivative[:, k, 5:7] = place, opposite
        return np.column_stack([turn, far]) / self._sigma, derivative / self._sigma[:, :, None]

    def _arm(self, state: State) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
        """From the pose to the point that was seen from, axes of `map` [m]."""
        c, s = np.cos(state.poses[self._from, 2]), np.sin(state.poses[self._from, 2])
        x, y = self._at[:, 0], self._at[:, 1]
        return c * x - s * y, s * x + c * y

    def _short_enough(self, state: State, step: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m 2"]:
        """A step of the places that leaves bearings nearly linear."""
        if not len(step):
            return step
        seen_from = state.poses[self._from, :2] + np.column_stack(self._arm(state))
        gap = np.hypot(*(state.places[self._place] - seen_from).T)
        nearest = np.full(len(step), np.inf)
        np.minimum.at(nearest, self._place, np.maximum(gap, 0.1))
        length = np.hypot(*step.T)
        return np.asarray(step * np.minimum(1.0, _PLACE_STEP * nearest / np.maximum(length, 1e-12))[:, None])


def _factorised(hessian: csc_matrix) -> SuperLU:
    """Return the factorisation of a symmetric, positive definite matrix."""
    return splu(hessian, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _gaps(
    away: Float[np.ndarray, "s 2"],
) -> tuple[Float[np.ndarray, "s 2"], Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
    """Differences of places, and the squares of their lengths and these, never quite zero."""
    square = np.maximum((away**2).sum(axis=1), 1e-6)
    return away, square, np.sqrt(square)


def _errors(
    poses: Float[np.ndarray, "n 3"], first: np.ndarray, second: np.ndarray, measured: Float[np.ndarray, "m 3"]
) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "m 3 6"]]:
    """Errors in the frame of the first pose, and their derivatives by the first and the second pose."""
    yaw = poses[first, 2]
    c, s = np.cos(yaw), np.sin(yaw)
    dx, dy = (poses[second, :2] - poses[first, :2]).T
    ahead, left = c * dx + s * dy, c * dy - s * dx
    turn = wrap(poses[second, 2] - yaw - measured[:, 2])
    error = np.column_stack([ahead - measured[:, 0], left - measured[:, 1], turn])
    derivative = np.zeros((len(first), 3, 6))
    derivative[:, 0, 0], derivative[:, 0, 1], derivative[:, 0, 2] = -c, -s, left
    derivative[:, 1, 0], derivative[:, 1, 1], derivative[:, 1, 2] = s, -c, -ahead
    derivative[:, 2, 2], derivative[:, 2, 5] = -1, 1
    derivative[:, 0, 3], derivative[:, 0, 4] = c, s
    derivative[:, 1, 3], derivative[:, 1, 4] = -s, c
    return error, derivative
