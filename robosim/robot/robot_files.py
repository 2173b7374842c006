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
        if _is_xml(content):
            return read_model(path)
        parse = parse_json if path.suffix == ".json" else parse_yaml
        return from_dict(RobotConfig, parse(content))


def is_description(path: Path) -> bool:
    """Whether a file is a description in URDF or MJCF."""
    with reading(path, "a robot") as file:
        return _is_xml(file.read(1000))


def _is_xml(content: bytes) -> bool:
    return content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")


def write_robot(path: Path, robot: RobotConfig) -> None:
    """Write a robot as JSON for `read_robot`."""
    write_json(path, asdict(robot))
