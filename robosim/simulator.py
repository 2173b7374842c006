"""Simulation of a robot in a building: its motion and its sensors.

Noise has five sources: actuation (the motion differs from the command) and odometry (the measured motion differs from
the true one), both after Active Neural SLAM, the depth camera, the lidar, and the radio. Each step returns an
`Observation`; the true pose is for judging only.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
import tyro
from jaxtyping import Float, UInt8

from robosim.building.building import Building
from robosim.camera.cameras import make_camera
from robosim.camera.model import Camera, CameraConfig, camera_pose
from robosim.camera.rendering.shading import shaded_mesh
from robosim.camera.target import Recogniser, target_mesh
from robosim.lidar import Lidar
from robosim.movers.mover import Body, Mover
from robosim.movers.movers import MoversConfig, make_movers
from robosim.movers.teammates import Teammates
from robosim.parts import (
    CAMERA,
    LIDAR,
    PHYSICS,
    RECOGNISER,
    CameraPart,
    PhysicsPart,
    RecogniserPart,
)
from robosim.radio.link import RadioLink, RadioLinkConfig
from robosim.radio.measurement import Interpret, Interpreter
from robosim.robot.motion import Motion, Physics
from robosim.robot.robots import RobotConfig
from robosim.support.parts import Part
from robosim.support.randomness import named_generator
from robosim.support.stopwatch import Stopwatch
from robosim.task.tasks import Task
from slam.actions import WAIT_S, Action, Command, Velocity
from slam.poses import between
from slam.sensing.laser import LaserScan
from wireless.estimates import PathEstimates


@dataclass(frozen=True, kw_only=True)
class SimulatorConfig:
    """Simulated sensors and robot, and their fidelity."""

    physics: PhysicsPart = "dynamic"
    """dynamic: MuJoCo with wheels and contacts. kinematic: a disk that stops at walls, much faster."""
    camera: CameraPart = "pyrender"
    """pyrender: OpenGL by OSMesa. embree: ray casting, slower, needs no OpenGL. plan: one ray per column, fastest,
    schematic colours. none: the robot goes without its camera."""
    robot: RobotConfig = field(default_factory=RobotConfig)
    """The robot, with its sensors and errors."""
    radio: RadioLinkConfig = field(default_factory=RadioLinkConfig)
    """Transmitter of the target, and receiver of the robot."""
    movers: Annotated[MoversConfig, tyro.conf.arg(name="")] = field(default_factory=MoversConfig)
    """People and others who move in the building."""
    recognition: RecogniserPart = "marker"
    """marker: by the ArUco marker in the picture. perfect: at its true place whenever it is in view."""

    def __post_init__(self) -> None:
        PHYSICS.check("physics", self.physics)
        CAMERA.check("camera", self.camera)
        if self.renderer == self.robot.lidar == "none":
            raise ValueError("camera and lidar are 'none': the robot would see nothing. Give it one of them.")
        RECOGNISER.check("recognition", self.recognition)

    @property
    def renderer(self) -> Part:
        """How pictures are made; "none" if the robot has no camera, or goes without it."""
        return "none" if self.robot.camera is None else self.camera

    @property
    def image(self) -> CameraConfig:
        """The pictures; without a camera they show nothing."""
        return self.robot.camera or CameraConfig()


@dataclass(frozen=True, eq=False)
class Observation:
    """Measurements of the robot after an action."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float[np.ndarray, "h w"]
    """Measured depth along the camera's axis [m]; 0 where nothing was measured."""
    odometry: Float[np.ndarray, "3"]
    """Measured motion since the last observation in the robot's frame: dx [m], dy [m], dyaw [rad]."""
    paths: PathEstimates | None = None
    """Estimated radio paths from the target, arrivals in the robot's frame; None without a radio."""
    anchors: Mapping[str, PathEstimates] = field(default_factory=dict)
    """Paths from other transmitters, by name; none without a radio."""
    target: Float[np.ndarray, "2"] | None = None
    """Where the camera sees the target: x ahead, y left [m]; None if it does not."""
    laser: LaserScan | None = None
    """Scan of the lidar; None without one."""
    time_s: float | None = None
    """Time since the last observation [s]; None where nothing moves but the robot."""
    action: Command | None = None
    """The action that was done since the last observation; None at the first."""


