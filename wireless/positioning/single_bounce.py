"""Where a radio is and where it looks, from paths to another whose place is known: line of sight and single bounces.

A path leaves the known end k in the direction d and comes to the other end z, whose heading theta is not known either,
from its own direction a: that is from e = (cos(theta + a), sin(theta + a)). It is L = length - offset long, as clocks
need not agree. If it has bounced once, r from k,

    z = k + r (d + e) - L e,                                                                               (1)

which for a given heading is linear in z and offset once r is projected out; in line of sight d = -e, and z follows
directly. So headings are tried one by one, few paths at a time are solved for z and offset, and what most paths agree
with is refined by least squares. Paths that agree with nothing, as after two bounces, are left out.

In the plane: heights and elevations are ignored. A path in line of sight and a single bounce, or four bounces,
determine everything; with the offset known one fewer of each.
Reference: Kaltiokallio et al., Robust snapshot radio SLAM, 2024 (arXiv:2404.10291), which solves (1) likewise.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import least_squares

from robosim.support.checks import Range, checked

#: Directions differ by less than this many standard deviations where a path counts as one in line of sight.
_STRAIGHT = 2.5
#: Sets of few paths that are solved at most for a heading, and hypotheses of the best headings that are refined.
_MOST_SETS, _REFINED = 400, 4
#: Rounds of least squares at most until the same paths agree twice.
_MORE_ROUNDS = 6
#: Paths that leave a direction open have a larger condition number.
_MOST_CONDITION = 1e10
#: Solutions of sets whose paths say nearly the same are not looked at.
_LEAST_DETERMINANT = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredPaths:
    """Paths between a radio that is looked for and others whose places are known."""

    known_xy: Float[np.ndarray, "n 2"]
    """Place of the known end of each path [m]."""
    known_rad: Float[np.ndarray, " n"]
    """Direction of the path at the known end, in `map` [rad]."""
    own_rad: Float[np.ndarray, " n"]
    """Direction of the path at the other end, in that one's own frame [rad]."""
    length_m: Float[np.ndarray, " n"]
    """Delay times the speed of light [m], with the offset of the clocks."""

    def chosen(self, which: Bool[np.ndarray, " n"] | slice) -> "MeasuredPaths":
        """Return the paths of a mask or slice."""
        return MeasuredPaths(**{name: values[which] for name, values in vars(self).items()})


