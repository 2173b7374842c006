"""The robot's surroundings in MuJoCo: a floor that can slide, and walls.

Contacts are soft in MuJoCo: what sinks in is pushed out with a time constant, of which the step may be
half at most. Hitting a wall at speed v a body sinks in by v / e times the time constant (critical
damping): 2 mm at 0.5 m/s and steps of 5 ms.

Wheels cannot move a robot sideways, but a real robot slips. So the floor is a heavy body that slides: the
wheels hold on to it, and walls still stop the robot, with no more force than the wheels' grip.
What is placed in a building is walls of the floor that it takes (`robosim.robot.collision`).
Left out: anything but floor and walls, and what is above the robot.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float

from robosim.robot.collision import WallSolids
from robosim.robot.physics_engine import mujoco
from robosim.support.checks import Range, checked

#: Collision bits: walls meet the hull only, the floor wheels and casters only.
WALL, FLOOR = 1, 2


@dataclass(frozen=True, kw_only=True)
@checked
class PhysicsConfig:
    """How finely physics is computed, and how rough things are."""

    timestep_s: Annotated[float, Range(1e-4, 0.01, "s", "Beyond, contacts are too soft to hold.")] = 0.005
    """Step of the physics engine [s]."""
    control_period_s: Annotated[float, Range(1e-4, 0.1, "s")] = 0.02
    """Time between two commands to the wheels [s]."""
    floor_friction: Annotated[float, Range(0, 100)] = 0.6
    """Grip of the wheels on the floor. Wheels that slip hop, the more the better their grip."""
    wall_friction: Annotated[float, Range(0, 100)] = 0.0
    """Friction of the hull on walls. At 0.1 a robot that scrapes along a wall covers half the distance."""

    def __post_init__(self) -> None:
        if self.control_period_s < self.timestep_s:
            raise ValueError(
                f"control_period_s is {self.control_period_s}, expected at least timestep_s = {self.timestep_s} s."
            )

    @property
    def control_steps(self) -> int:
        """Physics steps between two commands to the wheels."""
        return max(1, round(self.control_period_s / self.timestep_s))

    @property
    def hard(self) -> dict[str, tuple[float, ...]]:
        """MuJoCo's parameters of the hardest contact that is stable."""
        return {"solref": (2 * self.timestep_s, 1.0), "solimp": (0.99, 0.999, 0.001, 0.5, 2.0)}


def new_spec(config: PhysicsConfig) -> mujoco.MjSpec:
    """An empty model with the engine's settings."""
    spec = mujoco.MjSpec()
    spec.option.timestep = config.timestep_s
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC  # wheels grip alike in all directions
    return spec


def add_floor(spec: mujoco.MjSpec, half_m: Float[np.ndarray, "2"]) -> None:
    """Add a floor at height zero, of half sizes [m], that slides with its joints `floor_x` and `floor_y`."""
    # So heavy that it keeps the speed it is given, whatever the wheels do.
    floor = spec.worldbody.add_body(
        name="floor", mass=1e6, ipos=(0, 0, 0), inertia=(1.0, 1.0, 1.0), explicitinertial=True
    )
    for name, axis in (("floor_x", (1, 0, 0)), ("floor_y", (0, 1, 0))):
        floor.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    add_floor_box(floor, half_m)


def add_floor_box(body: mujoco.MjsBody, half_m: Float[np.ndarray, "2"]) -> None:
    """Add the floor itself to a body, around its origin, by half of its size along x and y [m]."""
    body.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=(0, 0, -0.5),
        size=(*half_m, 0.5),
        rgba=(0.55, 0.5, 0.45, 1),
        contype=FLOOR,
        conaffinity=0,
    )


def add_walls(
    spec: mujoco.MjSpec,
    walls: WallSolids,
    config: PhysicsConfig,
    *,
    origin: Float[np.ndarray, "2"],
    height_m: float,
    body: mujoco.MjsBody | None = None,
    name: str = "prism",
    group: int = 0,
) -> None:
    """Add walls as upright prisms from below the floor to a height, to a body or to the world.

    `origin` is the body's origin in `map` [m]. Viewers show groups 0 to 2 of geoms.
    """
    body = spec.worldbody if body is None else body
    low, high = -1.0, height_m  # the hull must never meet an upper or lower edge
    common: dict[str, Any] = {"contype": WALL, "conaffinity": 0, "rgba": (0.85, 0.85, 0.82, 1), **config.hard}
    common["group"] = group
    for x, y, length, width, yaw in walls.boxes:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=(x - origin[0], y - origin[1], (low + high) / 2),
            size=(length, width, (high - low) / 2),
            quat=(math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)),
            **common,
        )
    for number, prism in enumerate(walls.prisms):
        corners = prism - origin
        vertices = np.vstack([np.insert(corners, 2, z, axis=1) for z in (low, high)])
        mesh = spec.add_mesh(name=f"{name}{number}", uservert=vertices.ravel())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name, **common)


def add_movers(
    spec: mujoco.MjSpec,
    radius_m: Float[np.ndarray, " n"],
    height_m: Float[np.ndarray, " n"],
    config: PhysicsConfig,
) -> None:
    """Add upright cylinders with round ends that are moved from outside and stop the hull, as walls do."""
    for radius, height in zip(radius_m.tolist(), height_m.tolist(), strict=True):
        spec.worldbody.add_body(mocap=True).add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=(radius, height, 0),
            contype=WALL,
            conaffinity=0,
            rgba=(0.5, 0.5, 0.8, 1),
            **config.hard,
        )
