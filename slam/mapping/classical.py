"""Classical mapper: map and pose from depth images, laser scans and odometry.

At every decision: odometry without its bias predicts the pose, the scan is fitted to the surfaces on the map, and then
entered at the pose found. Occupancy (free space), surfaces (exact walls) and collision marks share one grid that
grows with the building.

Memory: 27 bytes per cell near those that were seen, in pages of 4 kB, and 4 more on maps of up to 4 million cells; what
lies outside of a rectangle of `max_area_m2` is dropped.
A pose whose scan contradicts the map is doubted: the robot is searched for farther away, and scans are not entered
until it is found (`relocalization`).
Where loops close, poses of the past move (`slam.graph`). A small map is drawn again from all scans; of a large one, the
tiles in which scans have moved, those around the robot at once and others later, so that the time per decision is
bounded.
Reference: Kohlbrecher et al., A flexible and scalable SLAM system with full 3D motion estimation, SSRR 2011.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32, Int

from robosim.support.checks import Range, checked
from robosim.support.compiled import delayed_signals
from slam.actions import Command
from slam.graph.landmarks import Transmitter
from slam.graph.submaps import View
from slam.graph.tracked_map import TrackedMap
from slam.graph.tracker import Tracker
from slam.graph.tracker_config import TrackerConfig
from slam.grid import GridFrame, MapEstimate, read_only
from slam.mapping.collisions import CollisionMarks
from slam.mapping.moving import MovingConfig, MovingThings
from slam.mapping.occupancy import OccupancyConfig, OccupancyGrid
from slam.mapping.relocalization import RelocalizationConfig, Relocalizer
from slam.matching.levels import ARM_M
from slam.matching.scan_matching import Match, MatchConfig, ScanPoints, points_of_beams, points_of_scan
from slam.matching.surfaces import SurfaceGrid
from slam.odometry import OdometryCorrector
from slam.poses import Covariance, Pose, between, rotation, wrap
from slam.robot import Robot
from slam.sensing.bearings import Bearing
from slam.sensing.laser import LaserScan
from slam.sensing.projection import Band, Scan, scan_from_depth

logger = logging.getLogger(__name__)

#: Cells added at once when the view leaves the map.
GROWTH_CELLS = 80
#: Moving things nearer than this may stop the robot [m].
_NEAR_THING_M = 0.8
#: Depths beyond this serve to match poses, but are too coarse for the map [m].
_DRAWN_M = 6.0
#: The map is drawn again once a pose has changed by this many cells, with all poses that changed by the second.
_SHOWS, _MOVED = 0.3, 0.1
#: Maps of at most this many scans are drawn again as a whole.
_WHOLE_SCANS = 500
#: Side of the tiles of larger maps [m], and how many around the robot's are drawn again at once.
_TILE_M, _TILES_AROUND = 6.0, 1
#: Scans that each decision adds to the budget for other tiles, and the most that it may hold.
_SCANS_PER_DECISION, _MOST_SCANS = 3, 300


@dataclass(frozen=True, kw_only=True)
@checked
class MapperConfig:
    """Settings of the classical mapper."""

    resolution_m: Annotated[float, Range(0.005, 0.5, "m")] = 0.05
    """Side of a map cell [m]."""
    max_area_m2: Annotated[float, Range(400, 1e6, "m2", "The camera sees 10 m far.")] = 1e6
    """Area to which the map may grow [m^2]; bounds the memory."""
    band: Band = field(default_factory=Band)
    """Heights above the floor that stop the robot."""
    occupancy: OccupancyConfig = field(default_factory=OccupancyConfig)
    """Weight and reach of the evidence."""
    match: MatchConfig = field(default_factory=MatchConfig)
    """Settings of scan matching."""
    relocalization: RelocalizationConfig = field(default_factory=RelocalizationConfig)
    """When the robot counts as lost."""
    tracking: TrackerConfig = field(default_factory=TrackerConfig)
    """Settings of the tracker; cells and matching are those above."""
    moving: MovingConfig = field(default_factory=MovingConfig)
    """Whether and how people and other moving things are tracked and left out of the map."""


@runtime_checkable
class Mapper(Protocol):
    """Interface of mappers."""

    @property
    def collided(self) -> bool:
        """Whether the last action ended at an obstacle."""

    def reset(self, pose: Pose) -> None:
        """Forget everything and begin at a pose: x [m], y [m], yaw [rad] in `map`."""

    def update(
        self, depth: Float32[np.ndarray, "h w"], action: Command | None = None, odometry: Pose | None = None
    ) -> MapEstimate:
        """Add the measurements after an action; see `ClassicalMapper.update`.

        A mapper with arguments `laser` (the scan of a lidar), `time_s` (the time since the last update [s], where
        others move) and `others` (known places of other robots) is given them too.
        """

    def estimate(self) -> MapEstimate:
        """Return the current map and pose."""

    def listen(self, bearings: Sequence[Bearing]) -> None:
        """Add bearings of radio sources from the pose of the last update; by default they are not used."""
        return

    def transmitters(self) -> dict[str, Transmitter]:
        """Positions of sources that were in line of sight, by name; by default none is estimated."""
        return {}

    def tracked_map(self) -> TrackedMap | None:
        """Return submaps and their graph, by which maps of robots are matched; by default there are none."""
        return None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Frame:
    """Data needed to enter a frame again at another pose."""

    scan: Scan
    points: ScanPoints
    """Those that are drawn."""
    lowest: float
    """Fall of the lowest image row per metre of depth."""
    laser: LaserScan | None
    circle: tuple[float, float, float]
    """Centre (x, y) and radius [m] of a circle around all that it can change, in the robot's frame."""


