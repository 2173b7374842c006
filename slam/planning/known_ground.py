"""What ways over known ground cost the robot: the cost map and the travel time over it, put together."""

from dataclasses import replace

from slam.planning.cost_map import Box, CostConfig, CostMap, cost_map
from slam.planning.travel_time import TravelTime, travel_time


def ways_from_robot(box: Box, config: CostConfig, *, through_unknown: bool = True) -> TravelTime:
    """Cost of the ways from the robot to all places of a box, on cells twice as large as those of the box.

    Args:
        box: What is known, and where the robot is.
        config: Costs.
        through_unknown: Whether ways may lead through cells of which nothing is known.
    """
    costs = cost_map(box, config)
    if not through_unknown:
        costs = replace(costs, passable=costs.passable & (box.probability < 0.5))
    costs = costs.reachable_from(box.pose[:2]).halved()
    return ways_to(costs, costs.cell(box.pose[:2]))


def ways_to(costs: CostMap, cell: tuple[int, int]) -> TravelTime:
    """Cost of the ways from all places to a cell (row, column)."""
    return travel_time(costs.frame, costs.cost.astype(float), costs.passable, cell)
