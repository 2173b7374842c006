"""Movers: all that moves by itself during an episode: its clock, its contacts with the robot, and its surfaces."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from robosim.building.building import Building
from robosim.camera.model import RGBD, CameraConfig
from robosim.camera.rendering.triangle_raster import Lens, draw_triangles
from robosim.movers.mover import Body, Group, Mover, Surroundings
from robosim.movers.person import cylinder_triangles, person_colours, person_triangles, stride_m
from robosim.movers.walkers import Walkers, WalkersConfig
from robosim.parts import MOVER, MoverPart
from robosim.support.checks import ADVANCED, Range, checked
from wireless.motion.bodies import Bodies, people

#: A contact begins at less than the first gap, and ends at more than the second [m].
_TOUCH_M, _APART_M = 0.01, 0.05
#: Colour of things that are not people.
_GREY = (150, 150, 155)


@dataclass(frozen=True, kw_only=True)
@checked
class MoversConfig:
    """Movers in the building, apart from the robot."""

    people: Annotated[int, Range(0, 1000, "people")] = 0
    """People who walk from place to place."""
    mover: Annotated[MoverPart, ADVANCED] = "none"
    """Another mover: a recorded crowd (.csv or .parquet: time, id, x, y, heading), another robot's trajectory (.tum),
    a list of doors, crowds and trajectories (.yaml), or module:Name."""
    person: Body = field(default_factory=Body)
    """Size of the people."""
    walking: WalkersConfig = field(default_factory=WalkersConfig)
    """How they walk."""

    tracking: Annotated[bool, ADVANCED] = True
    """Whether the robot tracks what moves, leaves it out of its map, and waits for it; else it takes it for walls."""

    @property
    def any(self) -> bool:
        """Whether something moves."""
        return self.people > 0 or self.mover != "none"


class Contact(NamedTuple):
    """The robot and a body met."""

    time_s: float
    body: int
    by_robot: bool
    """Whether the robot approached the body faster than the body approached it."""


class Movers:
    """Movers of an episode, with the poses and velocities of all their bodies."""

    def __init__(self, movers: Sequence[Mover], building: Building, robot_radius_m: float) -> None:
        self._group, self._building, self._robot_radius_m = Group(movers), building, robot_radius_m
        self.bodies = tuple(self._group.bodies)
        self.radius_m = np.array([body.radius_m for body in self.bodies])
        self.height_m = np.array([body.height_m for body in self.bodies])
        self._phase_m = stride_m(self.height_m) / (2 * math.pi)
        self._forget(np.full(3, np.nan))

    def _forget(self, robot: Float[np.ndarray, "3"]) -> None:
        """Time 0, before any body is there."""
        n = len(self.bodies)
        self.time_s, self.contacts = 0.0, list[Contact]()
        self._touching, self._phase = np.zeros(n, bool), np.zeros(n)
        self.velocity: Float[np.ndarray, "n 2"] = np.zeros((n, 2))
        self.poses: Float[np.ndarray, "n 3"] = np.full((n, 3), np.nan)
        self._robot = np.array(robot, float)
        self._surfaces: tuple[np.ndarray, np.ndarray] | None = None

    def reset(self, robot: Float[np.ndarray, "3"], rng: np.random.Generator) -> None:
        """Begin at time 0 with the robot at a pose."""
        self._forget(robot)
        self._group.reset(Surroundings(self._building, self._robot, self._robot_radius_m), rng)
        self._colours = [
            person_colours(child) if body.look == "person" else None
            for body, child in zip(self.bodies, rng.spawn(len(self.bodies)), strict=True)
        ]
        self.poses = self._group.poses(0.0, self._robot)

    def look_again(self) -> None:
        """Take the poses of bodies that moved while the robot's own time stood still, as other robots do."""
        self.poses, self._surfaces = self._group.poses(self.time_s, self._robot), None

    @property
    def present(self) -> Float[np.ndarray, "m 4"]:
        """Pose and radius of each body that is there: x [m], y [m], yaw [rad], radius [m]."""
        rows = np.column_stack([self.poses, self.radius_m])
        return rows[np.isfinite(rows[:, 0])]

    @property
    def radio_bodies(self) -> Bodies:
        """The bodies that are there, as the radio meets them."""
        there = np.isfinite(self.poses[:, 0])
        return people(self.poses[there, :2], radius_m=self.radius_m[there], height_m=self.height_m[there])

    def advance(self, duration_s: float, robot: Float[np.ndarray, "3"]) -> None:
        """Let time pass, in which the robot went to a pose."""
        if duration_s <= 0:
            return
        self.time_s += duration_s
        poses = self._group.poses(self.time_s, self._robot)
        shift = poses[:, :2] - self.poses[:, :2]
        self.velocity = np.where(np.isfinite(shift), shift, 0.0) / duration_s
        self._phase += np.hypot(*self.velocity.T) * duration_s / self._phase_m
        self.poses, self._surfaces = poses, None
        away = poses[:, :2] - robot[:2]
        distance_m = np.hypot(*away.T)
        gap_m = distance_m - self.radius_m - self._robot_radius_m
        for k in np.flatnonzero((gap_m < _TOUCH_M) & ~self._touching):
            towards = away[k] / max(distance_m[k], 1e-9)
            robot_mps = float((robot[:2] - self._robot[:2]) @ towards) / duration_s
            body_mps = -float(self.velocity[k] @ towards)
            self.contacts.append(Contact(self.time_s, int(k), robot_mps > max(body_mps, 0.0)))
        self._touching = np.where(self._touching, gap_m < _APART_M, gap_m < _TOUCH_M)
        self._robot = np.array(robot, float)

    def share_free(self, robot: Float[np.ndarray, "2"], step: Float[np.ndarray, "2"]) -> float:
        """Share of a straight step of the robot [m] that it completes before it meets a body.

        Steps away from a body are free, also of a robot that touches it.
        """
        length = math.hypot(*step)
        if length == 0:
            return 1.0
        towards = step / length
        offset = self.poses[:, :2] - robot
        nearing = offset @ towards
        square = nearing**2 - (offset**2).sum(axis=1) + (self.radius_m + self._robot_radius_m) ** 2
        meets = (nearing > 0) & (square > 0)
        reach_m = nearing[meets] - np.sqrt(square[meets])
        return float(np.clip(reach_m.min(initial=length) / length, 0.0, 1.0))

    def surfaces(self) -> tuple[Float[np.ndarray, "m 3 3"], UInt8[np.ndarray, "m 3"]]:
        """Triangles of all bodies that are there, in `map` [m], and their colours."""
        if self._surfaces is None:
            self._surfaces = self._make_surfaces()
        return self._surfaces

    def _make_surfaces(self) -> tuple[Float[np.ndarray, "m 3 3"], UInt8[np.ndarray, "m 3"]]:
        triangles, colours = [np.empty((0, 3, 3))], [np.empty((0, 3), np.uint8)]
        speed = np.hypot(*self.velocity.T)
        for k in np.flatnonzero(np.isfinite(self.poses[:, 0])):
            body, (x, y, yaw), colour = self.bodies[k], self.poses[k], self._colours[k]
            if colour is None:
                surface = cylinder_triangles(body.radius_m, body.height_m)
                colour = np.full((len(surface), 3), _GREY, np.uint8)
            else:
                surface = person_triangles(body.height_m, float(self._phase[k]), float(speed[k]))
            c, s = math.cos(yaw), math.sin(yaw)
            turned = surface.reshape(-1, 3) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + (x, y, 0)
            triangles.append(turned.reshape(surface.shape))
            colours.append(colour)
        return np.concatenate(triangles), np.concatenate(colours)

    def draw(self, frame: RGBD, T_map_camera: Float[np.ndarray, "4 4"], camera: CameraConfig) -> RGBD:
        """The picture of a camera with the bodies in it, where they are nearer than what it shows."""
        triangles, colours = self.surfaces()
        rgb, depth = frame.rgb.copy(), frame.depth.copy()
        R, place = np.ascontiguousarray(T_map_camera[:3, :3].T), T_map_camera[:3, 3].copy()
        draw_triangles(
            triangles,
            colours,
            place,
            R,
            Lens(float(camera.focal_px), camera.near_m, camera.far_m),
            depth,
            rgb,
        )
        return RGBD(rgb, depth)


def make_movers(
    config: MoversConfig,
    building: Building,
    robot_radius_m: float,
    others: Sequence[Mover] = (),
    crowd: Mover | None = None,
) -> Movers | None:
    """Others and the movers of a configuration, or a crowd instead of these; None if nothing moves."""
    movers = [*others, *(movers_of(config) if crowd is None else [crowd])]
    return Movers(movers, building, robot_radius_m) if movers else None


def movers_of(config: MoversConfig) -> list[Mover]:
    """The movers of a configuration; none if nothing moves."""
    movers: list[Mover] = []
    if config.people:
        movers.append(Walkers(config.people, config.walking, config.person))
    if config.mover != "none":
        movers.append(MOVER.make(config.mover, field="mover"))
    return movers
