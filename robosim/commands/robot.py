"""`robosim robot`."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table
from tyro.conf import Positional

from robosim.commands.output import console, emit_result
from robosim.parts import ROBOT, RobotPart


def robot(robot: Positional[RobotPart]) -> None:
    """Print what is read of a robot: wheels, hull, masses, camera, lidar, and what is assumed.

    Examples: robosim robot turtlebot4; robosim robot cart.urdf --json

    Args:
        robot: A robot by name, or a file: URDF, MJCF, or fields of RobotConfig in YAML or JSON.
    """
    from robosim.robot.model_file import model_of, robot_of
    from robosim.robot.robot_files import is_description

    is_model = isinstance(robot, str) and Path(robot).is_file() and is_description(Path(robot))
    model = model_of(Path(robot)) if is_model else None
    config = ROBOT.make(robot) if model is None else robot_of(Path(robot), model)
    camera, laser, hull = config.camera, config.laser, config.hull
    result: dict[str, Any] = {"robot": asdict(config)} | ({} if model is None else model.report())
    rows = [("hull", f"{len(config.outline_m)} corners" if config.outline_m else "disk")]
    rows += [("hull reaches", f"{hull.turning_m:.4g} m from the axle, {hull.radius_m:.4g} m to the side")]
    rows += [("wheels", f"radius {config.wheel_radius_m:.4g} m, track {config.track_m:.4g} m")]
    rows += [("mass without wheels", f"{config.mass_kg:.4g} kg")]
    if camera is not None:
        optics = f"{camera.hfov_deg:.4g} degrees wide"
        rows += [("camera", f"{camera.ahead_m:g} m ahead, {camera.height_m:g} m high, {optics}")]
    if config.lidar != "none":
        rows += [("lidar", f"{config.lidar}, {laser.ahead_m:g} m ahead, {laser.height_m:g} m high")]
    if model is not None:
        rows += [
            (f"{each['side']} wheel", f"{each['link']}, joint {each['joint']}") for each in result["wheels"]
        ]
        sensors = result["sensors"].items()
        rows += [(f"{kind} of the file", "none" if each is None else each["name"]) for kind, each in sensors]
        rows += [(f"mass of {link}", f"{mass_kg:g} kg") for link, mass_kg in model.masses_kg.items()]
        rows += [("mass with wheels", f"{result['total_mass_kg']:g} kg")]
        rows += [("fixed joints", ", ".join(model.fixed_joints) or "none")]
        rows += [("assumed", note) for note in result["assumed"]]
    table = Table("read", "value", show_header=False)
    for row in rows:
        table.add_row(*row)
    emit_result(result)
    console.print(table)
