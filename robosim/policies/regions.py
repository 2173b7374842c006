"""Regions: the unseen space behind each frontier, with the belief in it, and the order in which to search them.

An unseen cell belongs to the frontier from which it is nearest through unseen cells, around obstacles that are known or
anticipated with confidence. A region therefore depends on the map alone, not on where the robot stands. Its belief is
that of the floor to be expected: less far behind the frontier, where walls are to come, and hardly any behind a gap
narrower than a door. How soon walls come is judged by the longest line of floor that was seen up to the frontier and
leads on across it: the end of a corridor leads as far again, a door into a room as far as the room and the corridor
before it are wide. Space that is not behind any frontier, such as the outside of walls that were seen, belongs to no
region.

The first region is the one with which the best order of all begins (`slam.exploration.tour`): a belief found after t
decisions is worth exp(-t / horizon) of it, which for a long horizon is the least time until the target is found. In a
team regions are auctioned first, and a robot searches those that it wins.

Reference: Blum et al., Approximation algorithms for orienteering and discounted-reward TSP, SIAM J. Computing
37(2), 2007.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int

from robosim.policies.route_directions import BLOCKING, MapSurvey
from slam.actions import FORWARD_M
from slam.exploration.claims import auctioned, costs_from
from slam.exploration.frontiers import Frontier
from slam.exploration.tour import costs_between, values_of_orders
from slam.grid import Claim
from slam.planning.travel_time import TravelTime

#: Unseen cells that are entered farther from any frontier belong to none [m].
_PASSING_M = 1.5
#: Least and largest distance behind a frontier at which space counts less by a factor of e [m].
FADES_M = (4.0, 40.0)
#: Behind a narrower frontier, mostly a gap in a wall, there is hardly any floor [m] (decision record 41).
_WIDE_M = 1.0
#: With less of the belief behind all frontiers together, walls of the map close a gap that is there: cells then count
#: as blocked only if obstacles fill a larger share of them.
_ENCLOSED, _BLOCKING_WHERE_ENCLOSED = 0.01, 0.4


class Region(NamedTuple):
    """The unseen space behind a frontier."""

    frontier: Frontier
    """Where it is entered."""
    belief: float
    """Probability in it, less the farther behind the frontier."""
    decisions: float
    """Decisions of the robot to the frontier."""


class RegionCells(NamedTuple):
    """Which region each cell of a part of a grid belongs to."""

    rows: slice
    """Rows of the part."""
    columns: slice
    """Columns of the part."""
    region: Int[np.ndarray, "ny nx"]
    """Number of the frontier of each cell's region; -1 for cells of none."""
    behind_m: Float32[np.ndarray, "ny nx"]
    """How far behind its frontier each cell is, by the route of a robot [m]."""


def find_regions(
    frontiers: Sequence[Frontier],
    lines_m: Float[np.ndarray, " k"],
    survey: MapSurvey,
    probability: Float32[np.ndarray, "ny nx"],
    pose: Float[np.ndarray, "3"],
) -> list[Region]:
    """Regions of the frontiers, in their order, with the belief of the survey's cells in them.

    Args:
        frontiers: Where regions are entered.
        lines_m: Length of the line across each frontier (`slam.exploration.frontiers.lines_across`) [m].
        survey: The map.
        probability: The belief.
        pose: Pose of the robot x [m], y [m], yaw [rad], whose decisions to the frontiers are counted.
    """
    if not frontiers:
        return []
    cells = cells_of_regions(frontiers, survey, pose[:2])
    if probability[cells.rows, cells.columns][cells.region >= 0].sum() < _ENCLOSED:
        cells = cells_of_regions(frontiers, survey, pose[:2], _BLOCKING_WHERE_ENCLOSED)
    is_inside = cells.region >= 0
    region = cells.region[is_inside]
    belief = probability[cells.rows, cells.columns][is_inside]
    belief = belief * np.exp(-cells.behind_m[is_inside] / np.clip(lines_m, *FADES_M)[region])
    beliefs = np.bincount(region, belief, minlength=len(frontiers))
    beliefs = beliefs * np.minimum(1.0, [frontier.length_m / _WIDE_M for frontier in frontiers]) ** 3
    return [
        Region(frontier, float(share), frontier.cost_m / FORWARD_M + frontier.turns_from(pose))
        for frontier, share in zip(frontiers, beliefs, strict=True)
    ]


