"""Files of robots: fields of `RobotConfig` in YAML or JSON, or a description in URDF or MJCF."""

from dataclasses import asdict
from pathlib import Path

from robosim.robot.model_file import read_model
from robosim.robot.robots import RobotConfig
from robosim.support.files import write_json
from robosim.support.from_dict import from_dict
from robosim.support.reading import reading
from robosim.support.text_in import parse_json, parse_yaml


def read_robot(path: Path) -> RobotConfig:
    """A robot from a file of any of these kinds; FileError if it is damaged, or no differential drive."""
    with reading(
        path, "a robot", "Give URDF, MJCF, or fields of RobotConfig, such as radius_m: 0.25"
    ) as file:
        content = file.read()
        if content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
            return read_model(path)
        parse = parse_json if path.suffix == ".json" else parse_yaml
        return from_dict(RobotConfig, parse(content))


def write_robot(path: Path, robot: RobotConfig) -> None:
    """Write a robot as JSON for `read_robot`."""
    write_json(path, asdict(robot))
