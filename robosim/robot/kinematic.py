"""The kinematic twin of `dynamic`: a hull that goes where it is sent, and stops at walls.

The robot has neither mass nor wheels. The centre of a disk moves along straight lines (arcs are cut into short ones),
and stops one radius from a wall. That place is exact: a disk meets a wall where its centre meets the lines at one
radius from the wall, or the circles around the wall's ends. Its rotation is free. Tiles list all walls near enough to
matter, so that a move takes some tens of microseconds on any plan. A polygon moves and turns in short steps until it
meets a wall, and by halves of the last one up to there, which takes a millisecond. This world replaces `World` where
speed matters more than forces, such as in training. Left out: acceleration, friction, slip other than what is
commanded.
"""

import math
from copy import copy

import numpy as np
import shapely
from jaxtyping import Float

from robosim.building.building import Building
from robosim.building.extrusion import wall_segments
from robosim.movers.movers import Movers
from robosim.robot.collision import FIT_M, check_pose
from robosim.robot.motion import (
    BLOCKED_M,
    BLOCKED_RAD,
    CommandQueue,
    Motion,
    check_displacement,
    check_drive,
)
from robosim.robot.robots import RobotConfig
from robosim.support.compiled import compiled
from slam.poses import to_map, wrap

#: Side of the tiles that walls are sorted into [m].
TILE_M = 0.5
#: Longest motion that is tested against walls at once [m].
PIECE_M = 0.3
#: Longest time in which movers move at once [s].
PIECE_S = 0.1
#: Largest turn within one straight piece of an arc [rad].
ARC_RAD = math.radians(5.0)
#: Steps of a polygon [m], [rad], and halves of the last one.
STEP_M, STEP_RAD, HALVES = 0.01, math.radians(2.0), 10
#: The disk is stopped this far before a wall [m], so that rounding never puts it inside.
GAP_M = 1e-9
#: Moving along a wall this exactly is not moving into it (sine of the angle).
_PARALLEL = 1e-12


