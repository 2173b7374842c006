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
    from robosim.robot.model_file import model_of, robot_of, unstated
    from robosim.robot.robot_files import is_description

    model = None
    if isinstance(robot, str) and Path(robot).is_file() and is_description(Path(robot)):
        model = model_of(Path(robot))
        config = robot_of(Path(robot), model)
    else:
        config = ROBOT.make(robot)
    result: dict[str, Any] = {"robot": asdict(config)}
    table = Table("read", "value", show_header=False)
    x, y = zip(*config.outline_m, strict=True) if config.outline_m else ((0.0,), (0.0,))
    hull = f"x {min(x):g} to {max(x):g} m, y {min(y):g} to {max(y):g} m, {len(x)} corners"
    table.add_row("hull", hull if config.outline_m else f"disk of {config.hull.radius_m:g} m")
    table.add_row("wheels", f"radius {config.wheel_radius_m:g} m, track {config.track_m:g} m")
    table.add_row("mass without wheels", f"{config.mass_kg:g} kg")
    camera, laser = config.camera, config.laser
    if camera is not None:
        table.add_row(
            "camera",
            f"{camera.ahead_m:g} m ahead, {camera.height_m:g} m high, {camera.hfov_deg:.4g} degrees wide",
        )
    if config.lidar != "none":
        table.add_row("lidar", f"{config.lidar}, {laser.ahead_m:g} m ahead, {laser.height_m:g} m high")
    if model is not None:
        wheels = [
            {"side": side, **wheel._asdict()}
            for side, of_side in zip(("left", "right"), model.wheels, strict=True)
            for wheel in of_side
        ]
        sensors = {
            kind: None
            if sensor is None
            else {"name": sensor.name, "place_m": sensor.place, "hfov_deg": sensor.hfov_deg}
            for kind, sensor in (("camera", model.camera), ("lidar", model.lidar))
        }
        for wheel in wheels:
            table.add_row(f"{wheel['side']} wheel", f"{wheel['link']}, joint {wheel['joint']}")
        for kind, sensor in sensors.items():
            table.add_row(f"{kind} at", "none" if sensor is None else str(sensor["name"]))
        for link, mass_kg in model.masses_kg.items():
            table.add_row(f"mass of {link}", f"{mass_kg:g} kg")
        total_kg = sum(model.masses_kg.values())
        table.add_row("mass with wheels", f"{total_kg:g} kg")
        table.add_row("fixed joints", ", ".join(model.fixed_joints) or "none")
        result |= {
            "wheels": wheels,
            "masses_kg": model.masses_kg,
            "total_mass_kg": total_kg,
            "fixed_joints": model.fixed_joints,
            "sensors": sensors,
            "assumed": [*model.notes, *unstated(model)],
        }
        for note in result["assumed"]:
            table.add_row("assumed", note)
    emit_result(result)
    console.print(table)
