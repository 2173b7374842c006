"""Travel time of the robot over known ground: a cost map, and fast marching over it."""

from dataclasses import replace

from slam.planning.cost_map import Box, CostConfig, CostMap, cost_map
from slam.planning.travel_time import TravelTime, travel_time


def travel_time_from_robot(box: Box, config: CostConfig, *, through_unknown: bool = True) -> TravelTime:
    """Travel time from the robot to all cells of a box, on cells twice as large as those of the box."""
    costs = cost_map(box, config)
    if not through_unknown:
        costs = replace(costs, passable=costs.passable & (box.probability < 0.5))
    costs = costs.reachable_from(box.pose[:2]).halved()
    return travel_time_to(costs, costs.cell(box.pose[:2]))


def travel_time_to(costs: CostMap, cell: tuple[int, int]) -> TravelTime:
    """Travel time from all cells to a cell (row, column)."""
    return travel_time(costs.frame, costs.cost.astype(float), costs.passable, cell)
