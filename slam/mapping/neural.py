"""Learned mapper: the classical mapper with a network that predicts obstacles in and behind each frame.

Pose, collisions and the surfaces for scan matching are those of the classical mapper. From the frame and the classical
map ahead the network predicts for each cell of the patch whether an obstacle stands there. Predictions of cells in view
replace the classical evidence in the observed map; predictions of other cells make the anticipated map, which
reaches behind furniture and round corners.

Predictions are averaged over time as log-odds, not added: each depends on the whole map already, and a sum would count
the same evidence repeatedly. Recent frames weigh more, so wrong cells clear; cells in view weigh more than guesses.
Memory: 6 bytes per cell near those that were seen in addition to the classical mapper's, and 8 per cell of maps of up
to 4 million cells.
Reference: Ramakrishnan et al., Occupancy anticipation for efficient exploration and navigation, ECCV 2020.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import cv2
import numpy as np
from jaxtyping import Float, Float16, Float32

from robosim.support.checks import Range, checked
from slam.actions import Command
from slam.graph.landmarks import Transmitter
from slam.graph.tracked_map import TrackedMap
from slam.grid import (
    LARGE_CELLS,
    ComputedGrid,
    GridFrame,
    MapEstimate,
    enlarged,
    filled_blocks,
    read_only,
    zeros,
)
from slam.mapping.classical import ClassicalMapper, MapperConfig
from slam.mapping.occupancy import probability_of
from slam.networks.map_network import MapNetwork, MapPredictor, Prediction
from slam.poses import Pose, to_map
from slam.robot import Robot
from slam.sensing.bearings import Bearing
from slam.sensing.egocentric import AHEAD, belief_ahead
from slam.sensing.laser import LaserScan


@dataclass(frozen=True, kw_only=True)
@checked
class FusionConfig:
    """How answers about patches become a map."""

    in_view: Annotated[float, Range(1e-6, 1)] = 0.5
    """Weight of a new answer against those before, for cells in view."""
    hidden: Annotated[float, Range(1e-6, 1)] = 0.3
    """Weight of a new answer against those before, for cells out of view."""
    limit: Annotated[float, Range(0.01, 1000)] = 5.0
    """Bound of the log-odds."""


class NeuralMapper:
    """Builds an observed and an anticipated map while finding the robot on it."""

    def __init__(
        self,
        network: MapNetwork,
        robot: Robot = Robot(),
        config: MapperConfig = MapperConfig(),
        fusion: FusionConfig | None = None,
    ) -> None:
        """Make a mapper."""
        self.classical = ClassicalMapper(robot, config)
        self.fusion = fusion or FusionConfig()
        self.network = network
        self._predictor = MapPredictor(network)
        # Predictions of the network lie ahead of the camera; from here on, in the robot's frame.
        x, y = AHEAD.origin_xy
        self.patch = replace(AHEAD, origin_xy=(x + robot.optics.ahead_m, y))
        self.reset(np.zeros(3))

    def reset(self, pose: Pose) -> None:
        """Forget everything and begin at a pose: x [m], y [m], yaw [rad] in `map`."""
        self.classical.reset(pose)
        self._laser_m = 0.0
        self.frame = self.classical.frame
        nothing = np.zeros(self.patch.shape, np.float32)
        self.prediction = Prediction(obstacle=nothing, seen=nothing)
        self._log_odds = zeros(self.frame.shape, np.float32)
        self._is_predicted = zeros(self.frame.shape, bool)
        self._viewed = zeros(self.frame.shape, bool)
        self._observed = np.full(self.frame.shape, 0.5, np.float32)
        self._anticipated = np.full(self.frame.shape, 0.5, np.float32)
        # Predictions of all entered frames, in half precision, to be entered again when poses change.
        self._predictions: list[Float16[np.ndarray, "2 ny nx"]] = []

    @property
    def collided(self) -> bool:
        """Whether the last action ended at something."""
        return self.classical.collided

    def update(
        self,
        depth: Float32[np.ndarray, "h w"],
        action: Command | None = None,
        odometry: Pose | None = None,
        laser: LaserScan | None = None,
        time_s: float | None = None,
        others: Float[np.ndarray, "k 3"] | None = None,
    ) -> MapEstimate:
        """Add the measurements after an action; see `ClassicalMapper.update`.

        A laser improves the pose, and covers cells that the network does not.
        """
        classical = self.classical.update(depth, action, odometry, laser, time_s, others)
        self._laser_m = 0.0 if laser is None else laser.max_range_m
        self._follow(classical.frame)
        self.prediction = self._predictor.predict(
            self.classical.scan, belief_ahead(classical, patch=self.patch)
        )
        for window in self.classical.redrawn:
            self._redraw(window)
        self._enter(self.prediction, classical.pose)
        if not self.classical.relocalizer.lost:
            halves = np.stack([self.prediction.obstacle, self.prediction.seen]).astype(np.float16)
            self._predictions.append(halves)
        self._refresh(classical)
        return self._combined(classical)

    def listen(self, bearings: Sequence[Bearing]) -> None:
        """See `ClassicalMapper.listen`."""
        self.classical.listen(bearings)

    def transmitters(self) -> dict[str, Transmitter]:
        """See `ClassicalMapper.transmitters`."""
        return self.classical.transmitters()

    def tracked_map(self) -> TrackedMap:
        """See `ClassicalMapper.tracked_map`."""
        return self.classical.tracked_map()

    def estimate(self) -> MapEstimate:
        """The maps and pose as they are now."""
        return self._combined(self.classical.estimate())

    def _combined(self, classical: MapEstimate) -> MapEstimate:
        return replace(
            classical,
            obstacle_probability=read_only(self._observed),
            anticipated_probability=read_only(self._anticipated),
        )

    def _refresh(self, classical: MapEstimate) -> None:
        """Update the part of the maps that one frame can change."""
        # The region of the prediction, of the camera, of a laser, and of the hull.
        reach = max(self.classical.hull.radius_m + self.frame.resolution_m, self._laser_m + 1.0)
        corners = np.vstack(
            [
                self._corners(classical.pose),
                self.classical.occupancy.view_box(self.classical.scan, classical.pose),
                classical.pose[:2] - reach,
                classical.pose[:2] + reach,
            ]
        )
        low, high = corners.min(axis=0), corners.max(axis=0)
        rows, columns, _ = self.frame.window((low[0], low[1]), (high[0], high[1]))
        self._combine(rows, columns)

    def _follow(self, frame: GridFrame) -> None:
        """Grow as the classical map has grown."""
        if frame == self.frame:
            return
        left, below = np.rint(frame.to_cells(np.array(self.frame.origin_xy))).astype(int)
        ny, nx = self.frame.shape
        blocks, left, below = filled_blocks(self._is_predicted), int(left), int(below)
        for name in ("_log_odds", "_is_predicted", "_viewed"):
            setattr(self, name, enlarged(getattr(self, name), frame.shape, left, below, blocks))
        self.frame = frame
        if self._log_odds.size <= LARGE_CELLS:
            for name in ("_observed", "_anticipated"):
                new = np.full(frame.shape, 0.5, np.float32)
                new[below : below + ny, left : left + nx] = getattr(self, name)
                setattr(self, name, new)

    def _enter(self, prediction: Prediction, pose: Pose) -> None:
        """Average a prediction into the cells that it covers."""
        rows, columns, column, row = self._covered(pose)
        ny, nx = self.patch.shape
        inside = (column >= 0) & (column <= nx - 1) & (row >= 0) & (row <= ny - 1)
        predicted, seen = (
            cv2.remap(patch, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for patch in (prediction.obstacle, prediction.seen)
        )
        in_view = inside & (seen > 0)
        viewed, covered = self._viewed[rows, columns], self._is_predicted[rows, columns]
        # A guess does not replace a cell that was in view.
        taken = in_view | (inside & ~viewed)
        weight = np.where(in_view, self.fusion.in_view, self.fusion.hidden).astype(np.float32)
        weight = np.where(in_view & ~viewed | ~covered, np.float32(1), weight)
        log_odds = self._log_odds[rows, columns]
        predicted = np.clip(predicted, -self.fusion.limit, self.fusion.limit)
        log_odds += np.where(taken, weight * (predicted - log_odds), np.float32(0))
        viewed |= in_view
        covered |= inside
        self._stand(pose)

    def _redraw(self, frame: GridFrame) -> None:
        """Draw a part of the map again at the current poses of the scans."""
        poses = np.array(self.classical.entered).reshape(-1, 3)[: len(self._predictions)]
        whole, (ny, nx) = self.frame, frame.shape
        left, below = np.rint(whole.to_cells(np.array(frame.origin_xy))).astype(int)
        rows, columns = slice(below, below + ny), slice(left, left + nx)
        low, high = frame.to_points(np.array([[0, 0], frame.shape[::-1]]))
        reach_m = np.hypot(*self._corners(np.zeros(3)).T).max()
        gap_m = np.maximum(low - poses[:, :2], poses[:, :2] - high).max(axis=1)
        layers = self._log_odds, self._is_predicted, self._viewed
        # Predictions are entered on the window alone, then it replaces that of the map.
        self.frame = frame
        self._log_odds = np.zeros(frame.shape, np.float32)
        self._is_predicted, self._viewed = np.zeros(frame.shape, bool), np.zeros(frame.shape, bool)
        for k in np.flatnonzero(gap_m < reach_m):
            obstacle, seen = self._predictions[k].astype(np.float32)
            self._enter(Prediction(obstacle=obstacle, seen=seen), poses[k])
        for layer, redrawn in zip(layers, (self._log_odds, self._is_predicted, self._viewed), strict=True):
            layer[rows, columns] = redrawn
        (self._log_odds, self._is_predicted, self._viewed), self.frame = layers, whole
        self._combine(rows, columns)

    def _combine(self, rows: slice, columns: slice) -> None:
        """Replace classical probabilities by predictions in a window of the observed and the anticipated map."""
        layers = self._log_odds, self._viewed, self._is_predicted, self.classical.occupancy.probability
        anticipated = _anticipated_around_laser if self._laser_m else _anticipated
        for name, compute in (("_observed", _observed), ("_anticipated", anticipated)):
            grid = ComputedGrid(compute, *layers)
            if grid.size > LARGE_CELLS:
                setattr(self, name, grid)
            else:
                getattr(self, name)[rows, columns] = grid[rows, columns]

    def _covered(
        self, pose: Pose
    ) -> tuple[slice, slice, Float32[np.ndarray, "ny nx"], Float32[np.ndarray, "ny nx"]]:
        """Window of the map around the patch, and where its cells' centres lie on it: column, row."""
        cell = self.patch.resolution_m
        x0, y0 = self.patch.origin_xy
        c, s = math.cos(pose[2]), math.sin(pose[2])
        corners = self._corners(pose)
        low, high = corners.min(axis=0), corners.max(axis=0)
        rows, columns, frame = self.frame.window((low[0], low[1]), (high[0], high[1]))
        x, y = frame.axes()
        x, y = x - pose[0], y - pose[1]
        column = ((c * x - x0) / cell - 0.5)[None, :] + (s * y / cell)[:, None]
        row = ((-s * x - y0) / cell - 0.5)[None, :] + (c * y / cell)[:, None]
        return rows, columns, column.astype(np.float32), row.astype(np.float32)

    def _corners(self, pose: Pose) -> Float[np.ndarray, "4 2"]:
        """Corners of the patch ahead of a pose (x, y) [m]."""
        cell = self.patch.resolution_m
        (x0, y0), (ny, nx) = self.patch.origin_xy, self.patch.shape
        return to_map(pose, np.array([(x, y) for x in (x0, x0 + nx * cell) for y in (y0, y0 + ny * cell)]))

    def _stand(self, pose: Pose) -> None:
        """Where the hull is, nothing else stands."""
        rows, columns, under = self.frame.under(pose, self.classical.hull, 0.5 * self.frame.resolution_m)
        self._log_odds[rows, columns][under] = np.minimum(self._log_odds[rows, columns][under], -1.0)
        for known in (self._is_predicted, self._viewed):
            known[rows, columns] |= under


def _observed(log_odds: np.ndarray, viewed: np.ndarray, _: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Predictions of cells in view, and classical probabilities of others."""
    return np.where(viewed, probability_of(log_odds), known)


def _anticipated(log_odds: np.ndarray, _: np.ndarray, covered: np.ndarray, known: np.ndarray) -> np.ndarray:
    """All predictions, and classical probabilities of other cells."""
    return np.where(covered, probability_of(log_odds), known)


def _anticipated_around_laser(
    log_odds: np.ndarray, viewed: np.ndarray, covered: np.ndarray, known: np.ndarray
) -> np.ndarray:
    """Predictions of cells in view and where a laser has not measured, and classical probabilities of others."""
    return np.where(covered & (viewed | (known == 0.5)), probability_of(log_odds), known)