class KinematicWorld:
    """A building with one robot, moved without forces."""

    def __init__(
        self, building: Building, *, robot: RobotConfig | None = None, movers: Movers | None = None
    ) -> None:
        """Sort the walls of a building; `movers` move while the robot does."""
        self.building = building
        self.robot = robot or RobotConfig()
        self._room = building.floor(self.robot.height_m)
        xmin, ymin, xmax, ymax = building.free.bounds
        self._origin = np.array([(xmin + xmax) / 2, (ymin + ymax) / 2])
        walls = wall_segments(self._room) - self._origin
        self._walls = (
            _PolygonWalls(walls, self.robot.hull.corners)
            if self.robot.outline_m
            else _Tiles(walls, self.robot.hull.radius_m + GAP_M)
        )
        self._x, self._y, self._yaw = 0.0, 0.0, 0.0
        self._commands = CommandQueue(self.robot.latency_s)
        self._movers = movers

    def clone(self) -> "KinematicWorld":
        """The same building with another robot in it, independent of the first."""
        other = copy(self)
        other._commands = CommandQueue(self.robot.latency_s)
        return other

    def reset(self, pose: Float[np.ndarray, "3"]) -> None:
        """Put the robot at a pose x [m], y [m], yaw [rad] in `map`; ValueError if the hull does not fit there."""
        check_pose(self._room, pose, self.robot.hull)
        self._x, self._y = float(pose[0] - self._origin[0]), float(pose[1] - self._origin[1])
        self._yaw = wrap(float(pose[2]))
        self._commands.clear()

    @property
    def pose(self) -> Float[np.ndarray, "3"]:
        """Pose x [m], y [m], yaw [rad] in `map`."""
        return np.array([self._x + self._origin[0], self._y + self._origin[1], self._yaw])

    def move(self, displacement: Float[np.ndarray, "3"]) -> Motion:
        """Go to a pose near by, or to where walls stop the disk: dx [m], dy [m], dyaw [rad] in the robot's frame.

        It moves forward first, then sideways, so that slip into a wall does not stop a robot along it. The motion
        collided if a wall left the robot off its goal by more than `BLOCKED_M` or `BLOCKED_RAD`.
        """
        check_displacement(displacement)
        self._commands.clear()
        dx, dy, turn = (float(component) for component in displacement)
        c, s = math.cos(self._yaw), math.sin(self._yaw)
        goal_yaw = self._yaw + turn
        goal_x, goal_y = self._x + c * dx - s * dy, self._y + s * dx + c * dy
        profile = self.robot.profile(displacement)
        pieces = self._pieces(profile.duration_s)
        done = 0.0
        for piece in range(1, pieces + 1):
            share = profile.fraction(profile.duration_s * piece / pieces) - done
            self._go(share * c * dx, share * s * dx)
            self._go(-share * s * dy, share * c * dy)
            self._turn(share * turn)
            self._let_pass(profile.duration_s / pieces)
            done += share
        off_m, off_rad = math.hypot(goal_x - self._x, goal_y - self._y), abs(wrap(goal_yaw - self._yaw))
        blocked = off_m > BLOCKED_M or off_rad > BLOCKED_RAD
        return Motion(self.pose, blocked, profile.duration_s)

    def drive(self, v_mps: float, w_radps: float, duration_s: float) -> Motion:
        """Drive along an arc for a while, at full speed after the latency; collided if a wall shortened it.

        Speeds beyond the robot's limits are reduced, along the same arc.
        """
        check_drive(v_mps, w_radps, duration_s)
        blocked = False
        for (v, w), time_s in self._commands.during(self.robot.within_reach(v_mps, w_radps), duration_s):
            blocked |= self._follow_arc(v, w, time_s)
        return Motion(self.pose, blocked, duration_s)

    def _follow_arc(self, v: float, w: float, duration_s: float) -> bool:
        """Move along an arc as far as walls allow; whether one stopped the disk."""
        pieces = max(math.ceil(abs(w) * duration_s / ARC_RAD), self._pieces(duration_s))
        turn = w * duration_s / pieces
        half = turn / 2
        chord = v * duration_s / pieces * (math.sin(half) / half if half else 1.0)
        blocked = False
        for _ in range(pieces):
            direction = self._yaw + half
            blocked |= self._go(chord * math.cos(direction), chord * math.sin(direction))
            blocked |= self._turn(turn)
            self._let_pass(duration_s / pieces)
        return blocked

    def _pieces(self, duration_s: float) -> int:
        """Pieces of a motion between which movers move."""
        return 1 if self._movers is None else max(1, math.ceil(duration_s / PIECE_S))

    def _let_pass(self, duration_s: float) -> None:
        """Let time pass for movers."""
        if self._movers is not None:
            self._movers.advance(duration_s, self.pose)

    def _turn(self, turn: float) -> bool:
        """Turn on the spot as far as walls allow; whether one stopped it."""
        share = self._walls.share_free((self._x, self._y, self._yaw), (0.0, 0.0, turn))
        self._yaw = wrap(self._yaw + share * turn)
        return share < 1

    def _go(self, dx: float, dy: float) -> bool:
        """Move the hull straight as far as walls allow; whether one stopped it."""
        pieces = max(1, math.ceil(math.hypot(dx, dy) / PIECE_M))
        blocked = False
        for _ in range(pieces):
            blocked |= self._go_piece(dx / pieces, dy / pieces)
            if blocked:
                break
        return blocked

    def _go_piece(self, dx: float, dy: float) -> bool:
        share = self._walls.share_free((self._x, self._y, self._yaw), (dx, dy, 0.0))
        if self._movers is not None:
            share = min(share, self._movers.share_free(self.pose[:2], np.array([dx, dy])))
        self._x, self._y = self._x + share * dx, self._y + share * dy
        return share < 1


class _PolygonWalls:
    """Walls that a polygon may meet."""

    def __init__(self, walls: Float[np.ndarray, "n 2 2"], corners: Float[np.ndarray, "k 2"]) -> None:
        # By as much as a robot may be placed in a wall.
        inner = shapely.Polygon(corners).buffer(-FIT_M, join_style="mitre")
        self._corners = shapely.get_coordinates(inner.exterior)
        self._tree = shapely.STRtree(shapely.linestrings(walls))

    def share_free(self, pose: tuple[float, float, float], step: tuple[float, float, float]) -> float:
        """Share of a step dx, dy [m], dyaw [rad] from a pose that is done before a wall is met."""
        pieces = math.ceil(max(math.hypot(*step[:2]) / STEP_M, abs(step[2]) / STEP_RAD))
        for piece in range(1, pieces + 1):
            if self._meets(pose, step, piece / pieces):
                free, share = (piece - 1) / pieces, 1 / pieces
                for _ in range(HALVES):
                    share /= 2
                    free += 0.0 if self._meets(pose, step, free + share) else share
                return free
        return 1.0

    def _meets(
        self, pose: tuple[float, float, float], step: tuple[float, float, float], share: float
    ) -> bool:
        there = np.array(pose) + share * np.array(step)
        return (
            self._tree.query(shapely.Polygon(to_map(there, self._corners)), predicate="intersects").size > 0
        )