class ClassicalMapper:
    """Builds a map and estimates the pose of the robot."""

    def __init__(self, robot: Robot = Robot(), config: MapperConfig = MapperConfig()):
        """Make a mapper.

        Args:
            robot: Its hull, height, camera and errors of odometry.
            config: Settings.
        """
        self.robot, self.config, self.hull, self.camera = robot, config, robot.hull, robot.optics
        self.reset(np.zeros(3))

    def reset(self, pose: Pose) -> None:
        """Forget everything and begin at a pose: x [m], y [m], yaw [rad] in `map`."""
        config = self.config
        cell, half = config.resolution_m, 2 * GROWTH_CELLS
        corner = [(math.floor(pose[k] / cell) - half) * cell for k in (0, 1)]
        frame = GridFrame(origin_xy=(corner[0], corner[1]), resolution_m=cell, shape=(2 * half, 2 * half))
        self.frame = frame
        self.occupancy = OccupancyGrid(frame, config.occupancy)
        self.surfaces = SurfaceGrid(frame)
        self.marks = CollisionMarks(frame, self.hull, motions=self.robot.motions)
        self.odometry = OdometryCorrector(self.robot.errors)
        self.relocalizer = Relocalizer(config.relocalization)
        tracking = replace(config.tracking, cell_m=cell, match=config.match)
        self.tracker = Tracker(tracking)
        self.tracker.reset(np.array([pose[0], pose[1], wrap(float(pose[2]))]))
        self.moving = MovingThings(config.moving) if config.moving.tracks else None
        self._frames: list[_Frame] = []
        self.entered: list[Float[np.ndarray, 3]] = []
        """Poses at which the scans are drawn."""
        self.redrawn: list[GridFrame] = []
        """Parts of the map that the last update drew again."""
        self._stale: set[tuple[int, int]] = set()
        self._budget = _MOST_SCANS
        self._is_full = False
        self.pose = np.array([pose[0], pose[1], wrap(float(pose[2]))])
        self.collided = False
        self._step = 0

    @delayed_signals()
    def update(
        self,
        depth: Float32[np.ndarray, "h w"],
        action: Command | None = None,
        odometry: Pose | None = None,
        laser: LaserScan | None = None,
        time_s: float | None = None,
        others: Float[np.ndarray, "k 3"] | None = None,
    ) -> MapEstimate:
        """Add the measurements after an action.

        Args:
            depth: Depth image at the new pose [m]; 0 or not finite where nothing was measured.
            action: The action that led here; None at the first frame.
            odometry: Measured displacement in the robot's frame before the action: x, y [m], yaw [rad].
            laser: What the robot's laser scanner measured, if it has one.
            time_s: Time since the last update, for velocities of moving things.
            others: Other robots where nothing else moves, as disks: x, y, radius [m]; None if their places are unknown.

        Returns:
            Map and pose; the arrays are views that the next update changes.
        """
        self._step += 1
        scan = scan_from_depth(depth, self.camera, self.config.band)
        displacement, covariance = self._measured(action, odometry)
        start, open_before = self.pose, self.tracker.covariance
        predicted, prior = self.tracker.predict(displacement, covariance)
        if self.moving is not None:
            grid = self.occupancy
            scan, laser = self.moving.leave_out(
                scan, laser, predicted, grid.probability, self.frame, time_s, others
            )
        self.scan = scan
        points = points_of_scan(scan, self.config.match, self.config.resolution_m)
        points = _ahead(points, scan.ahead_m)
        drawn, view = points.within(_DRAWN_M), view_of_scan(scan)
        if laser is not None:
            beams = points_of_beams(
                laser.bearing_rad,
                laser.range_m,
                laser.max_range_m,
                self.config.resolution_m,
                self.config.match.sigma_m,
            )
            beams = _ahead(beams, laser.ahead_m)
            points, drawn, view = points.with_more(beams), drawn.with_more(beams), view_of_laser(laser)
        match = self.tracker.match(points, view)
        match, doubted = self.relocalizer.judge(
            match,
            drawn,
            displacement,
            math.sqrt(prior[0, 0] + prior[1, 1]),
            self.occupancy,
            self.surfaces,
            self.config.match,
            self.camera.height_m,
        )
        # A NaN reading must not enter the learned bias, where it would stay forever.
        if action is not None and odometry is not None and np.isfinite(odometry).all() and not doubted:
            self._learn(action, odometry, start, open_before, match)
        if doubted and not self.relocalizer.lost:
            self.tracker.jump(match, points)
        self.redrawn = []
        if not self.relocalizer.lost:
            lowest = float(self.camera.slopes(depth.shape)[1][-1])
            stored = replace(drawn, sigma_m=None, loose=None)
            circle = self._circle(scan, drawn, laser)
            frame = _Frame(scan=scan, points=stored, lowest=lowest, laser=laser, circle=circle)
            if self.tracker.accept(match, points, view):
                self._rearrange()
            self._redraw_stale()
            self._frames.append(frame)
            self._enter(frame, self.tracker.pose)
        self.pose = self.tracker.pose
        if action is not None:
            # Something that moves may have stopped the robot.
            near = self.moving is not None and self.moving.has_near(self.pose[:2], _NEAR_THING_M)
            self.collided = not near and self.marks.update(
                self._step, action, displacement, self.pose, self.occupancy.probability
            )
        self.occupancy.stand(self.pose, self.hull, 0.5 * self.config.resolution_m)
        self.marks.stand(self.pose)
        return self.estimate()

    def estimate(self) -> MapEstimate:
        """The current map and pose."""
        return MapEstimate(
            frame=self.frame,
            obstacle_probability=read_only(self.occupancy.probability),
            explored=read_only(self.occupancy.explored),
            blocked=read_only(self.marks.blocked),
            pose=self.pose.copy(),
            surface_offset_m=read_only(self.surfaces.front_m),
            moving=() if self.moving is None else self.moving.things(),
        )

    def listen(self, bearings: Sequence[Bearing]) -> None:
        """Add bearings of radio sources from the pose of the last update.

        Poses move, and the map with them, in updates that come after. A robot that is lost says nothing.
        """
        if not self.relocalizer.lost:
            self.tracker.listen(bearings)

    def transmitters(self) -> dict[str, Transmitter]:
        """Positions of sources that were in line of sight, by name."""
        return self.tracker.transmitters()

    def tracked_map(self) -> TrackedMap:
        """Return the tracker: submaps, which grow, and their graph."""
        return self.tracker

    def _measured(self, action: Command | None, odometry: Pose | None) -> tuple[Pose, Covariance]:
        """Displacement without bias, and its covariance; zero if odometry is missing or not finite."""
        if action is None:
            return np.zeros(3), 1e-14 * np.eye(3)
        if odometry is None or not np.isfinite(odometry).all():
            return np.zeros(3), 1e-6 * np.eye(3)
        return self.odometry.correct(action, np.asarray(odometry, float))

    def _learn(
        self, action: Command, odometry: Pose, start: Pose, open_before: Covariance, match: Match
    ) -> None:
        """Learn the errors of odometry from a match, as far as the pose before it was known."""
        turn = rotation(start[2])
        covariance = turn.T @ (np.linalg.inv(match.information + np.eye(3)) + open_before) @ turn
        self.odometry.learn(action, odometry, between(start, match.pose), covariance)

    def _circle(self, scan: Scan, points: ScanPoints, laser: LaserScan | None) -> tuple[float, float, float]:
        """Centre (x, y) and radius [m] of a circle around all that a scan can change, in the robot's frame."""
        boxes = [self.occupancy.view_box(scan, np.zeros(3)), [(-0.5, -0.5), (0.5, 0.5)]]
        if laser is not None:
            boxes.append(self.occupancy.laser_box(laser, np.zeros(3)))
        corners = np.concatenate([points.points, *boxes])
        low, high = corners.min(axis=0), corners.max(axis=0)
        x, y = 0.5 * (low + high)
        return float(x), float(y), float(0.5 * np.hypot(*(high - low)))

    def _enter(self, frame: _Frame, pose: Pose) -> None:
        """Enter a scan at a pose."""
        self._make_room_for(frame, pose)
        self._draw(frame, pose, self.occupancy, self.surfaces)
        self.entered.append(pose)

    def _draw(self, frame: _Frame, pose: Pose, occupancy: OccupancyGrid, surfaces: SurfaceGrid) -> None:
        """Draw a scan at a pose on grids, as far as it lies inside."""
        rows, columns, cleared = occupancy.integrate(frame.scan, pose, self.camera.height_m, frame.lowest)
        surfaces.clear(rows, columns, cleared)
        if frame.laser is not None:
            surfaces.clear(*occupancy.integrate_laser(frame.laser, pose))
        placed = frame.points.at(pose)
        surfaces.add(placed.points, placed.normals, placed.weights)
        occupancy.stand(pose, self.hull, 0.5 * self.config.resolution_m)

    def _rearrange(self) -> None:
        """Move the scans whose poses the graph has changed by enough; their places on the map become stale."""
        poses = self.tracker.poses()[: len(self.entered)]
        off_m = np.abs(poses - self.entered) @ [1.0, 1.0, ARM_M]
        if off_m.max(initial=0.0) < _SHOWS * self.frame.resolution_m:
            return
        is_small = len(poses) <= _WHOLE_SCANS
        least_m = 0.0 if is_small else _MOVED * self.frame.resolution_m
        numbers = np.flatnonzero(off_m >= least_m)
        before = [] if is_small else [self._circles(numbers)]
        for k in numbers:
            self.entered[k] = poses[k]
            self._make_room_for(self._frames[k], poses[k])
        if is_small:
            self._redraw(slice(0, self.frame.shape[0]), slice(0, self.frame.shape[1]), numbers)
            return
        circles = np.concatenate([*before, self._circles(numbers)])
        low, high = (
            np.floor((circles[:, :2] + side * circles[:, 2:]) / _TILE_M).astype(int) for side in (-1, 1)
        )
        for (x0, y0), (x1, y1) in zip(low.tolist(), high.tolist(), strict=True):
            self._stale.update((x, y) for x in range(x0, x1 + 1) for y in range(y0, y1 + 1))

    def _circles(self, numbers: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k 3"]:
        """Circles (centre x, y and radius [m]) of what scans can change, at the poses where they are drawn."""
        x, y, radius_m = np.array([self._frames[k].circle for k in numbers]).reshape(-1, 3).T
        poses = np.array([self.entered[k] for k in numbers]).reshape(-1, 3)
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        return np.column_stack([poses[:, 0] + c * x - s * y, poses[:, 1] + s * x + c * y, radius_m])

    def _redraw_stale(self) -> None:
        """Draw stale tiles again: those around the robot, and the nearest others as far as the budget allows."""
        self._budget = min(self._budget + _SCANS_PER_DECISION, _MOST_SCANS)
        robot_tile = math.floor(self.tracker.pose[0] / _TILE_M), math.floor(self.tracker.pose[1] / _TILE_M)
        while self._stale:
            middle = min(self._stale, key=lambda tile: (_steps(tile, robot_tile), tile))
            if _steps(middle, robot_tile) <= _TILES_AROUND:
                middle = robot_tile
            elif self._budget <= 0:
                return
            group = {tile for tile in self._stale if _steps(tile, middle) <= _TILES_AROUND}
            self._stale -= group
            tiles = np.array(sorted(group))
            low, high = tiles.min(axis=0) * _TILE_M, (tiles.max(axis=0) + 1) * _TILE_M
            rows, columns, _ = self.frame.window((low[0], low[1]), (high[0], high[1]))
            circles = self._circles(np.arange(len(self._frames)))
            gap_m = np.maximum(low - circles[:, :2], circles[:, :2] - high).max(axis=1)
            self._budget -= self._redraw(rows, columns, np.flatnonzero(gap_m < circles[:, 2]))

    def _redraw(self, rows: slice, columns: slice, numbers: Int[np.ndarray, " k"]) -> int:
        """Draw a window again from the scans that reach it; returns their number."""
        frame = self.frame.window_frame(rows, columns)
        occupancy, surfaces = OccupancyGrid(frame, self.config.occupancy), SurfaceGrid(frame)
        for k in numbers:
            self._draw(self._frames[k], self.entered[k], occupancy, surfaces)
        self.occupancy.paste(rows, columns, occupancy)
        self.surfaces.paste(rows, columns, surfaces)
        self.redrawn.append(frame)
        return len(numbers)

    def _make_room_for(self, frame: _Frame, pose: Pose) -> None:
        """Grow the map, as far as allowed, until it holds a scan at a pose."""
        self._make_room(*self.occupancy.view_box(frame.scan, pose))
        if frame.laser is not None:
            self._make_room(*self.occupancy.laser_box(frame.laser, pose))

    def _make_room(self, low_xy: tuple[float, float], high_xy: tuple[float, float]) -> None:
        """Grow the map, as far as allowed, until it holds a box of `map`."""
        cells = self.frame.to_cells(np.array([low_xy, high_xy]))
        ny, nx = self.frame.shape
        over = (-cells[0, 0], cells[1, 0] - nx, -cells[0, 1], cells[1, 1] - ny)
        if max(over) <= 0:
            return
        room = self.config.max_area_m2 / self.config.resolution_m**2
        # Large maps grow by an eighth, so that copies take a bounded time per decision.
        steps = [GROWTH_CELLS * max(1, size // (8 * GROWTH_CELLS)) for size in (nx, nx, ny, ny)]
        pads = [max(0, math.ceil(o / step)) * step for o, step in zip(over, steps, strict=True)]
        for first in (0, 2):
            size, across = (nx, ny) if first == 0 else (ny, nx + pads[0] + pads[1])
            if (size + pads[first] + pads[first + 1]) * across > room:
                if not self._is_full:
                    logger.warning(
                        f"The map has reached max_area_m2 = {self.config.max_area_m2:g} m2 and stops growing."
                    )
                self._is_full = True
                pads[first] = pads[first + 1] = 0
        left, right, below, above = pads
        frame = self.frame.padded(left, right, below, above)
        for layer in (self.occupancy, self.surfaces, self.marks):
            layer.grow(frame, left, below)
        self.frame = frame


def _steps(tile: tuple[int, int], other: tuple[int, int]) -> int:
    """Tiles from one to another, by moves of a king."""
    return max(abs(tile[0] - other[0]), abs(tile[1] - other[1]))


def view_of_laser(scan: LaserScan) -> View:
    """Range of a laser scan in each direction."""
    return View(
        bearing_rad=scan.bearing_rad,
        range_m=np.where(scan.hit, scan.range_m, -np.maximum(scan.clear_m, 1e-9)),
        ahead_m=scan.ahead_m,
    )


def view_of_scan(scan: Scan) -> View:
    """Range of a depth camera's scan in each direction."""
    slant = np.hypot(1.0, scan.left)
    reach = np.where(scan.hit, scan.depth_m, -scan.clear_m) * slant
    bearing = np.arctan(scan.left)[::-1].astype(float)
    return View(bearing_rad=bearing, range_m=reach[::-1].astype(float), ahead_m=scan.ahead_m)


def _ahead(points: ScanPoints, distance_m: float) -> ScanPoints:
    """Points of a sensor that is as far ahead of the robot's centre [m]."""
    return points.at(np.array([distance_m, 0.0, 0.0])) if distance_m else points
