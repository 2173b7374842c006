"""Table of all commands. It imports none of them, so that each starts with what it needs itself."""

import importlib
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from tyro.conf import FlagCreatePairsOff, OmitArgPrefixes

from robosim.commands.option_help import brief_description, option_type
from robosim.support.checks import check_arguments

#: Commands by their words, each as `module:function` of this package.
COMMANDS = {
    "episode": "episode:episode",
    "replay": "live:replay",
    "export": "live:export",
    "live": "live:live",
    "evaluate": "evaluate:evaluate",
    "plan": "scenes:plan",
    "trace": "links:trace",
    "dataset": "links:dataset",
    "robot": "robot:robot",
    "generate": "scenes:generate",
    "collect": "collect:collect",
    "collect-searches": "collect:collect_searches",
    "calibrate": "calibrate:calibrate",
    "calibrate-materials": "calibrate:calibrate_materials",
    "slam": "slam:slam",
    "locate": "locate:locate",
    "doctor": "machine:doctor",
    "warm-up": "machine:warm_up",
    "train link-state": "train:link_state",
    "train mapper": "train:mapper",
    "train explorer": "train:explorer",
    "train search": "train:search",
}
#: Commands of two words by their first.
GROUPS = {"train": "Train networks"}


@dataclass(frozen=True, kw_only=True)
class Common:
    """Options of every command; --json, --quiet and --debug may stand anywhere on the command line."""

    json: FlagCreatePairsOff[bool] = False
    """Print the result as one JSON object, and nothing else."""
    quiet: FlagCreatePairsOff[bool] = False
    """Print errors only."""
    debug: FlagCreatePairsOff[bool] = False
    """Print where in the code an error comes from."""
    figures: Literal["png", "pdf", "svg"] = "png"
    """Format of figures; pdf and svg are written next to the PNG files."""


_DEFAULTS = Common()


def command_name(words: list[str]) -> str:
    """The command that words begin with; empty if they begin with none."""
    names = (" ".join(words[:2]), words[0] if words else "")
    return next((name for name in names if name in COMMANDS), "")


def load_command(name: str) -> Callable[..., None]:
    """The function of a command."""
    module, function = COMMANDS[name].split(":")
    command: Callable[..., None] = getattr(importlib.import_module(f"robosim.commands.{module}"), function)
    return command


def with_options(
    command: Callable[..., None], *, defaults: Mapping[str, Any] | None = None, brief: bool = False
) -> Callable[..., None]:
    """A command as `tyro.cli` takes it: its arguments are checked, and it has the options of every command.

    Args:
        command: The function of a command.
        defaults: Values of arguments that replace its defaults.
        brief: Whether its help leaves out advanced options.
    """

    def call(*args: Any, common: Common = _DEFAULTS, **options: Any) -> None:
        check_arguments(command, options)
        if common.figures == "png":
            return command(*args, **options)
        import matplotlib

        with matplotlib.rc_context({"savefig.format": common.figures}):
            return command(*args, **options)

    parameters = [
        each.replace(
            annotation=option_type(each.annotation, brief=brief),
            default=(defaults or {}).get(name, each.default),
        )
        for name, each in inspect.signature(command).parameters.items()
    ]
    everywhere = inspect.Parameter(
        "common", inspect.Parameter.KEYWORD_ONLY, default=_DEFAULTS, annotation=OmitArgPrefixes[Common]
    )
    # tyro reads annotations of what a function wraps, which it does if types are checked, as in tests.
    vars(call).pop("__wrapped__", None)
    call.__name__ = command.__name__
    call.__doc__ = brief_description(command) if brief else command.__doc__
    call.__signature__ = inspect.Signature([*parameters, everywhere])  # type: ignore[attr-defined]
    call.__annotations__ = {each.name: each.annotation for each in (*parameters, everywhere)}
    return call


def command_summary(name: str) -> str:
    """The first sentence of a command's function, which is read from its file and not imported."""
    module, function = COMMANDS[name].split(":")
    source = (Path(__file__).parent / f"{module}.py").read_text("utf-8")
    # Parsing a file takes ten times as long.
    match = re.search(rf'^def {function}\(.*?"""(.*?)(?:\n\n|""")', source, re.DOTALL | re.MULTILINE)
    if match is None:
        raise LookupError(f"{module}.py has no function {function} with a docstring.")
    return " ".join(match[1].split())


def command_list(group: str = "") -> dict[str, str]:
    """Summaries of the commands of a group, or of the commands of one word and the groups."""
    if group:
        return {name.split()[1]: command_summary(name) for name in COMMANDS if name.startswith(f"{group} ")}
    texts = {name: command_summary(name) for name in COMMANDS if " " not in name}
    return texts | {name: f"{text}: {', '.join(command_list(name))}." for name, text in GROUPS.items()}


def value_of(option: str, words: Sequence[str]) -> str | None:
    """The last value of an option; None if it is not given."""
    value = None
    for word, following in zip(words, [*words, None][1:], strict=True):
        if word == option:
            value = following
        elif word.startswith(f"{option}="):
            value = word.partition("=")[2]
    return value