class _Tiles:
    """Walls, found by place."""

    def __init__(self, walls: Float[np.ndarray, "n 2 2"], radius_m: float) -> None:
        """Sort walls into tiles, each with the walls that a disk starting there may meet within a piece."""
        self._corner = walls.min(axis=(0, 1))
        self._shape = np.floor((walls.max(axis=(0, 1)) - self._corner) / TILE_M).astype(int) + 1
        ix, iy = (index.ravel() for index in np.indices(self._shape))
        low = self._corner + np.column_stack([ix, iy]) * TILE_M
        tiles = shapely.box(low[:, 0], low[:, 1], low[:, 0] + TILE_M, low[:, 1] + TILE_M)
        tree = shapely.STRtree(shapely.linestrings(walls))
        reach_m = radius_m + PIECE_M
        tile, wall = tree.query(tiles, predicate="dwithin", distance=reach_m)
        self._walls, self._radius_m = walls, radius_m
        self._found: list[_Walls | None] = [None] * len(tiles)
        ends = np.flatnonzero(np.diff(tile, append=-1)) + 1
        for start, end in zip(np.append(0, ends[:-1]), ends, strict=True):
            self._found[tile[start]] = _Walls(walls[np.sort(wall[start:end])], radius_m)

    def share_free(self, pose: tuple[float, float, float], step: tuple[float, float, float]) -> float:
        """Share of a step dx, dy [m], dyaw [rad] from a pose that is done before a wall is met; all of a turn."""
        dx, dy, _ = step
        walls = self.near(pose[0], pose[1]) if dx or dy else None
        return 1.0 if walls is None else walls.meet(pose[0], pose[1], dx, dy)

    def near(self, x: float, y: float) -> "_Walls | None":
        """The walls near a place [m], if any."""
        ix, iy = int((x - self._corner[0]) // TILE_M), int((y - self._corner[1]) // TILE_M)
        return self._found[ix * self._shape[1] + iy]


class _Walls:
    """A few walls, ready to be met by a disk."""

    def __init__(self, walls: Float[np.ndarray, "n 2 2"], radius_m: float) -> None:
        self._start = walls[:, 0]
        along = walls[:, 1] - walls[:, 0]
        self._length = np.hypot(*along.T)
        self._along = along / self._length[:, None]
        self._radius_m = radius_m

    def meet(self, x: float, y: float, dx: float, dy: float) -> float:
        """Share of a straight motion by dx, dy [m] that a disk at x, y [m] completes before it meets a wall."""
        args = self._start, self._along, self._length, self._radius_m
        return _share_to_wall(*args, float(x), float(y), float(dx), float(dy))


@compiled
def _share_to_wall(
    start: Float[np.ndarray, "n 2"],
    along: Float[np.ndarray, "n 2"],
    lengths: Float[np.ndarray, " n"],
    radius: float,
    x: float,
    y: float,
    dx: float,
    dy: float,
) -> float:
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0:
        return 1.0
    ux, uy = dx / length, dy / length
    best = length
    for i in range(len(start)):
        ax, ay = along[i, 0], along[i, 1]
        wx, wy = x - start[i, 0], y - start[i, 1]

        # Straight sides: the height of the centre above the wall's line comes down to the radius.
        height, climb = ax * wy - ay * wx, ax * uy - ay * ux
        side = 1.0 if height > 0 else -1.0 if height < 0 else 0.0
        sinking = -side * climb
        if sinking > _PARALLEL and side * height - radius < length * sinking:
            reach = max((side * height - radius) / sinking, 0.0)
            foot = ax * (wx + reach * ux) + ay * (wy + reach * uy)
            if 0 <= foot <= lengths[i] and reach < best:
                best = reach

        # Round ends: each corner is the start of one wall.
        nearing, outside = wx * ux + wy * uy, wx * wx + wy * wy - radius * radius
        square = nearing * nearing - outside
        if nearing < -_PARALLEL and square >= 0:
            best = min(best, max(-nearing - math.sqrt(square), 0.0))
    return best / length if best < length else 1.0
