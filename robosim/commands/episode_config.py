"""The configuration of an episode on the command line: every typed field of it is an option.

Options that are not given start from `--config`, the configuration of an earlier result, or from the defaults, and from
the robot that `--robot` names. Both are read before the others, so that `--help-all` shows what the others start from.
`--help` shows a line for each group of options, such as `--radio.*`; `--help-all` shows all options.
"""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, make_dataclass, replace
from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import tyro
from tyro.conf import OmitArgPrefixes, Suppress

from robosim.commands.table import HELP, HELP_ALL, declared
from robosim.episode import EpisodeConfig
from robosim.evaluation.ablations import POLICY
from robosim.parts import ROBOT, RobotPart
from robosim.robot.robots import RobotConfig
from robosim.support.from_dict import from_dict
from robosim.support.parts import Part, is_part, names_code, told
from robosim.support.reading import naming
from robosim.support.text_in import check_object, read_json
from wireless.support.counting import counted

_MORE = "Groups of options; --help-all shows each option."
#: All of an episode's configuration but goal and seed, which commands ask for themselves.
Settings = Annotated[EpisodeConfig, tyro.conf.arg(name="")]
#: A goal policy, or a variant of `fused`.
GoalOption = Annotated[Part, POLICY.option()]
#: As published.
DEFAULTS = EpisodeConfig()


@dataclass(frozen=True, kw_only=True)
class StartingPoint:
    """What options that are not given start from."""

    config: Path | None = None
    """result.json of an episode, or settings.json of an evaluation, whose configuration holds where none is given."""
    robot: RobotPart = "turtlebot"
    """turtlebot has a hull of radius 0.10 m, locobot 0.18 m; a file says fields, such as radius_m: 0.25."""


#: From the defaults.
AS_PUBLISHED = StartingPoint()
Base = OmitArgPrefixes[StartingPoint]


def started(command: Callable[..., None], words: Sequence[str]) -> Callable[..., None]:
    """A command with `settings` whose defaults are those of `--config` and `--robot`, if they are among the words.

    Raises:
        ValueError: If a file cannot be read, or there is no such robot.
    """
    parameters = inspect.signature(command).parameters
    file, robot = _value_of("--config", words), _value_of("--robot", words)
    config = DEFAULTS if file is None else read_config(Path(file))
    if robot is not None:
        made: RobotConfig = ROBOT.make(robot, field="robot")
        config = replace(config, simulator=replace(config.simulator, robot=made))
    changes: dict[str, dict[str, Any]] = {"settings": {"default": config}}
    if HELP_ALL not in words and not HELP.isdisjoint(words):
        groups: list[tuple[str, Any, Any]] = []
        brief, kind = _without_groups(config, groups)
        changes["settings"] = {"default": brief, "annotation": Annotated[kind, tyro.conf.arg(name="")]}
        more: Any = make_dataclass("More", groups, namespace={"__doc__": _MORE})
        changes["more"] = {"default": more(), "annotation": Annotated[more, OmitArgPrefixes]}
    if file is not None:
        # An evaluation's seed is not an episode's.
        own = (
            name for name in ("goal", "seed") if name in parameters and parameters[name].default is not None
        )
        changes |= {name: {"default": getattr(config, name)} for name in own}
    return declared(lambda *args, **options: command(*args, **options), command, changes)


def _without_groups(config: Any, groups: list[tuple[str, Any, Any]]) -> tuple[Any, Any]:
    """A configuration whose groups of options are hidden, and its type; appends a line for each group to `groups`."""
    values = {one.name: getattr(config, one.name) for one in fields(config)}
    kinds: dict[str, Any] = {}
    for name, value in values.items():
        if name == "simulator":
            values[name], kind = _without_groups(value, groups)
            kinds[name] = Annotated[kind, tyro.conf.arg(name="")]
        elif is_dataclass(value):
            kinds[name] = Annotated[type(value), Suppress]
            about, hint = (value.__doc__ or "").splitlines()[0], f"({counted(_count(value), 'option')})"
            option = tyro.conf.arg(name=f"{name}.*", metavar="...", help=about, help_behavior_hint=hint)
            groups.append((name, Annotated[str, option], ""))
    hidden = [(name, kind, values[name]) for name, kind in kinds.items()]
    brief = make_dataclass(type(config).__name__, hidden, bases=(type(config),), frozen=True, kw_only=True)
    return brief(**values), brief


def _count(config: Any) -> int:
    """Options of a group and of the groups in it."""
    shown = [one for one in fields(config) if Suppress not in getattr(one.type, "__metadata__", ())]
    values = [getattr(config, one.name) for one in shown]
    return sum(_count(value) if is_dataclass(value) else 1 for value in values)


def _value_of(option: str, words: Sequence[str]) -> str | None:
    """What an option is given, the last time that it is; None if it is not."""
    found = None
    for word, after in zip(words, [*words, None][1:], strict=True):
        if word == option:
            found = after
        elif word.startswith(f"{option}="):
            found = word.partition("=")[2]
    return found


def read_config(path: Path) -> EpisodeConfig:
    """The configuration that is told in a result.

    Raises:
        FileError: If there is none, or it is none of an episode, or names code outside of
            `robosim.support.parts.code_allowed`.
    """
    what, remedy = "a configuration", "Give result.json of an episode, or settings.json of an evaluation."
    content = read_json(path, what, remedy)
    with naming(path, what, remedy):
        settings = content.get("settings")
        config = settings.get("episode") if isinstance(settings, dict) else content.get("config")
        # An evaluation's settings hold digests of weights, too: see `robosim.evaluation.manifest`.
        given = {key: value for key, value in check_object(config).items() if not key.endswith(" content")}
        _keep_passage(given)
        return from_dict(EpisodeConfig, given)


def _keep_passage(values: dict[str, Any]) -> None:
    """Files of 0.2 counted each face of a wall; they keep their meaning."""
    found: Any = values
    for key in ("simulator", "radio", "tracer"):
        found = found.get(key) if isinstance(found, dict) else None
    if isinstance(found, dict) and "max_transmissions" in found:
        found.setdefault("wall_passage", "face")


def words_of(config: EpisodeConfig) -> str:
    """What to type to get a configuration, goal and seed aside: what differs from the defaults.

    A calibrated robot has more numbers than anybody would type: it stands in `settings.json` of what was run with it.
    """
    calibrated = config.simulator.robot.odometry is not None
    words = _words(config, DEFAULTS, "")
    if calibrated:
        words = ["--config settings.json", *(["--allow-code"] if any(map(names_code, words)) else []), *words]
    return " ".join(words)


def _words(value: Any, default: Any, prefix: str) -> list[str]:
    words = []
    for field in fields(value):
        if field.name in ("goal", "seed") and not prefix:
            continue
        mine, usual = getattr(value, field.name), getattr(default, field.name)
        if is_part(field) and not isinstance(mine, str):
            mine = told(mine)
        if mine == usual or (prefix, field.name) == ("robot.", "odometry"):
            continue
        option = field.name.replace("_", "-")
        if hasattr(mine, "__dataclass_fields__"):
            words += _words(mine, usual, "" if field.name == "simulator" else f"{prefix}{option}.")
        elif isinstance(mine, bool):
            words.append(f"--{prefix}{option}" if mine else f"--{prefix}no-{option}")
        else:
            several = mine if isinstance(mine, tuple) else (mine,)
            words += [f"--{prefix}{option}", *(quote(str(one)) for one in several)]
    return words
