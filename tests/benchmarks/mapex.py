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
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.figure import Figure
from tyro.conf import OmitArgPrefixes, Positional

from robosim.support.installation import shipped_network
from robosim_support.compiled import compiled
from slam.exploration.choosing import load_chooser
from slam.exploration.explorer import LEARNED, ExplorerConfig, FrontierExplorer
from slam.grid import GridFrame, MapEstimate
from tests.benchmarks.harness import DEFAULT, Options, figure_of, run_units
from tests.benchmarks.results import Results

#: Side of a cell [m], steps of a run, cells of a step, and steps between scores of the map.
CELL_M, STEPS, STRIDE, EVERY = 0.1, 1000, 3, 50
#: Range [cells] and rays of the lidar.
REACH, RAYS = 200, 2500
#: Cost of a cell next to what is occupied or unknown, and least size of a published frontier [cells].
WORST, REGION = 10, 10
#: Distance to a goal at which the published rules choose again [cells].
NEAR = 10
PUBLISHED = "published nearest"
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
    names = floors or tuple(sorted(path.name[:-8] for path in folder.glob("*_occ.png")))
    rows = (PUBLISHED, *explorers)
    units = {
        f"{explorer}, {name}, {start}": (explorer, folder, name, start, steps)
        for explorer in rows
        for name in names
        for start in range(4)
    }
    found = run_units(explore, units, options.folder("mapex"), workers=options.workers)
    results = Results()
    curves = {row: [one for key, one in found.items() if key.startswith(f"{row}, ")] for row in rows}
    for row in rows:
        summarise(row, curves[row], curves[PUBLISHED], names, results)
    results.figures = {"mapex": draw(curves)}
    return options.finish("mapex", results)


def summarise(
    row: str,
    runs: Sequence[Mapping[str, Any]],
    published: Sequence[Mapping[str, Any]],
    names: Sequence[str],
    results: Results,
) -> None:
    """Add the scores of one explorer: areas under coverage, ratios to the published choice, IoU and time."""
    coverage = np.array([run["coverage"] for run in runs])
    area = np.array([area_under(curve) for curve in coverage])
    other = np.array([area_under(np.array(run["coverage"])) for run in published])
    ratio, low, high = geometric_mean(area / other)
    add = results.add
    add("mapex", row, "area under coverage", area.mean(), digits=3, cases=len(area))
    add("mapex", row, "ratio", ratio, digits=3, spread=(low, high), cases=len(area))
    for steps in (250, 500, 1000):
        at = min(steps, coverage.shape[1] - 1)
        add("mapex", row, f"seen after {steps}", 100 * coverage[:, at].mean(), "%", digits=1, cases=len(area))
    iou = np.array([run["iou"] for run in runs])
    add("mapex", row, "mean IoU", iou.mean(), digits=3, cases=len(area))
    add("mapex", row, "choice", 1e3 * np.mean([run["choice_s"] for run in runs]), "ms", digits=1)
    for k, name in enumerate(names):
        part = (area / other)[4 * k : 4 * k + 4]
        add("mapex floors", name, row, geometric_mean(part)[0], digits=2, cases=4)


def geometric_mean(ratios: Float[np.ndarray, " n"]) -> tuple[float, float, float]:
    """Geometric mean of ratios, with its 95 % interval by bootstrap."""
    logs = np.log(ratios)
    drawn = np.random.default_rng(0).integers(len(logs), size=(2000, len(logs)))
    low, high = np.quantile(logs[drawn].mean(axis=1), [0.025, 0.975])
    return math.exp(logs.mean()), math.exp(low), math.exp(high)


def area_under(coverage: Float[np.ndarray, " n"]) -> float:
    """Area under coverage over steps, by trapezoids, divided by its width: 0 to 1."""
    return float(np.trapezoid(coverage) / (len(coverage) - 1))


def draw(curves: Mapping[str, Sequence[Mapping[str, Any]]]) -> Figure:
    """Mean coverage and IoU over steps, by explorer."""
    figure, (left, right) = figure_of(2)
    for row, runs in curves.items():
        for axes, name, every in ((left, "coverage", 1), (right, "iou", EVERY)):
            mean = np.mean([run[name] for run in runs], axis=0)
            axes.plot(every * np.arange(len(mean)), mean, label=row)
    left.set(xlabel="steps", ylabel="coverage")
    right.set(xlabel="steps", ylabel="IoU of occupied cells")
    left.legend()
    return figure