@dataclass(frozen=True, kw_only=True)
@checked
class PositioningConfig:
    """How paths are measured, and how a radio is looked for."""

    sigma_length_m: Annotated[float, Range(1e-6, 1000, "m")] = 0.12
    """Standard deviation of lengths [m]."""
    sigma_known_rad: Annotated[float, Range(1e-6, 1, "rad")] = math.radians(1.5)
    """Standard deviation of directions at the known end [rad]."""
    sigma_own_rad: Annotated[float, Range(1e-6, 1, "rad")] = math.radians(2.0)
    """Standard deviation of azimuths at the end that is searched for [rad]."""
    cut: Annotated[float, Range(0.1, 1000)] = 6.0
    """Squared deviations from which on a path is taken to be no single bounce."""
    straight_weight: Annotated[float, Range(0.1, 100)] = 2.0
    """Weight of a path in line of sight among bounces: chance agrees with it more seldom."""
    heading_step_rad: Annotated[float, Range(1e-3, 1, "rad")] = math.radians(2.0)
    """Headings are tried in such steps [rad]."""
    max_offset_m: Annotated[float, Range(0.01, 1e5, "m")] = 5.0
    """Clocks are no farther apart [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Located:
    """Where a radio was found."""

    pose: Float[np.ndarray, "3"]
    """x [m], y [m], heading [rad] in `map`."""
    offset_m: float
    """By how much lengths are too long [m]: clock offset times the speed of light."""
    explained: Bool[np.ndarray, " n"]
    """Paths that agree."""
    straight: Bool[np.ndarray, " n"]
    """Paths of them that are in line of sight."""
    covariance: Float[np.ndarray, "4 4"]
    """Covariance of x, y [m], heading [rad] and offset [m] by the paths that agree; infinite where undetermined."""
    cost: float
    """Less is better; a path that agrees to the point lowers it by `cut`."""


def locate(
    paths: MeasuredPaths,
    config: PositioningConfig = PositioningConfig(),
    *,
    offset_m: float | None = None,
    rng: np.random.Generator | None = None,
) -> Located:
    """Find a radio.

    Args:
        paths: Measured paths.
        config: How well, and how to look.
        offset_m: Offset of the clocks [m], if it is known.
        rng: Draws sets of paths where there are too many; a generator of seed 0 by default.

    Raises:
        ValueError: If the paths are too few for any estimate.
    """
    least = 3 if offset_m is None else 2
    if len(paths.length_m) < least:
        raise ValueError(f"{len(paths.length_m)} paths, expected {least} at least for a position.")
    # A heading may lie half a step from the nearest that is tried.
    own_rad = math.hypot(config.sigma_own_rad, config.heading_step_rad / 2)
    coarse = replace(config, sigma_own_rad=min(own_rad, 1.0))
    hypotheses = _hypotheses(paths, coarse, offset_m, rng or np.random.default_rng(0))
    if not len(hypotheses):
        raise ValueError(
            "no place fits any of the paths. Check the frames of directions, or raise max_offset_m."
        )
    refined = [_refined(paths, state, [coarse, coarse, config], offset_m) for state in hypotheses]
    return min(refined, key=lambda located: located.cost)


def _hypotheses(
    paths: MeasuredPaths, config: PositioningConfig, offset_m: float | None, rng: np.random.Generator
) -> Float[np.ndarray, "h 4"]:
    """The best states of the headings that do best, by few paths each."""
    sets = _sets(len(paths.length_m), 3 if offset_m is None else 2, rng)
    best: list[tuple[float, Float[np.ndarray, 4]]] = []
    for heading in np.arange(-math.pi, math.pi, config.heading_step_rad):
        states = _solved(paths, heading, sets, offset_m)
        states = states[np.abs(states[:, 3]) <= config.max_offset_m]
        if len(states):
            cost = _judged(paths, states, config)[0]
            k = int(np.argmin(cost))
            best.append((float(cost[k]), states[k]))
    best.sort(key=lambda pair: pair[0])
    return np.array([state for _, state in best[:_REFINED]]).reshape(-1, 4)


def _sets(count: int, size: int, rng: np.random.Generator) -> Int[np.ndarray, "m k"]:
    """Sets of few paths: all, or as many as are looked at."""
    if math.comb(count, size) <= _MOST_SETS:
        return np.array(list(combinations(range(count), size)))
    return np.array([rng.choice(count, size, replace=False) for _ in range(_MOST_SETS)])


def _unit(angle_rad: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any 2"]:
    return np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=-1)


def _solved(
    paths: MeasuredPaths, heading: float, sets: Int[np.ndarray, "m k"], offset_m: float | None
) -> Float[np.ndarray, "s 4"]:
    """Places and offsets (x, y, heading, offset) that agree exactly with few paths."""
    d, e = _unit(paths.known_rad), _unit(heading + paths.own_rad)
    s = d + e
    normal = _left_of(s) / np.maximum(np.hypot(*s.T), 1e-9)[:, None]
    across = (normal * e).sum(axis=1)
    # Equation (1) times the normal: normal . z - (normal . e) offset = normal . (k - length e).
    projected = (normal * (paths.known_xy - paths.length_m[:, None] * e)).sum(axis=1)
    if offset_m is None:
        left, right = np.column_stack([normal, -across])[sets], projected[sets]
    else:
        left, right = normal[sets], (projected + across * offset_m)[sets]
    good = np.abs(np.linalg.det(left)) > _LEAST_DETERMINANT
    solved = np.linalg.solve(left[good], right[good][..., None])[..., 0]
    if offset_m is not None:
        solved = np.column_stack([solved, np.full(len(solved), offset_m)])
    straight = _straight_places(paths, e, normal, across, projected, offset_m, np.hypot(*s.T))
    every = np.concatenate([solved, straight])
    return np.column_stack([every[:, :2], np.full(len(every), heading), every[:, 2]])


def _straight_places(
    paths: MeasuredPaths,
    e: Float[np.ndarray, "n 2"],
    normal: Float[np.ndarray, "n 2"],
    across: Float[np.ndarray, " n"],
    projected: Float[np.ndarray, " n"],
    offset_m: float | None,
    bent: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "m 3"]:
    """Places and offsets by a path that would be in line of sight and, where the offset is open, one more."""
    straight = np.flatnonzero(bent < 0.1)[:20]
    place = paths.known_xy[straight] - paths.length_m[straight, None] * e[straight]
    if offset_m is not None:
        return np.column_stack([place + offset_m * e[straight], np.full(len(straight), offset_m)])
    others = np.arange(min(len(projected), 40))
    i, j = (index.ravel() for index in np.meshgrid(np.arange(len(straight)), others, indexing="ij"))
    slope = (normal[j] * e[straight[i]]).sum(axis=1) - across[j]
    is_determined = np.abs(slope) > 0.05
    i, j, slope = i[is_determined], j[is_determined], slope[is_determined]
    offset = (projected[j] - (normal[j] * place[i]).sum(axis=1)) / slope
    return np.column_stack([place[i] + offset[:, None] * e[straight[i]], offset])


def _judged(
    paths: MeasuredPaths, states: Float[np.ndarray, "s 4"], config: PositioningConfig
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, "s n"], Bool[np.ndarray, "s n"]]:
    """Cost of each state; squared deviation of each path from it, and whether it would be in line of sight."""
    off, covariance, straight = _deviations(paths, states, config)
    a, b, c = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    x, y = off[..., 0], off[..., 1]
    squared = (c * x * x - 2 * b * x * y + a * y * y) / (a * c - b * b)
    weight = np.where(straight, config.straight_weight, 1.0)
    possible = paths.length_m - states[:, 3:] > 0
    cost = np.where(possible, weight * np.minimum(squared - config.cut, 0.0), 0.0).sum(axis=1)
    return cost, squared, straight


def _deviations(
    paths: MeasuredPaths, states: Float[np.ndarray, "s 4"], config: PositioningConfig
) -> tuple[Float[np.ndarray, "s n 2"], Float[np.ndarray, "s n 2 2"], Bool[np.ndarray, "s n"]]:
    """How far (1) is off at its best r, the covariance of that, and whether it would be in line of sight."""
    # Along d + e a bounce says nothing of where z is: there it has a wide covariance.
    d, e = _unit(paths.known_rad)[None], _unit(states[:, 2:3] + paths.own_rad)
    length = paths.length_m - states[:, 3:]
    s = d + e
    square = (s * s).sum(axis=-1)
    off = states[:, None, :2] - paths.known_xy + length[..., None] * e
    r = np.clip((off * s).sum(axis=-1) / np.maximum(square, 1e-6), 0.0, np.maximum(length, 0.0))
    off = off - r[..., None] * s
    bent = np.sqrt(square)
    straight = _STRAIGHT * math.hypot(config.sigma_known_rad, config.sigma_own_rad)
    parts = (
        (r * config.sigma_known_rad)[..., None] * _left_of(d),
        ((length - r) * config.sigma_own_rad)[..., None] * _left_of(e),
        config.sigma_length_m * e,
        (length * np.maximum(bent - straight, 0.0) / np.maximum(bent, 1e-9))[..., None] * s,
    )
    covariance = sum(term[..., :, None] * term[..., None, :] for term in parts) + 1e-6 * np.eye(2)
    return off, np.asarray(covariance), bent < straight


def _left_of(direction: Float[np.ndarray, "*any 2"]) -> Float[np.ndarray, "*any 2"]:
    return np.stack([-direction[..., 1], direction[..., 0]], axis=-1)


def _whitened(
    values: Float[np.ndarray, " f"],
    paths: MeasuredPaths,
    fixed: Float[np.ndarray, " k"],
    whitening: Float[np.ndarray, "n 2 2"],
    config: PositioningConfig,
) -> Float[np.ndarray, " m"]:
    """Deviations of unit variance."""
    off = _deviations(paths, np.append(values, fixed)[None], config)[0][0]
    return np.asarray((whitening @ off[..., None])[..., 0].ravel())


def _refined(
    paths: MeasuredPaths,
    state: Float[np.ndarray, "4"],
    rounds: Sequence[PositioningConfig],
    offset_m: float | None,
) -> Located:
    """Least squares over the paths that agree, which are selected again in each round."""
    free, last = 4 if offset_m is None else 3, rounds[-1]
    covariance, before = np.full((4, 4), np.inf), None
    for config in [*rounds, *[last] * _MORE_ROUNDS]:
        _, squared, _ = _judged(paths, state[None], config)
        agree = squared[0] < config.cut
        settled = config is last and before is not None and np.array_equal(agree, before)
        if settled or not agree.any():
            break
        before = agree if config is last else None
        agreeing = paths.chosen(agree)
        spread = _deviations(agreeing, state[None], config)[1][0]
        whitening = np.linalg.inv(np.linalg.cholesky(spread))
        whiten = partial(_whitened, paths=agreeing, fixed=state[free:], whitening=whitening, config=config)
        fit = least_squares(whiten, state[:free], loss="soft_l1", max_nfev=40)
        state = np.append(fit.x, state[free:])
        information = fit.jac.T @ fit.jac
        covariance = np.full((4, 4), np.inf)
        if np.linalg.cond(information) < _MOST_CONDITION:
            covariance = np.zeros((4, 4))
            covariance[:free, :free] = np.linalg.inv(information)
    cost, squared, straight = _judged(paths, state[None], last)
    agree = squared[0] < last.cut
    heading = (state[2] + math.pi) % (2 * math.pi) - math.pi
    return Located(
        pose=np.array([state[0], state[1], heading]),
        offset_m=float(state[3]),
        explained=agree,
        straight=agree & straight[0],
        covariance=covariance,
        cost=float(cost[0]),
    )
