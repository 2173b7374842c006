"""Exploration of campus floors by the published protocol of MapEx, compared with its nearest frontiers.

The floor has cells of 0.1 m; a lidar of 20 m with 2,500 rays sees without error; a step goes three cells along the
cheapest path between neighbouring cells, which costs 10 less the distance to what is occupied or unknown, at least 1.
Unknown cells are passable: the published code sets `unknown_as_occ`, but does not use it. Obstacles are dilated by a
square of three cells. Coverage is the share of known cells among those of rooms; its area under 1,000 steps is
compared start by start. The IoU is that of occupied cells of the observed map.

The published goals are frontiers of more than ten cells, the nearest as the crow flies, chosen again within 1 m.
Explorers of `slam.exploration` use the same motion, so that only the choice of goals differs.
Left out: predictions of unseen walls. The shipped map network sees a depth camera, not a lidar.

Reference: Ho et al., MapEx: Indoor structure exploration with probabilistic information gain from global map
predictions, ICRA 2025, and its code.
"""

import math
import time
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, cast

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.figure import Figure
from tyro.conf import OmitArgPrefixes, Positional

from robosim.evaluation.search_scores import bootstrap
from robosim.navigation import learned_explorer
from robosim.support.compiled import compiled
from slam.exploration.explorer import Explorer, ExplorerConfig, ExplorerName, FrontierExplorer
from slam.grid import GridFrame, MapEstimate
from tests.benchmarks.exploration import area_under
from tests.benchmarks.harness import DEFAULT, Options, figure_of, run_units
from tests.benchmarks.results import Results

#: Side of a cell [m], steps of a run, cells of a step, steps between IoUs; range [cells] and rays of the lidar.
CELL_M, STEPS, STRIDE, EVERY, REACH, RAYS = 0.1, 1000, 3, 50, 200, 2500
#: Cost of a cell next to what is occupied or unknown; size of published frontiers, and distance to a goal at which
#: another one is chosen, both above [cells].
WORST, REGION, NEAR = 10, 10, 10
PUBLISHED = "published nearest"
#: Settings of explorers for this lidar and a robot that drives in any direction.
LIDAR: dict[str, Any] = {
    "turn_weight": 0.0, "min_cells": 8, "piece_m": 4.0, "view_m": 6.0, "depth_m": 6.0, "max_gain_m2": 30.0,
    "gain_weight": 2.0,
}  # fmt: skip
#: Starts (row, column) from the top, in cells, of the published scripts less their padding of 500.
STARTS = {
    "50010535_PLAN2": ((15, 15), (268, 51), (15, 1017), (273, 1012)),
    "50015848": ((15, 15), (419, 19), (12, 1307), (428, 1178)),
    "50052749": ((15, 15), (13, 370), (300, 83), (302, 413)),
}


