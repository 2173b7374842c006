"""Where to look next: frontiers between what the camera has seen and what it has not.

A frontier is a run of seen, free cells beside unseen ones. One travel-time field from the robot prices the way to
all of them; the few cheapest are then priced in decisions (turns of 10 degrees and steps of a quarter metre) along the
real way, and rated by the unseen area that could be looked at from there. "nearest" takes the cheapest, the named
baseline; "gain" lets seen area make up for decisions. The goal is kept until its frontier is gone or another one is
clearly better, and a frontier that stays although the robot stands before it is given up.
Reference: Yamauchi, A frontier-based approach for autonomous exploration, CIRA 1997.
"""

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float, Int

from slam.actions import FORWARD_M, TURN_RAD
from slam.cost_map import EASES, Box, CostConfig, cost_map, cut_box, known_box
from slam.grid import GridFrame, MapEstimate
from slam.paths import downhill, taut
from slam.poses import wrap
from slam.travel_time import TravelTime, travel_time


@dataclass(frozen=True, kw_only=True)
class ExplorerConfig:
    """How frontiers are found and rated."""

    rating: Literal["gain", "nearest"] = "gain"
    """Let the area that can be seen make up for the way, or take the nearest frontier."""
    cost: CostConfig = field(default_factory=CostConfig)
    """What a metre costs."""
    view_m: float = 3.2
    """Range of the camera that counts as seeing [m]."""
    min_cells: int = 3
    """Shorter frontiers are ignored [cells]."""
    gain_weight: float = 10.0
    """Decisions that a square metre of unseen area is worth."""
    max_gain_m2: float = 5.0
    """More unseen area than this makes a frontier no better [m^2]."""
    depth_m: float = 1.5
    """Depth of unseen space behind a frontier [m]: its length times this bounds the area."""
    keep: float = 4.0
    """Decisions by which another frontier must be better before the goal is changed."""
    candidates: int = 10
    """Frontiers whose way is priced exactly."""
    every: int = 8
    """Decisions after which frontiers are rated anew even if the goal still stands."""
    patience: int = 12
    """Decisions near a frontier that shows nothing new after which it is given up."""

    def __post_init__(self) -> None:
        if self.rating not in ("gain", "nearest"):
            raise ValueError(f"rating = {self.rating!r}, expected 'gain' or 'nearest'.")
        if self.min_cells < 1 or self.candidates < 1 or self.every < 1:
            raise ValueError(
                f"min_cells = {self.min_cells}, candidates = {self.candidates}, every = {self.every}, "
                "expected at least 1 each."
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Frontier:
    """A run of seen cells beside unseen ones."""

    cells: Int[np.ndarray, "n 2"]
    """Rows and columns in the window."""
    look_xy: Float[np.ndarray, "2"]
    """Its middle cell [m]: seen itself, beside what is to be looked at."""
    stand: tuple[int, int]
    """Row and column in the window of the cell to go to."""
    cost_m: float
    """Cost of the way there [m]."""


class FrontierExplorer:
    """Chooses goals one after another until nothing is left to see."""

    def __init__(self, config: ExplorerConfig = ExplorerConfig()):
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Forget goal and frontiers given up."""
        self._goal: Float[np.ndarray, 2] | None = None
        self._given_up: list[tuple[float, float]] = []
        self._age = 0
        self._waited = 0
        self._budget = 0.0
        self._spin = 0
        self._looked_around: list[Float[np.ndarray, 2]] = []

    def goal(self, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """The spot to go to and look at, in `map` [m]; None when nothing is left to see.

        Args:
            estimate: Map and pose.
        """
        if self._spin:
            self._spin -= 1
            return estimate.pose[:2]
        self._age += 1
        self._budget -= 1
        if self._goal is not None and self._age < self.config.every and self._still_there(estimate):
            return self._goal
        self._goal = self._choose(estimate)
        self._age = 0
        if self._goal is None and self._look_around(estimate.pose[:2]):
            return estimate.pose[:2]
        return self._goal

    def _look_around(self, here: Float[np.ndarray, "2"]) -> bool:
        """Before all is taken to be seen: turn once, unless that was done here, and give frontiers another chance.

        A robot that begins in a niche has all that is left to see behind its back.
        """
        if any(np.hypot(*(here - place)) < 0.5 for place in self._looked_around):
            return False
        self._looked_around.append(here.copy())
        self._given_up.clear()
        self._spin = round(2 * math.pi / TURN_RAD)
        return True

    def _still_there(self, estimate: MapEstimate) -> bool:
        """Whether the spot to look at is unseen yet; gives it up when looking does not help."""
        assert self._goal is not None
        r = 2 * estimate.frame.resolution_m
        x, y = self._goal
        rows, columns, _ = estimate.frame.window((x - r, y - r), (x + r, y + r))
        unseen = ~estimate.explored[rows, columns] & (estimate.obstacle_probability[rows, columns] <= 0.5)
        if not unseen.any():
            return False
        near = np.hypot(*(self._goal - estimate.pose[:2])) < 0.6
        self._waited = self._waited + 1 if near else 0
        if self._waited > self.config.patience or self._budget < 0:
            self._given_up.append((float(x), float(y)))
            self._waited = 0
            return False
        return True

    def _choose(self, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """The best frontier's goal; where bumps alone cut off all of them, they are disregarded."""
        low, high = known_box(estimate)
        margin = 2 * estimate.frame.resolution_m
        low, high = low - margin, high + margin
        for ease in EASES:
            box = cut_box(estimate, low, high, ease)
            window = cost_map(box, self.config.cost, ease)
            window = replace(window, passable=window.passable & (box.probability < 0.5))
            window = window.reachable_from(estimate.pose[:2]).halved()
            here = window.cell(estimate.pose[:2])
            way = travel_time(window.frame, window.cost.astype(float), window.passable, here)
            frontiers = self._frontiers(box, way)
            if frontiers:
                break
        if not frontiers:
            return None
        frontiers.sort(key=lambda f: f.cost_m)
        rated = []
        frame_m = box.frame.resolution_m
        for f in frontiers[: self.config.candidates]:
            decisions = self._decisions(way, f, estimate.pose)
            gain = min(self._gain(box, f), self.config.depth_m * len(f.cells) * frame_m)
            rating = decisions
            if self.config.rating == "gain":
                rating -= self.config.gain_weight * min(gain, self.config.max_gain_m2)
            if self._goal is not None and np.hypot(*(f.look_xy - self._goal)) < 0.5:
                rating -= self.config.keep
            rated.append((rating, decisions, f))
        rating, decisions, best = min(rated, key=lambda r: r[0])
        if self._goal is None or np.hypot(*(best.look_xy - self._goal)) > 0.5:
            self._budget = 3 * decisions + 40
            self._waited = 0
        return best.look_xy

    def _frontiers(self, box: Box, way: TravelTime) -> list[Frontier]:
        """Frontiers that the robot can get near to."""
        frame = box.frame
        unseen = ~box.explored & (box.probability <= 0.5)
        beside = cv2.dilate(unseen.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        edge = box.explored & (box.probability < 0.5) & beside
        for x, y in self._given_up:
            r = 0.25
            rows, columns, _ = frame.window((x - r, y - r), (x + r, y + r))
            edge[rows, columns] = False
        count, label = cv2.connectedComponents(edge.astype(np.uint8), connectivity=8)
        # The cost of getting near: least cost within about half a metre of each cell.
        reach = np.where(np.isfinite(way.cost_m), way.cost_m, 1e6).repeat(2, axis=0).repeat(2, axis=1)
        iy, ix = np.nonzero(edge)
        order = np.argsort(label[iy, ix], kind="stable")
        iy, ix = iy[order], ix[order]
        starts = np.searchsorted(label[iy, ix], np.arange(1, count + 1))
        found = []
        for a, b in pairwise(starts):
            if b - a < self.config.min_cells:
                continue
            f = _frontier(frame, np.column_stack([iy[a:b], ix[a:b]]), reach)
            if f is not None:
                found.append(f)
        return found

    def _decisions(self, way: TravelTime, f: Frontier, pose: Float[np.ndarray, "3"]) -> float:
        """Turns and steps that the way to a frontier takes."""
        points = downhill(way, (f.stand[0] // 2, f.stand[1] // 2))
        corners = np.vstack([pose[:2], taut(points, way)[-2::-1], f.look_xy])
        legs = np.diff(corners, axis=0)
        length = np.hypot(*legs.T)
        legs, length = legs[length > 0.1], length[length > 0.1]
        if not len(legs):
            return 0.0
        yaw = np.concatenate([[pose[2]], np.arctan2(legs[:, 1], legs[:, 0])])
        turns = sum(abs(wrap(float(d))) for d in np.diff(yaw)) / TURN_RAD
        return turns + max(0.0, float(length.sum()) - 0.5) / FORWARD_M

    def _gain(self, box: Box, f: Frontier) -> float:
        """Unseen area in view from a frontier [m^2], if what is unknown were open."""
        frame, (y, x) = box.frame, f.stand
        angles = np.arange(60) * (2 * math.pi / 60)
        reach = np.arange(1, int(self.config.view_m / frame.resolution_m / 2)) * 2.0
        iy = np.rint(y + np.sin(angles)[:, None] * reach).astype(int)
        ix = np.rint(x + np.cos(angles)[:, None] * reach).astype(int)
        inside = frame.inside(iy, ix)
        iy, ix = np.where(inside, iy, 0), np.where(inside, ix, 0)
        open_ = np.logical_and.accumulate(~inside | (box.probability[iy, ix] <= 0.5), axis=1)
        new = open_ & (~inside | ~box.explored[iy, ix])
        # Each sample stands for a piece of its ring.
        piece = reach * (2 * math.pi / 60) * 2.0 * frame.resolution_m**2
        return float((new * piece).sum())


def _frontier(
    frame: GridFrame,
    cells: Int[np.ndarray, "n 2"],
    reach: Float[np.ndarray, "ny nx"],
) -> Frontier | None:
    """A frontier with the cell to go to; None if the robot cannot get near."""
    cost = reach[cells[:, 0], cells[:, 1]]
    k = int(np.argmin(cost))
    stand = (int(cells[k, 0]), int(cells[k, 1]))
    if cost[k] >= 1e6:
        stand, least = _nearest_reachable(reach, cells)
        if least >= 1e6:
            return None
    middle = cells[int(np.argmin(((cells - cells.mean(axis=0)) ** 2).sum(axis=1)))]
    return Frontier(
        cells=cells,
        look_xy=frame.to_points(middle[::-1] + 0.5),
        stand=stand,
        cost_m=float(reach[stand]),
    )


def _nearest_reachable(
    reach: Float[np.ndarray, "ny nx"], cells: Int[np.ndarray, "n 2"]
) -> tuple[tuple[int, int], float]:
    """Cheapest cell within half a metre of a frontier's middle."""
    y, x = (int(v) for v in cells[len(cells) // 2])
    n = 10
    y0, x0 = max(y - n, 0), max(x - n, 0)
    part = reach[y0 : y + n + 1, x0 : x + n + 1]
    k = int(np.argmin(part))
    iy, ix = divmod(k, part.shape[1])
    return (iy + y0, ix + x0), float(part[iy, ix])
