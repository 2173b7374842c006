"""Places that other robots are bound for: a robot leaves to them what they reach sooner, or gain more by.

A robot with d metres left to its goal reaches another place after d and the path from its goal there. Of frontiers,
each robot takes those that it is the first to reach. Visits with gains are auctioned one by one: a visit goes to the
robot whose discounted gains, in the order of all its visits so far, grow most by it. A robot that already has much to
visit thus leaves the rest to others, also where it would be there sooner.
Reference: Koenig et al., The power of sequential single-item auctions for agent coordination, AAAI 2006.
"""

from collections.abc import Sequence
from itertools import pairwise, product

import numpy as np
from jaxtyping import Bool, Float

from slam.exploration.frontiers import Frontier
from slam.grid import Claim
from slam.planning.cost_map import CostMap, travel_time_to
from slam.planning.travel_time import TravelTime


def unclaimed(
    frontiers: Sequence[Frontier], claims: Sequence[Claim], from_robot: TravelTime
) -> list[Frontier]:
    """The frontiers that no other robot reaches sooner; all of them if there is none.

    Args:
        frontiers: Frontiers with their costs from the robot.
        claims: Where the others are bound.
        from_robot: Travel time from the robot.
    """
    places = np.array([frontier.near_xy for frontier in frontiers]).reshape(-1, 2)
    mine_m = np.array([frontier.cost_m for frontier in frontiers])
    is_mine = np.ones(len(frontiers), bool)
    for claim in claims:
        is_mine &= ~(costs_from(claim, from_robot, places) < mine_m)
    return [frontier for frontier, mine in zip(frontiers, is_mine, strict=True) if mine] or list(frontiers)


def costs_from(
    claim: Claim, from_robot: TravelTime, places: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, " k"]:
    """Costs at which another robot reaches places after its goal, over floor that the robot can reach."""
    passable = np.isfinite(from_robot.cost_m)
    cost = np.where(passable, from_robot.cost_per_m, 1.0).astype(np.float32)
    costs = CostMap(frame=from_robot.frame, cost=cost, passable=passable)
    return claim.cost_m + travel_time_to(costs, costs.nearest(claim.xy)[0]).at(places)


def auctioned(
    gain: Float[np.ndarray, " k"], first: Float[np.ndarray, "n k"], between: Float[np.ndarray, "k k"]
) -> Bool[np.ndarray, " k"]:
    """Which of k visits the first of n robots wins.

    Args:
        gain: Gain of each visit, not negative.
        first: Factor by which a gain is discounted on the path from each robot, 0 to 1.
        between: The same from one visit (row) to the next (column).
    """
    orders: list[list[int]] = [[] for _ in first]
    left = list(range(len(gain)))
    # What each robot's order would become with each visit, and gain by it.
    offers = [[_with(k, [], gain, discount, between) for k in left] for discount in first]
    while left:
        robot, k = max(product(range(len(first)), left), key=lambda bid: offers[bid[0]][bid[1]][0])
        orders[robot] = offers[robot][k][1]
        left.remove(k)
        for j in left:
            offers[robot][j] = _with(j, orders[robot], gain, first[robot], between)
    return np.isin(np.arange(len(gain)), orders[0])


def _with(
    visit: int,
    order: list[int],
    gain: Float[np.ndarray, " k"],
    first: Float[np.ndarray, " k"],
    between: Float[np.ndarray, "k k"],
) -> tuple[float, list[int]]:
    """By how much the discounted gains of an order grow with another visit where it fits best, and that order."""

    def value(order: list[int]) -> float:
        total = 0.0
        for here, there in pairwise([*order[::-1], -1]):
            total += gain[here]
            total *= first[here] if there < 0 else between[there, here]
        return float(total)

    orders = [[*order[:at], visit, *order[at:]] for at in range(len(order) + 1)]
    best = max(orders, key=value)
    return value(best) - value(order), best
