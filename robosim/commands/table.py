"""Which commands there are: a table that imports none of them, so that each starts with what it needs itself."""

import importlib
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from tyro.conf import FlagCreatePairsOff, OmitArgPrefixes

#: Commands by their words, and where they are. None is imported before it is asked for.
COMMANDS = {
    "episode": "episode:episode",
    "replay": "replay:replay",
    "view": "replay:view",
    "live": "live:live",
    "evaluate": "evaluate:evaluate",
    "plan": "scenes:plan",
    "trace": "trace:trace",
    "dataset": "dataset:dataset",
    "generate": "scenes:generate",
    "collect": "collect:collect",
    "collect-searches": "collect:collect_searches",
    "calibrate": "calibrate:calibrate",
    "calibrate-materials": "calibrate_materials:calibrate_materials",
    "slam": "slam:slam",
    "doctor": "machine:doctor",
    "train link-state": "train:link_state",
    "train mapper": "train:mapper",
    "train pose": "train:pose",
    "train explorer": "train_policies:explorer",
    "train steering": "train_policies:steering",
    "train search": "train_policies:search",
}
#: Commands of two words by their first.
GROUPS = {
    "train": "Train what is learnt",
}
#: Words that ask for the help of a command, and for all options in it.
HELP, HELP_ALL = {"-h", "--help"}, "--help-all"


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


_USUAL = Common()


def named(words: list[str]) -> str:
    """The command that words begin with; empty if they begin with none."""
    two = " ".join(words[:2])
    return two if two in COMMANDS else words[0] if words and words[0] in COMMANDS else ""


def loaded(name: str) -> Callable[..., None]:
    """The function of a command."""
    module, function = COMMANDS[name].split(":")
    found: Callable[..., None] = getattr(importlib.import_module(f"robosim.commands.{module}"), function)
    return found


def with_common(command: Callable[..., None]) -> Callable[..., None]:
    """A command with the options of every command."""

    def call(*args: Any, common: Common = _USUAL, **options: Any) -> None:
        if common.figures == "png":
            return command(*args, **options)
        import matplotlib

        with matplotlib.rc_context({"savefig.format": common.figures}):
            return command(*args, **options)

    return declared(call, command, {"common": {"default": _USUAL, "annotation": OmitArgPrefixes[Common]}})


def said(name: str) -> str:
    """What a list says of a command: the first sentence of its function, which is read and not imported."""
    module, function = COMMANDS[name].split(":")
    source = (Path(__file__).parent / f"{module}.py").read_text("utf-8")
    # Parsing a file takes ten times as long.
    found = re.search(rf'^def {function}\(.*?"""(.*?)(?:\n\n|""")', source, re.DOTALL | re.MULTILINE)
    if found is None:
        raise LookupError(f"{module}.py has no function {function} with a docstring.")
    return " ".join(found[1].split())


def listed(group: str = "") -> dict[str, Callable[..., None]]:
    """What a list of commands shows: those of a group, or those of one word and the groups."""
    if group:
        return {name.split()[1]: _saying(said(name)) for name in COMMANDS if name.startswith(f"{group} ")}
    of_one_word = {name: _saying(said(name)) for name in COMMANDS if " " not in name}
    return of_one_word | {
        name: _saying(f"{text}: {', '.join(listed(name))}.") for name, text in GROUPS.items()
    }


def declared(
    call: Callable[..., None], command: Callable[..., None], changes: Mapping[str, Mapping[str, Any]]
) -> Callable[..., None]:
    """A function that calls in a command's place, with its help; `changes` are defaults and annotations of its own."""
    parameters = dict(inspect.signature(command).parameters)
    for name, change in changes.items():
        one = parameters.get(name, inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY))
        parameters[name] = one.replace(**change)
    # tyro takes hints from what a function wraps, if it is checked as in tests.
    vars(call).pop("__wrapped__", None)
    call.__name__, call.__doc__ = command.__name__, command.__doc__
    call.__signature__ = inspect.Signature(list(parameters.values()))  # type: ignore[attr-defined]
    call.__annotations__ = {name: one.annotation for name, one in parameters.items()}
    return call


def _saying(text: str) -> Callable[..., None]:
    """Something for a list to show a text of."""

    def command() -> None: ...

    command.__doc__ = text
    return command
