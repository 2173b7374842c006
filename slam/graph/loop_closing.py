"""Loops: closed submaps fitted to others that may show the same place.

A fit becomes a constraint of the graph. If odometry is so uncertain that the other submap must be searched for, the fit
counts only once more fits of neighbours confirm it than contradict it.
References: Hess et al., Real-time loop closure in 2D lidar SLAM, ICRA 2016; Mangelson et al., Pairwise consistent
measurement set maximization for robust multi-robot map merging, ICRA 2018 (fits that confirm each other).
"""

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from slam.graph.least_squares import Constraint
from slam.graph.pose_graph import PoseGraph, chained
from slam.graph.submaps import Fit, Submap, fit
from slam.graph.tracker_config import TrackerConfig
from slam.matching.levels import difference
from slam.poses import between, compose

#: A fit needs no confirmation if odometry is uncertain by no more than this [m, rad].
_SURE_M, _SURE_RAD = 0.25, math.radians(3.0)
#: Squared difference, in variances, up to which two fits agree.
_SAME = 16.27
#: Largest difference between numbers of submaps whose fits may confirm each other.
_NEAR = 6
#: Most fits per submap with neighbours that are not known to fit, and with those that are.
_TRIES, _TRIES_OF_FITTING = 6, 3
#: Loops after which a submap needs no more with what is known to fit.
_ENOUGH = 6
#: Most fits that are remembered for confirmation.
_REMEMBERED = 100
#: A fit that is compared to no better than this neither confirms nor contradicts another [m].
_OPEN_M = 1.0
#: Most waiting fits.
_WAITING = 24
#: Most passes over all submaps at the end.
_ROUNDS = 3
#: Deviation of closed loops at the end of a log, when poses are known well, beyond which the graph is optimised [m].
_UNSOLVED_AT_END_M = 0.2


class Pending(NamedTuple):
    """A fit that waits for confirmation."""

    here: int
    there: int
    fit: Fit
    is_likely: bool
    """Whether odometry makes it likely; if not, it can only contradict others."""