@dataclass(frozen=True, kw_only=True, eq=False)
class Floor:
    """A floor, with rows from below."""

    wall: Bool[np.ndarray, "ny nx"]
    """What stops robot and rays: walls, and what is outside."""
    drawn: Bool[np.ndarray, "ny nx"]
    """Walls of the drawing, with which a map is compared."""
    rooms: Bool[np.ndarray, "ny nx"]
    """Cells over which coverage is counted."""
    starts: tuple[tuple[int, int], ...]
    """Rows and columns."""


def read_floor(folder: Path, name: str) -> Floor:
    """Read a floor from pictures of 0.05 m per pixel, a quarter as many cells; a cell with any wall is a wall.

    Raises:
        ValueError: If a picture is missing.
    """
    pictures = [
        cv2.imread(str(folder / f"{name}_{part}.png"), cv2.IMREAD_GRAYSCALE) for part in ("occ", "rooms")
    ]
    if any(picture is None for picture in pictures):
        raise ValueError(f"{folder} has no {name}_occ.png and {name}_rooms.png, expected both.")
    drawn, rooms = (_halved(mask) for mask in (pictures[0] == 0, pictures[1] > 0))
    # The outside is what is free and connected to the border, unless the outline leaks into rooms.
    part = cv2.connectedComponents(np.pad(~drawn, 1, constant_values=True).astype(np.uint8), connectivity=4)[
        1
    ]
    outside = (part == part[0, 0])[1:-1, 1:-1]
    wall = drawn | outside if not (outside & rooms).mean() > 0.01 else drawn
    starts = STARTS.get(name) or _corners(rooms & ~wall)
    rows = len(wall) - 1
    return Floor(
        wall=wall[::-1].copy(),
        drawn=drawn[::-1].copy(),
        rooms=rooms[::-1].copy(),
        starts=tuple((rows - row, column) for row, column in starts),
    )


def _halved(mask: Bool[np.ndarray, "ny nx"]) -> Bool[np.ndarray, "my mx"]:
    """Cells twice as large that hold any marked cell."""
    even = np.pad(mask, [(0, n % 2) for n in mask.shape])
    return np.asarray(even[::2, ::2] | even[1::2, ::2] | even[::2, 1::2] | even[1::2, 1::2])


def _corners(free: Bool[np.ndarray, "ny nx"]) -> tuple[tuple[int, int], ...]:
    """The place with half a metre around it that is nearest to each corner, on the largest connected part."""
    space = cv2.erode(free.astype(np.uint8), np.ones((5, 5), np.uint8))
    label, sizes = cv2.connectedComponentsWithStats(space)[1:3]
    cells = np.argwhere(label == 1 + np.argmax(sizes[1:, cv2.CC_STAT_AREA]))
    ends = [(row, column) for row in (0, len(free) - 1) for column in (0, free.shape[1] - 1)]
    nearest = [cells[np.argmin(((cells - end) ** 2).sum(axis=1))] for end in ends]
    return tuple((int(row), int(column)) for row, column in nearest)


