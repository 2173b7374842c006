"""Classical mapper: map and pose from depth images, laser scans and odometry.

At every decision: odometry without its bias predicts the pose, the scan is fitted to the surfaces on the map, and then
entered at the pose found. Occupancy (free space), surfaces (exact walls) and collision marks share one grid that
grows with the building.

Memory: 55 bytes a cell (23 MB for 32 m x 32 m), of a rectangle of at most `max_area_m2`; what lies outside is dropped.
A pose whose scan contradicts the map is doubted: the robot is searched for farther away, and scans are not entered
until it is found (`relocalization`).
Where loops close, poses of the past move, and the map is built again from all scans (`slam.graph`).
Reference: Kohlbrecher et al., A flexible and scalable SLAM system with full 3D motion estimation, SSRR 2011.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32

from slam.actions import Action
from slam.graph.landmarks import Transmitter
from slam.graph.submaps import View
from slam.graph.tracker import Tracker, TrackerConfig
from slam.grid import GridFrame, MapEstimate
from slam.mapping.collisions import CollisionConfig, CollisionMarks
from slam.mapping.occupancy import OccupancyConfig, OccupancyGrid
from slam.mapping.odometry import OdometryConfig, OdometryCorrector
from slam.mapping.relocalization import RelocalizationConfig, Relocalizer
from slam.matching.levels import ARM_M
from slam.matching.scan_matching import Match, MatchConfig, ScanPoints, points_of_beams, points_of_scan
from slam.matching.surfaces import SurfaceGrid
from slam.poses import between, rotation, wrap
from slam.sensing.bearings import Bearing
from slam.sensing.laser import LaserScan
from slam.sensing.projection import Band, CameraModel, Scan, scan_from_depth
from slam.support.checks import Range, checked

logger = logging.getLogger(__name__)

#: Cells added at once when the view leaves the map.
GROWTH_CELLS = 80
#: Depths beyond this serve to match poses, but are too coarse for the map [m].
_DRAWN_M = 6.0
#: The map is built again once a pose has changed by this many cells.
_SHOWS = 0.3


@dataclass(frozen=True, kw_only=True)
@checked
class MapperConfig:
    """Settings of the classical mapper."""

    resolution_m: Annotated[float, Range(0.005, 0.5, "m")] = 0.05
    """Side of a map cell [m]."""
    max_area_m2: Annotated[float, Range(400, 1e6, "m2", "The camera sees 10 m far.")] = 40_000.0
    """Area to which the map may grow [m^2]; bounds the memory."""
    radius_m: Annotated[float, Range(0.01, 5, "m")] = 0.10
    """Radius of the robot's hull [m]."""
    camera: CameraModel = field(default_factory=CameraModel)
    """The depth camera."""
    band: Band = field(default_factory=Band)
    """Heights above the floor that stop the robot."""
    occupancy: OccupancyConfig = field(default_factory=OccupancyConfig)
    """Weight and reach of the evidence."""
    match: MatchConfig = field(default_factory=MatchConfig)
    """Settings of scan matching."""
    relocalization: RelocalizationConfig = field(default_factory=RelocalizationConfig)
    """When the robot counts as lost."""
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    """Errors of odometry."""
    tracking: TrackerConfig = field(default_factory=TrackerConfig)
    """Settings of the tracker; cells and matching are those above."""


@runtime_checkable
class Mapper(Protocol):
    """Interface of mappers."""

    @property
    def collided(self) -> bool:
        """Whether the last action ended at an obstacle."""

    def reset(self, pose: Float[np.ndarray, "3"]) -> None:
        """Forget everything and begin at a pose: x [m], y [m], yaw [rad] in `map`."""

    def update(
        self,
        depth: Float32[np.ndarray, "h w"],
        action: Action | None = None,
        odometry: Float[np.ndarray, "3"] | None = None,
    ) -> MapEstimate:
        """Add the measurements after an action; see `ClassicalMapper.update`.

        One that takes scans of a laser too has an argument `laser`, which is given where the robot has one.
        """

    def estimate(self) -> MapEstimate:
        """The current map and pose."""


@runtime_checkable
class RadioMapper(Protocol):
    """Interface of mappers that use bearings of a radio too."""

    def listen(self, bearings: Sequence[Bearing]) -> None:
        """Add bearings of sources from the pose of the last update."""

    def transmitters(self) -> dict[str, Transmitter]:
        """Positions of sources that were in line of sight, by name."""