def main(
    folder: Positional[Path],
    *,
    explorers: tuple[str, ...] = ("nearest", "cheapest", "gain", "learned", "tour"),
    floors: tuple[str, ...] = (),
    steps: int = STEPS,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Exploration of campus floors with a lidar by the protocol of MapEx: floor seen over steps.

    Args:
        folder: Folder of NAME_occ.png and NAME_rooms.png.
        explorers: Ratings of frontiers.
        floors: Names of floors; all if none is given.
        steps: Steps of a run.
        options: Of every benchmark.
    """
    names = floors or floor_names(folder)
    rows = (PUBLISHED, *explorers)
    units = {
        f"{row}, {name}, {start}": (row, folder, name, start, steps)
        for row, name, start in product(rows, names, range(4))
    }
    found = run_units(explore, units, options.folder("mapex"), workers=options.workers)
    results = Results()
    for row in rows:
        summarise(row, found, results)
    results.figures = {"mapex": draw(rows, found)}
    return options.finish("mapex", results)


def summarise(row: str, runs: Mapping[str, dict[str, Any]], results: Results) -> None:
    """Add the scores of one explorer: areas under coverage, ratios to the published choice, IoU and time."""
    own, published = (
        [run for key, run in runs.items() if key.startswith(f"{name}, ")] for name in (row, PUBLISHED)
    )
    coverage = np.array([run["coverage"] for run in own])
    area, other = (np.array([area_under(run["coverage"]) for run in part]) for part in (own, published))

    def add(name: str, value: float, unit: str = "", digits: int = 3, **more: Any) -> None:
        results.add("mapex", row, name, value, unit, digits=digits, cases=len(area), **more)

    ratio, low, high = geometric_mean(area / other)
    add("area under coverage", area.mean())
    add("ratio", ratio, digits=2, spread=(low, high))
    for steps in (250, 500, 1000):
        add(f"seen after {steps}", 100 * coverage[:, : steps + 1][:, -1].mean(), "%", 1)
    add("mean IoU", np.mean([run["iou"] for run in own]))
    add("choice", 1e3 * np.mean([run["choice_s"] for run in own]), "ms", 1)
    floors = [key.split(", ")[1] for key in runs if key.startswith(f"{row}, ")]
    for floor in dict.fromkeys(floors):
        ratio = geometric_mean((area / other)[np.array(floors) == floor])[0]
        results.add("mapex floors", floor, row, ratio, digits=2, cases=floors.count(floor))


def geometric_mean(ratios: Float[np.ndarray, " n"]) -> tuple[float, float, float]:
    """Geometric mean of ratios, with its 95 % interval by bootstrap."""
    mean, low, high = bootstrap(np.log(ratios)[:, None], None)
    return math.exp(mean), math.exp(low), math.exp(high)


def draw(rows: Sequence[str], runs: Mapping[str, dict[str, Any]]) -> Figure:
    """Mean coverage and IoU over steps, by explorer."""
    figure, panels = figure_of(2)
    for axes, name, every in zip(panels, ("coverage", "iou"), (1, EVERY), strict=True):
        for row in rows:
            mean = np.mean([run[name] for key, run in runs.items() if key.startswith(f"{row}, ")], axis=0)
            axes.plot(every * np.arange(len(mean)), mean, label=row)
        axes.set(xlabel="steps", ylabel=name)
    panels[0].legend()
    return figure


class Floor(NamedTuple):
    """A floor, rows from below: what stops robot and rays, the drawing's walls, cells of rooms, and starts."""

    wall: Bool[np.ndarray, "ny nx"]
    drawn: Bool[np.ndarray, "ny nx"]
    rooms: Bool[np.ndarray, "ny nx"]
    starts: tuple[tuple[int, int], ...]


def read_floor(folder: Path, name: str) -> Floor:
    """Read a floor from pictures of 0.05 m per pixel; a cell of four pixels with any wall is a wall."""
    drawn, rooms = (_halved(mask) for mask in read_pictures(folder, name))
    wall = drawn | outside_of(drawn, rooms)
    starts = STARTS.get(name) or _corners(rooms & ~wall)
    wall, drawn, rooms = (np.ascontiguousarray(mask[::-1]) for mask in (wall, drawn, rooms))
    upwards = tuple((len(wall) - 1 - row, column) for row, column in starts)
    return Floor(wall=wall, drawn=drawn, rooms=rooms, starts=upwards)


def floor_names(folder: Path) -> tuple[str, ...]:
    """Names of the floors of a folder of NAME_occ.png and NAME_rooms.png."""
    return tuple(sorted(path.name[:-8] for path in folder.glob("*_occ.png")))


def read_pictures(folder: Path, name: str) -> tuple[Bool[np.ndarray, "ny nx"], Bool[np.ndarray, "ny nx"]]:
    """Read which pixels of 0.05 m of a floor are drawn walls, and which are rooms, rows from the top."""
    occupied, rooms = (
        np.asarray(cv2.imread(str(folder / f"{name}_{part}.png"), cv2.IMREAD_GRAYSCALE))
        for part in ("occ", "rooms")
    )
    return np.equal(occupied, 0), np.greater(rooms, 0)


def outside_of(
    drawn: Bool[np.ndarray, "ny nx"], rooms: Bool[np.ndarray, "ny nx"]
) -> Bool[np.ndarray, "ny nx"]:
    """Cells that are free and connected to the border; none if the outline leaks into rooms."""
    free = np.pad(~drawn, 1, constant_values=True).astype(np.uint8)
    component = cv2.connectedComponents(free, connectivity=4)[1]
    outside = (component == component[0, 0])[1:-1, 1:-1]
    return outside if (outside & rooms).mean() <= 0.01 else np.zeros_like(outside)


def _halved(mask: Bool[np.ndarray, "ny nx"]) -> Bool[np.ndarray, "my mx"]:
    """Cells twice as large that hold any marked cell."""
    even = np.pad(mask, [(0, n % 2) for n in mask.shape])
    return np.asarray(even[::2, ::2] | even[1::2, ::2] | even[::2, 1::2] | even[1::2, 1::2])


def _corners(free: Bool[np.ndarray, "ny nx"]) -> tuple[tuple[int, int], ...]:
    """The places in the largest room, with half a metre around them, that are nearest to the corners of the floor."""
    space = cv2.erode(free.astype(np.uint8), np.ones((5, 5), np.uint8))
    label, sizes = cv2.connectedComponentsWithStats(space)[1:3]
    cells = np.argwhere(label == 1 + np.argmax(sizes[1:, cv2.CC_STAT_AREA]))
    ends = [(row, column) for row in (0, len(free) - 1) for column in (0, free.shape[1] - 1)]
    nearest = [cells[np.argmin(((cells - end) ** 2).sum(axis=1))] for end in ends]
    return tuple((int(row), int(column)) for row, column in nearest)


class PublishedNearest:
    """The published rules for the nearest frontier, by straight distance."""

    _goal: Int[np.ndarray, "2"] | None = None

    def goal(self, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """Where to go [m]; None if no frontier is left."""
        here = np.array(estimate.frame.index(estimate.pose[:2]))
        passable = planning_cost(estimate) > 0
        passable[tuple(here)] = True
        part = cv2.connectedComponents(passable.astype(np.uint8), connectivity=4)[1]

        def is_valid(goal: Int[np.ndarray, "2"]) -> bool:
            return bool(part[tuple(goal)] == part[tuple(here)] and math.hypot(*(goal - here)) >= NEAR)

        if self._goal is None or not is_valid(self._goal):
            centres = sorted(_regions(estimate), key=lambda cell: math.hypot(*(cell - here)))
            self._goal = next(filter(is_valid, centres), None)
        return None if self._goal is None else estimate.frame.to_points(self._goal[::-1] + 0.5)


def _regions(estimate: MapEstimate) -> list[Int[np.ndarray, "2"]]:
    """The cell (row, column) of each frontier that is nearest to its mean."""
    unknown = (~estimate.explored).astype(np.uint8)
    edge = estimate.known_free & (cv2.dilate(unknown, np.ones((3, 3), np.uint8)) > 0)
    cells = np.argwhere(edge)
    label = cv2.connectedComponents(edge.astype(np.uint8), connectivity=8)[1][edge]
    regions = [cells[label == k] for k in np.flatnonzero(np.bincount(label) > REGION)]
    return [cells[np.argmin(((cells - cells.mean(axis=0)) ** 2).sum(axis=1))] for cells in regions]


def planning_cost(estimate: MapEstimate) -> Int[np.ndarray, "ny nx"]:
    """Published cost of a step to each cell; 0 where obstacles, dilated by a square of three cells, stop it."""
    dilated = cv2.dilate(estimate.obstacle.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    space = cv2.distanceTransform((estimate.known_free & ~dilated).astype(np.uint8), cv2.DIST_C, 3)
    return np.where(dilated, 0, np.clip(WORST - space, 1, WORST)).astype(np.int32)


class LidarWalk:
    """One robot on one floor, with a perfect lidar and pose."""

    def __init__(self, floor: Floor, start: int) -> None:
        self.floor = floor
        self._frame = GridFrame(origin_xy=(0.0, 0.0), resolution_m=CELL_M, shape=floor.wall.shape)
        self._probability = np.full(floor.wall.shape, 0.5, np.float32)
        self._cell, self._yaw = floor.starts[start], 0.0
        _scan(self.floor.wall, self._probability, *self._cell, REACH, RAYS)

    def coverage(self) -> float:
        """Share of the rooms' cells that are known."""
        return float((self._probability[self.floor.rooms] != 0.5).mean())

    def iou(self) -> float:
        """IoU of occupied cells of the map with the drawing."""
        found = self._probability > 0.5
        return float((found & self.floor.drawn).sum() / (found | self.floor.drawn).sum())

    def estimate(self) -> MapEstimate:
        """What the robot knows."""
        place = self._frame.to_points(np.array(self._cell[::-1]) + 0.5)
        return MapEstimate(
            frame=self._frame,
            obstacle_probability=self._probability,
            explored=self._probability != 0.5,
            blocked=np.zeros(self._frame.shape, bool),
            pose=np.array([*place, self._yaw]),
        )

    def advance(self, goal_xy: Float[np.ndarray, "2"]) -> None:
        """Go one step on the cheapest path to a goal, or to the reachable cell nearest to it."""
        # A rim stops the search without checks of bounds.
        cost = np.pad(planning_cost(self.estimate()), 1)
        width = cost.shape[1]
        row, column = (int(k) for k in self._frame.index(goal_xy))
        here = (self._cell[0] + 1) * width + self._cell[1] + 1
        cells = _path(cost.ravel(), here, (row + 1) * width + column + 1, width)
        for cell in cells[1 : STRIDE + 1]:
            row, column = divmod(int(cell), width)
            if self.floor.wall[row - 1, column - 1]:
                break
            self._yaw = math.atan2(row - 1 - self._cell[0], column - 1 - self._cell[1])
            self._cell = (row - 1, column - 1)
        _scan(self.floor.wall, self._probability, *self._cell, REACH, RAYS)


@compiled
def _scan(wall: np.ndarray, probability: np.ndarray, row: int, column: int, reach: int, rays: int) -> None:
    """Mark cells that rays from a cell's centre cross as free, and the first wall (Amanatides and Woo, 1987)."""
    ny, nx = wall.shape
    for ray in range(rays):
        angle = 2 * math.pi * (ray + 0.5) / rays
        dx, dy = math.cos(angle), math.sin(angle)
        step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
        each_x, each_y = 1 / max(abs(dx), 1e-12), 1 / max(abs(dy), 1e-12)
        next_x, next_y, x, y, length = 0.5 * each_x, 0.5 * each_y, column, row, 0.0
        while length <= reach and 0 <= x < nx and 0 <= y < ny:
            if wall[y, x]:
                probability[y, x] = 0.95
                break
            probability[y, x] = 0.05
            length = min(next_x, next_y)
            if next_x < next_y:
                x, next_x = x + step_x, next_x + each_x
            else:
                y, next_y = y + step_y, next_y + each_y


@compiled
def _path(cost: np.ndarray, start: int, goal: int, width: int) -> np.ndarray:
    """Cells of the cheapest path between 4-neighbours, by A* with a bucket for each total cost.

    It leads to the goal, or to the reachable cell nearest to it; `cost` is flat, 0 where nothing passes.
    """
    best, before = np.full(len(cost), 2**30, np.int32), np.full(len(cost), -1, np.int32)
    cells, links = np.empty(4 * len(cost), np.int32), np.empty(4 * len(cost), np.int32)
    heads, done = np.full(16, -1, np.int32), np.zeros(len(cost), np.bool_)
    goal_y, goal_x = goal // width, goal % width
    total = abs(start // width - goal_y) + abs(start % width - goal_x)
    count, waiting, nearest, gap = 1, 1, start, 2**30
    best[start], cells[0], links[0], heads[total % 16] = 0, start, -1, 0
    while waiting and gap:
        while heads[total % 16] < 0:
            total += 1
        here = cells[heads[total % 16]]
        heads[total % 16] = links[heads[total % 16]]
        waiting -= 1
        if done[here]:
            continue
        done[here] = True
        off = (here // width - goal_y) ** 2 + (here % width - goal_x) ** 2
        if off < gap:
            nearest, gap = here, off
        for step in (-width, -1, 1, width):
            there = here + step
            if cost[there] == 0 or done[there] or best[here] + cost[there] >= best[there]:
                continue
            best[there], before[there] = best[here] + cost[there], here
            bound = best[there] + abs(there // width - goal_y) + abs(there % width - goal_x)
            cells[count], links[count], heads[bound % 16] = there, heads[bound % 16], count
            count, waiting = count + 1, waiting + 1
    path = [nearest]
    while path[-1] != start:
        path.append(before[path[-1]])
    return np.array(path[::-1])


def explore(name: str, folder: Path, floor: str, start: int, steps: int) -> dict[str, Any]:
    """One run: coverage before each step and after the last, IoU at some, and seconds of a choice."""
    walk, explorer = LidarWalk(read_floor(folder, floor), start), make_explorer(name)
    coverage, iou, seconds = [walk.coverage()], [walk.iou()], 0.0
    for step in range(1, steps + 1):
        estimate, begin = walk.estimate(), time.process_time()
        goal = explorer.goal(estimate)
        seconds += time.process_time() - begin
        if goal is None:
            break
        walk.advance(goal)
        coverage.append(walk.coverage())
        if step % EVERY == 0:
            iou.append(walk.iou())
    # A run that ends sooner keeps its last values.
    return {
        "coverage": coverage + coverage[-1:] * (steps + 1 - len(coverage)),
        "iou": iou + [walk.iou()] * (steps // EVERY + 1 - len(iou)),
        "choice_s": seconds / len(coverage),
    }


def make_explorer(name: str) -> Explorer:
    """The published rules, or an explorer by its rating, with settings for this lidar."""
    if name == PUBLISHED:
        return PublishedNearest()
    if name == "learned":
        return learned_explorer(ExplorerConfig(turn_weight=0.0))
    return FrontierExplorer(config=ExplorerConfig(rating=cast(ExplorerName, name), **LIDAR))