def cells_of_regions(
    frontiers: Sequence[Frontier],
    survey: MapSurvey,
    here: Float[np.ndarray, "2"],
    blocking: float = BLOCKING,
) -> RegionCells:
    """Assign unseen cells of the survey's grid to frontiers, at least one, for a robot at a place [m].

    Obstacles block a cell if they fill this share of it.
    """
    routes = survey.routes_past_frontiers(here, blocking)
    # The cells in which routes enter, and the frontier there.
    entries = np.flatnonzero(np.bincount(routes.entry[routes.entry >= 0], minlength=1))
    rows, columns = np.divmod(entries, routes.entry.shape[1])
    places = survey.frame.to_points(
        np.column_stack([columns + routes.columns.start, rows + routes.rows.start]) + 0.5
    )
    goals = np.array([frontier.goal_xy for frontier in frontiers])
    distance_m = np.hypot(*(places[:, None] - goals).transpose(2, 0, 1))
    is_near = distance_m.min(axis=1, initial=math.inf) < _PASSING_M
    of_entry = np.full(routes.entry.size + 1, -1)
    of_entry[entries[is_near]] = distance_m[is_near].argmin(axis=1)
    return RegionCells(routes.rows, routes.columns, of_entry[routes.entry], routes.unexplored_m())


def values_first(
    regions: Sequence[Region], travel_time: TravelTime, *, head_start: float, horizon: float
) -> Float[np.ndarray, " k"]:
    """Value of the best order of all regions that begins with each of them: discounted belief.

    Args:
        regions: At most about twelve: the work doubles with each.
        travel_time: Travel time from the robot.
        head_start: Decisions added to each route.
        horizon: Decisions after which a belief is worth less by a factor of e.
    """
    first = np.array([region.decisions for region in regions])
    return values_of_orders(*_visits(regions, travel_time, first, head_start, horizon))


def regions_won(
    regions: Sequence[Region],
    travel_time: TravelTime,
    claims: Sequence[Claim],
    *,
    head_start: float,
    horizon: float,
) -> list[Region]:
    """Regions that the robot wins in an auction with the others (`slam.exploration.claims`); all if it wins none.

    Args:
        regions: With belief.
        travel_time: Travel time from the robot.
        claims: Where other robots are bound.
        head_start: Decisions added to each route.
        horizon: Decisions after which a belief is worth less by a factor of e.
    """
    others = [costs_from(claim, travel_time, _places(regions)) / FORWARD_M for claim in claims]
    first = np.vstack([[region.decisions for region in regions], *others])
    is_won = auctioned(*_visits(regions, travel_time, first, head_start, horizon))
    return [region for region, won in zip(regions, is_won, strict=True) if won] or list(regions)


def _visits(
    regions: Sequence[Region],
    travel_time: TravelTime,
    first: Float[np.ndarray, "*n k"],
    head_start: float,
    horizon: float,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "*n k"], Float[np.ndarray, "k k"]]:
    """Belief of regions, and discounts on routes to each, of so many decisions from robots, and between them."""
    between = costs_between(travel_time, _places(regions)) / FORWARD_M
    discount_first, discount = (np.exp(-(decisions + head_start) / horizon) for decisions in (first, between))
    return np.array([region.belief for region in regions]), discount_first, discount


def _places(regions: Sequence[Region]) -> Float[np.ndarray, "k 2"]:
    """Places (x, y) at which regions are entered [m]."""
    return np.array([region.frontier.near_xy for region in regions]).reshape(-1, 2)