@runtime_checkable
class PoseMatcher(Protocol):
    """Finds the pose from a scan and the map."""

    def match(
        self,
        scan: Scan,
        occupancy: OccupancyGrid,
        predicted: Float[np.ndarray, "3"],
        covariance: Float[np.ndarray, "3 3"],
    ) -> Match:
        """The pose, given the prediction of odometry and its covariance, axes of `map`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Frame:
    """Data needed to enter a frame again at another pose."""

    scan: Scan
    points: ScanPoints
    """Those that are drawn."""
    lowest: float
    """Fall of the lowest image row per metre of depth."""
    laser: LaserScan | None


class ClassicalMapper:
    """Builds a map and estimates the pose of the robot."""

    def __init__(self, config: MapperConfig = MapperConfig(), matcher: PoseMatcher | None = None):
        """Make a mapper.

        Args:
            config: Settings.
            matcher: Finds the pose; scan matching if None.
        """
        self.config = config
        self._matcher = matcher
        self.reset(np.zeros(3))

    def reset(self, pose: Float[np.ndarray, "3"]) -> None:
        """Forget everything and begin at a pose: x [m], y [m], yaw [rad] in `map`."""
        config = self.config
        cell, half = config.resolution_m, 2 * GROWTH_CELLS
        corner = [(math.floor(pose[k] / cell) - half) * cell for k in (0, 1)]
        frame = GridFrame(origin_xy=(corner[0], corner[1]), resolution_m=cell, shape=(2 * half, 2 * half))
        self.frame = frame
        self.occupancy = OccupancyGrid(frame, config.occupancy)
        self.surfaces = SurfaceGrid(frame)
        self.marks = CollisionMarks(frame, CollisionConfig(radius_m=config.radius_m))
        self.odometry = OdometryCorrector(config.odometry)
        self.relocalizer = Relocalizer(config.relocalization)
        tracking = replace(config.tracking, cell_m=cell, match=config.match)
        self.tracker = Tracker(tracking)
        self.tracker.reset(np.array([pose[0], pose[1], wrap(float(pose[2]))]))
        self._frames: list[_Frame] = []
        self._entered: list[Float[np.ndarray, 3]] = []
        self.rearranged = False
        """Whether the last update changed past poses, and the map with them."""
        self.pose = np.array([pose[0], pose[1], wrap(float(pose[2]))])
        self.collided = False
        self._step = 0

    def update(
        self,
        depth: Float32[np.ndarray, "h w"],
        action: Action | None = None,
        odometry: Float[np.ndarray, "3"] | None = None,
        laser: LaserScan | None = None,
    ) -> MapEstimate:
        """Add the measurements after an action.

        Args:
            depth: Depth image at the new pose [m]; 0 or not finite where nothing was measured.
            action: The action that led here; None at the first frame.
            odometry: Measured displacement in the robot's frame before the action: x, y [m], yaw [rad].
            laser: What the robot's laser scanner measured, if it has one.

        Returns:
            Map and pose; the arrays are views that the next update changes.
        """
        self._step += 1
        self.scan = scan = scan_from_depth(depth, self.config.camera, self.config.band)
        points = points_of_scan(scan, self.config.match, self.config.resolution_m)
        drawn, view = points.within(_DRAWN_M), view_of_scan(scan)
        if laser is not None:
            beams = points_of_beams(
                laser.bearing_rad,
                laser.range_m,
                laser.max_range_m,
                self.config.resolution_m,
                self.config.match.sigma_m,
            )
            points, drawn, view = points.with_more(beams), drawn.with_more(beams), view_of_laser(laser)
        displacement, covariance = self._measured(action, odometry)
        start, open_before = self.pose, self.tracker.covariance
        predicted, prior = self.tracker.predict(displacement, covariance)
        match = (
            self._matcher.match(scan, self.occupancy, predicted, prior)
            if self._matcher is not None
            else self.tracker.match(points, view)
        )
        match, doubted = self.relocalizer.judge(
            match,
            drawn,
            displacement,
            math.sqrt(prior[0, 0] + prior[1, 1]),
            self.occupancy,
            self.surfaces,
            self.config.match,
            self.config.camera.height_m,
        )
        # A NaN reading must not enter the learned bias, where it would stay forever.
        if action is not None and odometry is not None and np.isfinite(odometry).all() and not doubted:
            self._learn(action, odometry, start, open_before, match)
        if doubted and not self.relocalizer.lost:
            self.tracker.jump(match, points)
        self.rearranged = False
        if not self.relocalizer.lost:
            lowest = float(self.config.camera.slopes(depth.shape)[1][-1])
            frame = _Frame(scan=scan, points=drawn, lowest=lowest, laser=laser)
            if self.tracker.accept(match, points, view):
                self._rearrange()
            self._frames.append(frame)
            self._enter(frame, self.tracker.pose)
        self.pose = self.tracker.pose
        if action is not None:
            self.collided = self.marks.update(
                self._step, action, displacement, self.pose, self.occupancy.probability
            )
        self._stand(self.pose)
        self.marks.stand(self.pose)
        return self.estimate()

    def estimate(self) -> MapEstimate:
        """The current map and pose."""
        return MapEstimate(
            frame=self.frame,
            obstacle_probability=_read_only(self.occupancy.probability),
            explored=_read_only(self.occupancy.explored),
            blocked=_read_only(self.marks.blocked),
            pose=self.pose.copy(),
            surface_offset_m=_read_only(self.surfaces.front_m),
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

    def _measured(
        self, action: Action | None, odometry: Float[np.ndarray, "3"] | None
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        """Displacement without bias, and its covariance; zero if odometry is missing or not finite."""
        if action is None:
            return np.zeros(3), 1e-14 * np.eye(3)
        if odometry is None or not np.isfinite(odometry).all():
            return np.zeros(3), 1e-6 * np.eye(3)
        return self.odometry.correct(action, np.asarray(odometry, float))

    def _learn(
        self,
        action: Action,
        odometry: Float[np.ndarray, "3"],
        start: Float[np.ndarray, "3"],
        open_before: Float[np.ndarray, "3 3"],
        match: Match,
    ) -> None:
        """Learn the errors of odometry from a match, as far as the pose before it was known."""
        turn = rotation(start[2])
        covariance = turn.T @ (np.linalg.inv(match.information + np.eye(3)) + open_before) @ turn
        self.odometry.learn(action, odometry, between(start, match.pose), covariance)

    def _enter(self, frame: _Frame, pose: Float[np.ndarray, "3"]) -> None:
        """Enter a scan at a pose."""
        self._make_room(*self.occupancy.view_box(frame.scan, pose))
        height_m = self.config.camera.height_m
        rows, columns, cleared = self.occupancy.integrate(frame.scan, pose, height_m, frame.lowest)
        self.surfaces.clear(rows, columns, cleared)
        if frame.laser is not None:
            self._make_room(*self.occupancy.laser_box(frame.laser, pose))
            self.surfaces.clear(*self.occupancy.integrate_laser(frame.laser, pose))
        placed = frame.points.at(pose)
        self.surfaces.add(placed.points, placed.normals, placed.weights)
        self._stand(pose)
        self._entered.append(pose)

    def _rearrange(self) -> None:
        """Build the map again if the graph has changed poses of its scans by enough."""
        poses = self.tracker.poses()[: len(self._entered)]
        off_m = np.abs(poses - self._entered) @ [1.0, 1.0, ARM_M]
        if off_m.max(initial=0.0) < _SHOWS * self.frame.resolution_m:
            return
        self.rearranged = True
        self.occupancy = OccupancyGrid(self.frame, self.config.occupancy)
        self.surfaces = SurfaceGrid(self.frame)
        self._entered = []
        for frame, pose in zip(self._frames, poses, strict=True):
            self._enter(frame, pose)

    def _stand(self, pose: Float[np.ndarray, "3"]) -> None:
        """Mark the cells under the hull as free."""
        self.occupancy.stand(pose, self.config.radius_m - 0.5 * self.config.resolution_m)

    def _make_room(self, low_xy: tuple[float, float], high_xy: tuple[float, float]) -> None:
        """Grow the map, as far as allowed, until it holds a box of `map`."""
        cells = self.frame.to_cells(np.array([low_xy, high_xy]))
        ny, nx = self.frame.shape
        over = (-cells[0, 0], cells[1, 0] - nx, -cells[0, 1], cells[1, 1] - ny)
        if max(over) <= 0:
            return
        room = self.config.max_area_m2 / self.config.resolution_m**2
        pads = [max(0, math.ceil(o / GROWTH_CELLS)) * GROWTH_CELLS for o in over]
        for first in (0, 2):
            size, across = (nx, ny) if first == 0 else (ny, nx + pads[0] + pads[1])
            if (size + pads[first] + pads[first + 1]) * across > room:
                logger.warning(
                    "The map has reached max_area_m2 = %g m2 and stops growing.", self.config.max_area_m2
                )
                pads[first] = pads[first + 1] = 0
        left, right, below, above = pads
        frame = self.frame.padded(left, right, below, above)
        for part in (self.occupancy, self.surfaces, self.marks):
            part.grow(frame, left, below)
        self.frame = frame


def _read_only(array: np.ndarray) -> np.ndarray:
    view = array.view()
    view.flags.writeable = False
    return view


def view_of_laser(scan: LaserScan) -> View:
    """Range of a laser scan in each direction."""
    return View(
        bearing_rad=scan.bearing_rad,
        range_m=np.where(scan.hit, scan.range_m, -np.maximum(scan.clear_m, 1e-9)),
    )


def view_of_scan(scan: Scan) -> View:
    """Range of a depth camera's scan in each direction."""
    slant = np.hypot(1.0, scan.left)
    reach = np.where(scan.hit, scan.depth_m, -scan.clear_m) * slant
    return View(bearing_rad=np.arctan(scan.left)[::-1].astype(float), range_m=reach[::-1].astype(float))
