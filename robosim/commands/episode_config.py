"""Configuration of an episode on the command line: every field is an option.

Options start from the defaults, or from the configuration of an earlier result (`--config`), from a radio band
(`--band`), and from a robot (`--robot`). These are read before the others, so that `--help-all` shows the values that
the others start from.
"""

import inspect
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import tyro
from tyro.conf import OmitArgPrefixes

from robosim.commands.command_table import value_of
from robosim.episode_config import EpisodeConfig
from robosim.lidar import LidarConfig
from robosim.parts import ROBOT, RobotPart
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.support.from_dict import from_dict
from robosim.support.parts import check_code_allowed, is_part, names_code, part_name
from robosim.support.reading import naming
from robosim.support.text_in import check_object, read_json
from robosim.team.team_config import TeamConfig
from wireless.bands import BandName

#: Configuration of an episode without goal and seed, which are arguments of commands.
Settings = Annotated[EpisodeConfig, tyro.conf.arg(name="")]
#: As published.
DEFAULTS = EpisodeConfig()


@dataclass(frozen=True, kw_only=True)
class StartingPoint:
    """Values that other options start from."""

    config: Path | None = None
    """result.json of an episode, or settings.json of an evaluation, with the configuration to start from."""
    band: BandName = "28ghz"
    """Radio band: carrier, power, waveform, antennas of both ends, and the link-state classifier for them."""
    robot: RobotPart = "turtlebot"
    """Robot: by name, with its hull, speeds and sensors; or a file: URDF, MJCF, or fields such as radius_m: 0.25."""


#: From the defaults.
DEFAULT_START = StartingPoint()
Base = OmitArgPrefixes[StartingPoint]


def start_values(parameters: Mapping[str, inspect.Parameter], words: Sequence[str]) -> dict[str, Any]:
    """Defaults of arguments by `--config`, `--band` and `--robot`, if they are among the words.

    Raises:
        ValueError: If a file cannot be read, or there is no such band or robot.
    """
    file, band, robot = (value_of(option, words) for option in ("--config", "--band", "--robot"))
    _check_named(value_of("--robots", words), words)
    config = DEFAULTS if file is None else read_config(Path(file))
    if band is not None:
        config = config.in_band(band)
    if robot is not None:
        made: RobotConfig = ROBOT.make(robot, field="robot")
        config = config.of_robot(made)
    config = replace(config, simulator=_without_sensors(config.simulator, words))
    values: dict[str, Any] = {"settings": config}
    if file is not None:
        # Commands without a default seed, such as evaluate, keep their own.
        stored = {name: getattr(config, name) for name in ("goal", "seed")}
        values |= {
            name: value
            for name, value in stored.items()
            if name in parameters and parameters[name].default is not None
        }
    return values


def _without_sensors(simulator: SimulatorConfig, words: Sequence[str]) -> SimulatorConfig:
    """Take the lidar off with `--lidar none`.

    Raises:
        ValueError: If there are options of a sensor that the robot does not have.
    """
    robot, camera, lidar = simulator.robot, value_of("--camera", words), value_of("--lidar", words)
    has_camera = robot.camera is not None and (camera or simulator.camera) != "none"
    has_lidar = (lidar or robot.lidar) != "none"
    for word in words:
        if not has_camera and (
            word.startswith(("--image.", "--depth-noise.")) or (word == "--camera" and camera != "none")
        ):
            raise ValueError(
                f"{word} is given, but the robot has no camera. Leave it out, or choose another robot."
            )
        if not has_lidar and word.startswith("--laser."):
            raise ValueError(
                f"{word} is given, but the robot has no lidar. Name one, such as --lidar rplidar-a1."
            )
    if lidar == "none":
        simulator = replace(simulator, robot=replace(robot, lidar="none", laser=LidarConfig()))
    return simulator


def _check_named(robots: str | None, words: Sequence[str]) -> None:
    """Raise ValueError for options of a robot next to names of robots, which come with their values."""
    for word in words if robots and TeamConfig(robots=robots).models else ():
        if word.partition("=")[0].partition(".")[0] in _OF_ROBOT:
            raise ValueError(
                f"{word} is given, but the robots of --robots {robots} come with their values. Leave it out, or give "
                "their number."
            )


def read_config(path: Path) -> EpisodeConfig:
    """The configuration in a result.

    Raises:
        FileError: If there is none, it does not fit, or it names code outside of
            `robosim.support.parts.code_allowed`.
    """
    what, remedy = "a configuration", "Give result.json of an episode, or settings.json of an evaluation."
    content = read_json(path, what, remedy)
    with naming(path, what, remedy):
        settings = content.get("settings")
        config = settings.get("episode") if isinstance(settings, dict) else content.get("config")
        # Settings of an evaluation hold digests of weights: see `robosim.evaluation.evaluate`.
        episode = {key: value for key, value in check_object(config).items() if not key.endswith(" content")}
        if "wall_passage" not in json.dumps(episode) and "max_transmissions" in json.dumps(episode):
            raise ValueError("of version 0.2 of robosim, which counted walls by faces")
        made = from_dict(EpisodeConfig, episode)
        for model in made.team.models:
            check_code_allowed("team.robots", model)
        return made


#: Fields of a robot that are no options: they are in files only.
_OF_FILES = ("outline_m", "model", "odometry")
#: Fields of a robot that are options without its name.
_OF_SENSORS = {
    "camera": "image",
    "lidar": "lidar",
    "laser": "laser",
    "noise": "noise",
    "depth_noise": "depth-noise",
}
#: Beginnings of the options of a robot.
_OF_ROBOT = ("--robot", *(f"--{option}" for option in _OF_SENSORS.values()))


def command_options(config: EpisodeConfig) -> str:
    """Options that differ from the defaults, as typed; without goal and seed.

    A robot with more than the options describe, such as a calibrated one, is in the `settings.json` of a run.
    """
    robot = config.simulator.robot
    in_file = robot.camera is None or any(
        getattr(robot, name) != getattr(RobotConfig, name) for name in _OF_FILES
    )
    words = _words(config, DEFAULTS, "")
    if in_file:
        words = ["--config settings.json", *(["--allow-code"] if any(map(names_code, words)) else []), *words]
    return " ".join(words)


def _words(value: Any, default: Any, prefix: str) -> list[str]:
    words = []
    for field in fields(value):
        if field.name in ("goal", "seed") and not prefix:
            continue
        mine, usual = getattr(value, field.name), getattr(default, field.name)
        if is_part(field) and not isinstance(mine, str):
            mine = part_name(mine)
        if mine == usual or (prefix == "robot." and field.name in _OF_FILES):
            continue
        option = field.name.replace("_", "-")
        if prefix == "robot." and field.name in _OF_SENSORS:
            option, prefix_here = _OF_SENSORS[field.name], ""
        else:
            prefix_here = "" if field.name == "robots" else prefix
        if mine is None and field.name == "camera":
            continue  # the robot's name says so
        if hasattr(mine, "__dataclass_fields__"):
            words += _words(mine, usual, "" if field.name == "simulator" else f"{prefix_here}{option}.")
        elif isinstance(mine, bool):
            words.append(f"--{prefix_here}{option}" if mine else f"--{prefix_here}no-{option}")
        else:
            several = mine if isinstance(mine, tuple) else (mine,)
            words += [f"--{prefix_here}{option}", *(quote(str(item)) for item in several)]
    return words