class LoopCloser:
    """Tries pairs of submaps, one at a time."""

    def __init__(self, config: TrackerConfig, graph: PoseGraph, submaps: list[Submap]) -> None:
        """Close loops of a graph whose poses are those of submaps; both grow."""
        self.queue: list[tuple[int, int]] = []
        """Pairs of submaps to be fitted."""
        self.pending: list[Pending] = []
        """Fits that wait for confirmation."""
        self._config, self._graph, self._submaps = config, graph, submaps
        self._fitted = submaps[0]

    def add(self, here: int) -> None:
        """Queue pairs of a closed submap, before the others."""
        self.queue = [*self.candidates(here), *self.queue][:_WAITING]

    def remove(self, number: int) -> None:
        """Forget a submap that was merged: later ones move up."""
        self.queue = [
            (here - (here > number), there - (there > number))
            for here, there in self.queue
            if number not in (here, there)
        ]
        self.pending = [
            loop._replace(here=loop.here - (loop.here > number), there=loop.there - (loop.there > number))
            for loop in self.pending
            if number not in (loop.here, loop.there)
        ]

    def pack(self, submap: Submap) -> None:
        """Free memory of a submap whose scans do not judge new ones."""
        if submap not in self._submaps[-2:]:
            submap.pack()

    def candidates(self, here: int) -> list[tuple[int, int]]:
        """Submaps that may overlap with a closed one, the most likely first."""
        uncertain = self._graph.uncertainty(here)[: max(here - 1, 0)]
        poses = np.array(self._graph.poses[: here + 1])
        circles = np.array([submap.circle() for submap in self._submaps[: here + 1]])
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x, y, radius_m = circles.T
        middle = poses[:, :2] + np.column_stack([c * x - s * y, s * x + c * y])
        gap_m = np.hypot(*(middle[: len(uncertain)] - middle[here]).T)
        open_m = 3 * np.sqrt(uncertain[:, 0, 0] + uncertain[:, 1, 1])
        is_near = gap_m - open_m < 0.7 * (radius_m[: len(uncertain)] + radius_m[here])
        fits = self.together(uncertain)
        pairs = []
        for mask, tries in ((~fits, _TRIES), (fits, _TRIES_OF_FITTING)):
            near = np.flatnonzero(is_near & mask)
            pairs += [(here, int(there)) for there in near[np.argsort(gap_m[near], kind="stable")[:tries]]]
        return pairs

    def together(self, spread: Float[np.ndarray, "n 3 3"]) -> Bool[np.ndarray, " n"]:
        """Which submaps are known to fit another, by the covariance between them."""
        wide = np.hypot(spread[:, 0, 0], spread[:, 1, 1]) > self._config.together_m**2
        return ~wide & (spread[:, 2, 2] < self._config.together_rad**2)

    def try_next(self) -> float:
        """Fit one pair of submaps; by how much a loop that is closed deviates from the poses [m]."""
        here, there = self.queue.pop(0)
        if self._submaps[here].poses and self._submaps[there].poses:
            return self._fit(here, there)
        return 0.0

    @property
    def closed(self) -> int:
        """Number of closed loops."""
        return sum(constraint.loop for constraint in self._graph.constraints)

    def fit_again(
        self,
        solve: Callable[[], object],
        unsolved_m: float = 0.0,
        watched: Callable[[range], Iterable[int]] = iter,
    ) -> None:
        """Fit submaps that are near by the present poses, until a pass over all of them closes no loop.

        Args:
            solve: Optimises the graph.
            unsolved_m: Deviation of loops closed since the graph was optimised [m].
            watched: Progress display: iterates over numbers of submaps.
        """
        for _ in range(_ROUNDS):
            closed = self.closed
            for here in watched(range(2, len(self._submaps))):
                believed = [
                    {c.first, c.second}
                    for c in self._graph.believed()
                    if c.loop and here in (c.first, c.second)
                ]
                self.queue = [pair for pair in self.candidates(here) if set(pair) not in believed]
                while self.queue:
                    unsolved_m += self.try_next()
                if unsolved_m > _UNSOLVED_AT_END_M:
                    solve()
                    unsolved_m = 0.0
            if unsolved_m > 0:
                solve()
                unsolved_m = 0.0
            if self.closed == closed:
                break

    def _fit(self, here: int, there: int) -> float:
        """Fit two submaps; by how much a loop that is closed deviates from the poses [m], a radian as a metre.

        A loop that had to be searched for deviates by any amount.
        """
        covariance = self._graph.uncertainty(here)[there]
        if self._submaps[here].loops >= _ENOUGH and self.together(covariance[None])[0]:
            return 0.0
        predicted = between(self._graph.poses[here], self._graph.poses[there])
        submaps, config = (self._submaps[there], self._submaps[here]), self._config
        alignment = fit(*submaps, predicted, covariance, config.match, config.submap_error)
        if self._submaps[here] is not self._fitted:
            self.pack(self._fitted)
            self._fitted = self._submaps[here]
        deviation = np.sqrt(np.diag(covariance))
        sure = math.hypot(deviation[0], deviation[1]) < _SURE_M and deviation[2] < _SURE_RAD
        least = self._config.agreement if sure else self._config.searched_agreement
        if alignment is None or alignment.overlap < self._config.overlap or alignment.agreement < least:
            return 0.0
        away = difference(alignment.pose, predicted, 1.0)
        is_likely = bool(away @ np.linalg.solve(covariance + alignment.covariance, away) < _SAME)
        if sure and not is_likely:
            return 0.0
        new = Pending(here, there, alignment, is_likely)
        closed = [new] if sure else self.confirmed(new)
        for loop in closed:
            self._close(loop.here, loop.there, loop.fit)
        if not closed:
            return 0.0
        return float(np.linalg.norm(away)) if sure else math.inf

    def _close(self, here: int, there: int, alignment: Fit) -> None:
        self._submaps[here].loops += 1
        self._graph.forget_loop(here, there)
        self._graph.hold(
            Constraint(
                first=here, second=there, pose=alignment.pose, covariance=alignment.covariance, loop=True
            )
        )

    def confirmed(self, new: Pending) -> list[Pending]:
        """A fit that had to be searched for and those that confirm it; none if others contradict it, which then wait.

        Along a corridor with equal doors all neighbours fit, at places that contradict each other.
        """
        others = [old for old in self.pending if (old.here, old.there) != (new.here, new.there)]
        agreeing, n_against = [], 0
        for old in others:
            if self._is_near(old, new):
                away, spread = compare_fits(self._graph, old, new)
                # Fits that leave the place open, as along a corridor, agree with any by chance.
                if np.trace(spread[:2, :2]) < _OPEN_M**2:
                    is_same = away @ np.linalg.solve(spread, away) < _SAME
                    n_against += not is_same
                    agreeing += [old] if is_same and old.is_likely else []
        if new.is_likely and len(agreeing) > n_against:
            self.pending = [old for old in others if old not in agreeing]
            return [new, *agreeing]
        self.pending = [*others, new][-_REMEMBERED:]
        return []

    @staticmethod
    def _is_near(old: Pending, new: Pending) -> bool:
        """Whether two fits are of neighbours, so that one is evidence for or against the other."""
        is_same = (old.here, old.there) == (new.here, new.there)
        return not is_same and max(abs(old.here - new.here), abs(old.there - new.there)) <= _NEAR


def compare_fits(
    graph: PoseGraph, old: Pending, new: Pending
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Difference between two fits by the poses of a graph, and its covariance."""
    poses = graph.poses
    to_old, from_old = (
        between(poses[new.here], poses[old.here]),
        between(poses[old.there], poses[new.there]),
    )
    spread = graph.uncertainty(new.here)[old.here]
    spread = chained(to_old, spread, old.fit.pose, old.fit.covariance)
    chain = compose(to_old, old.fit.pose)
    spread = chained(chain, spread, from_old, graph.uncertainty(old.there)[new.there])
    chain = compose(chain, from_old)
    return difference(chain, new.fit.pose, 1.0), spread + new.fit.covariance
