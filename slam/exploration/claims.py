"""Places that other robots are bound for: a robot leaves to them what they reach sooner.

A robot with d metres left to its goal reaches another place after d and the path from its goal there. Each robot thus
takes the part of the building that it is the first to reach after what all are bound for, as in sequential auctions.
Reference: Koenig et al., The power of sequential single-item auctions for agent coordination, AAAI 2006.
"""

from collections.abc import Sequence

import numpy as np

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
        is_mine &= ~(claim.cost_m + _from(claim, from_robot).at(places) < mine_m)
    return [frontier for frontier, mine in zip(frontiers, is_mine, strict=True) if mine] or list(frontiers)


def _from(claim: Claim, from_robot: TravelTime) -> TravelTime:
    """Travel time from where another robot is bound, over the floor that the robot can reach."""
    passable = np.isfinite(from_robot.cost_m)
    cost = np.where(passable, from_robot.cost_per_m, 1.0).astype(np.float32)
    costs = CostMap(frame=from_robot.frame, cost=cost, passable=passable)
    return travel_time_to(costs, costs.nearest(claim.xy)[0])
