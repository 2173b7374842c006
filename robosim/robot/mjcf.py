"""A building and a robot as one MJCF file, which MuJoCo and its viewer open as they are.

Walls, robot, contacts and the step of time are those of `robosim.robot.dynamic`, in the frame `map`. Only the floor
stands still: that of an episode slides under the wheels where a real robot would slip. The robot's wheels take
speeds [rad/s] by the actuators `left` and `right`; the sensor `touch` counts the contacts of its hull with walls.
What is placed in the building is drawn as it is; what stops the robot are upright prisms over the floor that it takes
from a robot of this height, in group 3, which viewers hide.
Left out: the ceiling, and the height of furniture that is cells of the plan, which goes as high as walls.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.building.building import Building
from robosim.building.reach import reach
from robosim.plans.furnishings.furnishing import Furnishing
from robosim.robot.body import add_robot
from robosim.robot.collision import check_pose, placed_solids, wall_solids
from robosim.robot.physics import PhysicsConfig, add_floor_box, add_walls, new_spec
from robosim.robot.physics_engine import mujoco
from robosim.robot.robots import RobotConfig
from robosim.support.files import whole_file

#: Floor beyond the walls [m].
_MARGIN_M = 1.0
#: Group of geoms that viewers hide.
_HIDDEN = 3


def export_mjcf(
    building: Building,
    path: Path,
    *,
    robot: RobotConfig | None = None,
    config: PhysicsConfig | None = None,
    pose: Float[np.ndarray, "3"] | None = None,
) -> Path:
    """Write a building with a robot in it as an MJCF file, whole or not at all; returns the path.

    Without a pose x [m], y [m], yaw [rad] in `map`, the robot stands in the widest place. ValueError if it does not
    fit.
    """
    robot, config = robot or RobotConfig(), config or PhysicsConfig()
    if pose is None:
        pose = np.array([*reach(building, *robot.hull_m).widest(), 0.0])
    check_pose(building.floor(robot.height_m), pose, robot.hull)
    low, high = np.reshape(building.free.bounds, (2, 2))
    # MJCF is written with six digits: of places around the middle of the building they are a tenth of a millimetre.
    origin = np.round((low + high) / 2, 1)
    spec = new_spec(config)
    spec.modelname = building.plan.name
    body = spec.worldbody.add_body(name="building", pos=(*origin, 0.0))
    add_floor_box(body, (high - low) / 2 + _MARGIN_M)
    walls = wall_solids(building.free, building.plan)
    add_walls(spec, walls, config, origin=origin, height_m=building.height_m, body=body)
    placed = placed_solids(building, robot.height_m)
    add_walls(
        spec, placed, config, origin=origin, height_m=robot.height_m, body=body, name="placed", group=_HIDDEN
    )
    _add_looks(spec, body, building.furnishings, origin)
    add_robot(spec, robot, config)
    hull = spec.body("robot")
    hull.pos = (pose[0], pose[1], 0.0)
    hull.quat = (np.cos(pose[2] / 2), 0.0, 0.0, np.sin(pose[2] / 2))
    spec.compile()
    with whole_file(path) as partial:
        partial.write_text(spec.to_xml(), "utf-8")
    return Path(path)


def _add_looks(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    furnishings: tuple[Furnishing, ...],
    origin: Float[np.ndarray, "2"],
) -> None:
    """What is drawn of things in a building, and collides with nothing."""
    for number, furnishing in enumerate(furnishings):
        bodies = furnishing.bodies
        vertices = bodies.vertices - [*origin, 0.0]
        mesh = spec.add_mesh(
            name=f"furnishing{number}", uservert=vertices.ravel(), userface=bodies.faces.ravel()
        )
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # sheets have no volume
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=mesh.name,
            contype=0,
            conaffinity=0,
            rgba=(*np.divide(furnishing.colour, 255), 1),
        )