class Simulator:
    """Simulation of a robot in a building."""

    def __init__(
        self,
        building: Building,
        config: SimulatorConfig | None = None,
        watch: Stopwatch | None = None,
        *,
        uses_radio: bool = False,
        uses_camera: bool = False,
        others: Sequence[RobotConfig] = (),
        crowd: Mover | None = None,
    ) -> None:
        """Build the scene: collision shapes, and the lit building for the camera.

        `watch` collects the time by stage. The robot has a radio if `uses_radio`, and the target is searched for in
        pictures if `uses_camera`. `others` are the other robots in the building, placed by `teammates`, and `crowd` the
        movers that all of them meet, instead of the configuration's.
        """
        self.building = building
        self.config = config or SimulatorConfig()
        self.watch = watch or Stopwatch()
        with self.watch.stage("scene"):
            self._meet(others, crowd)
            self.world = self._make_world()
            # Light takes a second in a large building; it cuts walls into pieces.
            plain = self.config.renderer in ("none", "plan")
            self._shaded = building.mesh if plain else shaded_mesh(building)
            self.radio = RadioLink(building, self.config.radio) if uses_radio else None
            self._lidar: Lidar | None = None
            if self.config.robot.lidar != "none":
                meshes = [building.mesh]
                self._lidar = LIDAR.make(
                    self.config.robot.lidar, meshes, self.config.robot.laser, field="lidar"
                )
        self.anchors: dict[str, RadioLink] = {}
        self._anchor_rngs: dict[str, np.random.Generator] = {}
        self._waited_s = 0.0
        self.motion: Motion | None = None
        """Motion by the last action; None before the first."""
        self._recogniser: Recogniser | None = None
        if uses_camera:
            self._recogniser = RECOGNISER.make(
                self.config.recognition, self.config.image, field="recognition"
            )
        self._camera: Camera | None = None
        self._target: tuple[float, ...] | None = None
        self._rng = self._radio_rng = self._depth_rng = self._lidar_rng = np.random.default_rng()
        self._depth = np.zeros((0, 0), np.float32)

    def clone(self, others: Sequence[RobotConfig] = (), crowd: Mover | None = None) -> "Simulator":
        """A second robot in the same building, among others; both share what is built for the building."""
        other = copy(self)
        other._meet(others, crowd)
        other.world = (self.world.clone() if other.movers is None else None) or other._make_world()
        other.radio = None if self.radio is None else self.radio.clone()
        other.anchors, other._anchor_rngs = {}, {}
        other._camera, other._target = None, None
        return other

    def _meet(self, others: Sequence[RobotConfig], crowd: Mover | None) -> None:
        """Make the movers, among them other robots."""
        self.teammates = Teammates(
            [
                Body(radius_m=robot.hull.turning_m, height_m=robot.height_m, look="cylinder")
                for robot in others
            ]
        )
        """The other robots in the building."""
        groups = [self.teammates] if others else []
        radius_m = self.config.robot.hull.turning_m
        self.movers = make_movers(self.config.movers, self.building, radius_m, groups, crowd)

    def _make_world(self) -> Physics:
        # A physics engine of a user need not know of movers, where there are none.
        moving: dict[str, Any] = {} if self.movers is None else {"movers": self.movers}
        world: Physics = PHYSICS.make(self.config.physics, self.building, robot=self.config.robot, **moving)
        return world

    def reset(
        self, task: Task, rng: np.random.Generator, movers_rng: np.random.Generator | None = None
    ) -> Observation:
        """Put the robot at the task's start and the target in its place; all noise is drawn from `rng`.

        What moves is drawn from `movers_rng`, if it is given.
        """
        # Motion and odometry draw from `rng` itself, the sensors that every robot may have from its children, and each
        # other source from a generator of its name: none changes the noise of another.
        self._rng = rng
        self._radio_rng, self._depth_rng, self._lidar_rng = rng.spawn(3)
        if self.movers is not None:
            self.movers.reset(task.start, movers_rng or named_generator(self._radio_rng, "movers"))
        if self._camera is None or self._target != tuple(task.target):
            self.close()
            with self.watch.stage("scene"):
                meshes = [self._shaded, target_mesh(task.target, ceiling_m=self.building.height_m)]
                self._camera = make_camera(meshes, self.config.image, backend=self.config.renderer)
            self._target = tuple(task.target)
        if self.radio is not None:
            self.radio.place(task.target)
            self.anchors = {anchor.name: self.radio.clone() for anchor in task.anchors}
            for anchor in task.anchors:
                self.anchors[anchor.name].place(anchor.place)
                self._anchor_rngs[anchor.name] = named_generator(self._radio_rng, f"anchor {anchor.name}")
        self.world.reset(task.start)
        self.motion, self._waited_s = None, 0.0
        return self._observe(np.zeros(3), None)

    def wait_until(self, time_s: float) -> None:
        """Stand still until movers are at a time, which counts as time of the next action."""
        if self.movers is not None and time_s > self.movers.time_s:
            self._waited_s += time_s - self.movers.time_s
            self.movers.advance(time_s - self.movers.time_s, self.pose)

    def step(self, action: Command) -> tuple[Observation, Motion]:
        """Do one discrete action, with actuation noise, or drive with a velocity."""
        if isinstance(action, Velocity):
            return self.drive(*action)
        commanded = self.config.robot.noise.actuation(action, self._rng)
        before = self.pose
        with self.watch.stage("physics"):
            waits = action is Action.WAIT
            motion = self.world.drive(0.0, 0.0, WAIT_S) if waits else self.world.move(commanded)
        motion, displacement = self._done(motion), between(before, self.pose)
        return self._observe(self.config.robot.noise.sense(action, displacement, self._rng), action), motion

    def drive(self, v_mps: float, w_radps: float, duration_s: float) -> tuple[Observation, Motion]:
        """Drive with a forward speed and a turn rate for a time.

        The noise model is that of discrete actions: odometry noise is scaled from that of the most similar action, by
        the share of it that was done.
        """
        before = self.pose
        with self.watch.stage("physics"):
            motion = self.world.drive(v_mps, w_radps, duration_s)
        motion, displacement = self._done(motion), between(before, self.pose)
        done = Velocity(v_mps, w_radps, duration_s)
        return self._observe(self.config.robot.noise.sense_motion(displacement, self._rng), done), motion

    def _done(self, motion: Motion) -> Motion:
        """Note and return a motion, with the time that the robot waited before it."""
        if self._waited_s:
            motion, self._waited_s = replace(motion, duration_s=self._waited_s + motion.duration_s), 0.0
        self.motion = motion
        return motion

    def interpreter(self, classifier: Part) -> Interpret | None:
        """Make what interprets measurements of a transmitter by its name; None without a radio."""
        if self.radio is None:
            return None
        interpreter = Interpreter(self.radio, classifier)
        return lambda name, paths, pose: interpreter.interpret(paths, pose, self.links[name])

    @property
    def links(self) -> dict[str, RadioLink]:
        """The radio links by transmitter, that of the target first; none without a radio."""
        return {} if self.radio is None else {"target": self.radio, **self.anchors}

    @property
    def pose(self) -> Float[np.ndarray, "3"]:
        """True pose: x [m], y [m], yaw [rad] in `map`."""
        return self.world.pose

    @property
    def true_depth(self) -> Float[np.ndarray, "h w"] | None:
        """Depth of the last observation without noise, for judging [m]; 0 where nothing was hit, None if blind."""
        return None if self.config.renderer == "none" else self._depth

    @property
    def true_laser(self) -> LaserScan | None:
        """The lidar's scan without noise, for judging; None without one."""
        return None if self._lidar is None else self._lidar.true_scan(self.pose, *self._moving())

    def close(self) -> None:
        """Free the camera's OpenGL context."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None

    def _observe(self, odometry: np.ndarray, action: Command | None) -> Observation:
        if self._camera is None:
            raise RuntimeError("The simulator was not reset. Call reset first.")
        with self.watch.stage("camera"):
            pose = camera_pose(self.pose, self.config.image)
            frame = self._camera.render(pose)
            if self.movers is not None and self.config.renderer != "none":
                frame = self.movers.draw(frame, pose, self.config.image)
        # An observation that its reader changes in place is judged as it was.
        self._depth = frame.depth.copy()
        noise, focal_px = self.config.robot.depth_noise, float(self.config.image.focal_px)
        with self.watch.stage("noise"):
            measured = noise.apply(frame.depth, focal_px, self._depth_rng)
        with self.watch.stage("lidar"):
            laser = (
                None if self._lidar is None else self._lidar.scan(self.pose, self._lidar_rng, *self._moving())
            )
        with self.watch.stage("radio"):
            bodies = None if self.movers is None else self.movers.radio_bodies
            paths = None if self.radio is None else self.radio.measure(self.pose, self._radio_rng, bodies)
            anchors = {
                name: link.measure(self.pose, self._anchor_rngs[name], bodies)
                for name, link in self.anchors.items()
            }
        with self.watch.stage("recognition"):
            target = None
            if self._recogniser is not None and self._target is not None:
                ahead = np.array([self.config.image.ahead_m, 0.0])
                place = between(self.pose, np.array([*self._target, 0.0]))[:2] - ahead
                marker = self._recogniser.find(frame._replace(depth=measured), place)
                target = None if marker is None else marker + ahead
        time_s = None if self.movers is None or self.motion is None else self.motion.duration_s
        return Observation(frame.rgb, measured, odometry, paths, anchors, target, laser, time_s, action)

    def _moving(self) -> list[Float[np.ndarray, "m 3 3"]]:
        """The lidar's argument of what moves: none without movers."""
        return [] if self.movers is None else [self.movers.surfaces()[0]]