class Chooser(Protocol):
    """Interface of explorers."""

    def goal(self, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """Where to go [m]; None ends the run."""


class PublishedNearest:
    """The published rules for the nearest frontier, by straight distance."""

    def __init__(self) -> None:
        self._goal: Int[np.ndarray, 2] | None = None

    def goal(self, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """Where to go [m]; None if no frontier is left."""
        here = np.array(estimate.frame.index(estimate.pose[:2]))
        known, passable = estimate.explored, planning_cost(estimate) > 0
        passable[tuple(here)] = True
        part = cv2.connectedComponents(passable.astype(np.uint8), connectivity=4)[1]
        reach = part == part[tuple(here)]
        if self._goal is None or not self._is_valid(self._goal, here, reach):
            centres = sorted(
                _regions(known, estimate.known_free), key=lambda c: float(((c - here) ** 2).sum())
            )
            self._goal = next((one for one in centres if self._is_valid(one, here, reach)), None)
        return None if self._goal is None else estimate.frame.to_points(self._goal[::-1] + 0.5)

    @staticmethod
    def _is_valid(
        goal: Int[np.ndarray, "2"], here: Int[np.ndarray, "2"], passable: Bool[np.ndarray, "ny nx"]
    ) -> bool:
        return bool(passable[tuple(goal)] and math.hypot(*(goal - here)) >= NEAR)


def _regions(known: Bool[np.ndarray, "ny nx"], free: Bool[np.ndarray, "ny nx"]) -> list[Int[np.ndarray, "2"]]:
    """The cell (row, column) of each frontier that is nearest to its mean."""
    edge = free & (cv2.dilate((~known).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
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
        shape = floor.wall.shape
        self._frame = GridFrame(origin_xy=(0.0, 0.0), resolution_m=CELL_M, shape=shape)
        self._probability = np.full(shape, 0.5, np.float32)
        self._cell, self._yaw = floor.starts[start], 0.0
        self._look()

    @property
    def coverage(self) -> float:
        """Share of the rooms' cells that are known."""
        known = self._probability[self.floor.rooms] != 0.5
        return float(known.mean())

    @property
    def iou(self) -> float:
        """IoU of occupied cells of the map with the drawing."""
        found = self._probability > 0.5
        return float((found & self.floor.drawn).sum() / (found | self.floor.drawn).sum())

    def estimate(self) -> MapEstimate:
        """What the robot knows."""
        row, column = self._cell
        return MapEstimate(
            frame=self._frame,
            obstacle_probability=self._probability,
            explored=self._probability != 0.5,
            blocked=np.zeros(self._frame.shape, bool),
            pose=np.array([(column + 0.5) * CELL_M, (row + 0.5) * CELL_M, self._yaw]),
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
        self._look()

    def _look(self) -> None:
        """Enter what the lidar sees."""
        _scan(self.floor.wall, self._probability, *self._cell, REACH, RAYS)


@compiled
def _scan(wall: np.ndarray, probability: np.ndarray, row: int, column: int, reach: int, rays: int) -> None:
    """Mark the cells that rays from the centre of a cell cross as free, and the first wall as occupied.

    Reference: Amanatides and Woo, A fast voxel traversal algorithm, Eurographics 1987.
    """
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
    n_buckets = 16
    best = np.full(len(cost), 2**30, np.int32)
    before = np.full(len(cost), -1, np.int32)
    cells, links = np.empty(4 * len(cost), np.int32), np.empty(4 * len(cost), np.int32)
    heads = np.full(n_buckets, -1, np.int32)
    goal_y, goal_x = goal // width, goal % width
    done = np.zeros(len(cost), np.bool_)
    total = abs(start // width - goal_y) + abs(start % width - goal_x)
    count, waiting, nearest, gap = 1, 1, start, 2**30
    best[start], cells[0], links[0], heads[total % n_buckets] = 0, start, -1, 0
    while waiting:
        while heads[total % n_buckets] < 0:
            total += 1
        entry = heads[total % n_buckets]
        heads[total % n_buckets] = links[entry]
        here = cells[entry]
        waiting -= 1
        if done[here]:
            continue
        done[here] = True
        off = (here // width - goal_y) ** 2 + (here % width - goal_x) ** 2
        if off < gap:
            nearest, gap = here, off
        if off == 0:
            break
        for step in (-width, -1, 1, width):
            there = here + step
            if cost[there] == 0 or done[there] or best[here] + cost[there] >= best[there]:
                continue
            best[there], before[there] = best[here] + cost[there], here
            bound = best[there] + abs(there // width - goal_y) + abs(there % width - goal_x)
            cells[count], links[count] = there, heads[bound % n_buckets]
            heads[bound % n_buckets] = count
            count, waiting = count + 1, waiting + 1
    path = [nearest]
    while path[-1] != start:
        path.append(before[path[-1]])
    return np.array(path[::-1])


def explore(name: str, folder: Path, floor: str, start: int, steps: int) -> dict[str, Any]:
    """One run: coverage before each step and after the last, IoU at some, and seconds of a choice."""
    walk, explorer = LidarWalk(read_floor(folder, floor), start), make_explorer(name)
    coverage, iou, seconds = [walk.coverage], [walk.iou], 0.0
    for step in range(1, steps + 1):
        estimate, begin = walk.estimate(), time.process_time()
        goal = explorer.goal(estimate)
        seconds += time.process_time() - begin
        if goal is None:
            break
        walk.advance(goal)
        coverage.append(walk.coverage)
        if step % EVERY == 0:
            iou.append(walk.iou)
    # A run that ends sooner keeps its last values.
    taken = len(coverage)
    return {
        "coverage": coverage + [walk.coverage] * (steps + 1 - taken),
        "iou": iou + [walk.iou] * (steps // EVERY + 1 - len(iou)),
        "steps": taken - 1,
        "choice_s": seconds / taken,
    }


def make_explorer(name: str) -> Chooser:
    """The published rules, or an explorer by its rating, with settings for this lidar."""
    if name == PUBLISHED:
        return PublishedNearest()
    if name == "learned":
        config = ExplorerConfig(rating=name, turn_weight=0.0, **LEARNED)
        return FrontierExplorer(config, load_chooser(shipped_network("explorer")))
    return FrontierExplorer(
        ExplorerConfig(
            rating=name,
            turn_weight=0.0,
            min_cells=8,
            piece_m=4.0,
            view_m=6.0,
            depth_m=6.0,
            max_gain_m2=30.0,
            gain_weight=2.0,
        )
    )
