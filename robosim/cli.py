"""The `robosim` command: parses the command line, runs the command, prints its result.

Bad input ends in one sentence on standard error and exit status 2, never in a traceback; `--debug` shows that too.
`--allow-code`, `--debug`, `--quiet`, `--json` and `--version` may stand anywhere on the command line.
"""

import errno
import inspect
import logging
import os
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from typing import Annotated, Any, Union

import tyro
from rich.console import Console
from rich.logging import RichHandler
from rich.text import Text

from robosim.commands.command_table import (
    COMMANDS,
    GROUPS,
    command_list,
    command_name,
    load_command,
    with_options,
)
from robosim.commands.option_help import HELP, HELP_ALL, option_registry
from robosim.commands.output import output_mode
from robosim.support.checks import check_choice
from robosim.support.installation import EXTRAS, missing_extra, namesake, package_version
from robosim.support.interrupt import SIGNALLED, unwinding
from robosim.support.parts import code_allowed, place_in_part
from robosim.support.processes import reuse_processes
from robosim.support.reading import is_ours

#: Options of every command, in any place.
_EVERYWHERE = ("--debug", "--quiet", "--json", "--version", "--allow-code")
_EVERYWHERE_HELP = (
    "Everywhere: --quiet prints errors only, --json prints the result as one JSON object and nothing else, --debug "
    "prints where an error comes from, --version prints the version, --allow-code runs code that a suite or a "
    "configuration names as module:Name. Each command also takes --figures pdf or svg."
)
#: Options of the completion in shells.
_COMPLETION = ("--tyro-print-completion", "--tyro-write-completion")
#: Errors of full disks, of quotas, and of disks that have become read-only.
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the `robosim` command.

    Ends with status 2 for bad input, 1 for failed work, 130 after Ctrl-C, 143 after SIGTERM, 141 after the reader of
    its output has closed the pipe.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    everywhere = {word for word in words if word in _EVERYWHERE}
    words = [word for word in words if word not in _EVERYWHERE]
    if "--version" in everywhere:
        print(f"robosim {package_version()}")
        return
    handler = RichHandler(console=Console(stderr=True), show_time=False, show_path=False)
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[handler])
    if conflict := namesake():
        logging.getLogger(__name__).warning(conflict)
    try:
        with (
            unwinding() as interrupt,
            reuse_processes(),
            output_mode(quiet="--quiet" in everywhere, as_json="--json" in everywhere),
            code_allowed("--allow-code" in everywhere),
        ):
            _run(words)
            sys.stdout.flush()
    except KeyboardInterrupt:
        sys.exit(SIGNALLED + signal.SIGINT)
    except BrokenPipeError:
        # The reader has closed the pipe: what Python still flushes goes to the null device.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(SIGNALLED + signal.SIGPIPE)
    except Exception as error:
        if interrupt.is_requested:
            sys.exit(SIGNALLED + interrupt.signal)
        status, line = _explained(error)
        if "--debug" in everywhere:
            traceback.print_exception(error)
        # Names of files and other words from outside are no markup.
        Console(stderr=True).print(Text(f"robosim: {line}", "red"), soft_wrap=True)
        sys.exit(status)


def _run(words: list[str]) -> None:
    for before, value in zip(["", *words], words, strict=False):
        option, _, argument = value.partition("=")
        if not value or (option.startswith("--") and "=" in value and not argument):
            raise ValueError(f"{option or before or 'an argument'} is empty, expected a value.")
    if name := command_name(words):
        command, rest = load_command(name), words[len(name.split()) :]
        parameters, defaults = inspect.signature(command).parameters, dict[str, Any]()
        if "settings" in parameters:
            from robosim.commands.episode_config import start_values  # imports the whole simulator

            defaults = start_values(parameters, rest)
        elif "band" in parameters:
            from robosim.commands.shared_options import band_values  # which the command has imported

            defaults = band_values(parameters, rest)
        brief = HELP_ALL not in rest and not HELP.isdisjoint(rest)
        tyro.cli(
            with_options(command, defaults=defaults, brief=brief),
            prog=f"robosim {name}",
            args=["--help" if word == HELP_ALL else word for word in rest],
            registry=option_registry(brief=brief),
        )
        return
    group = words[0] if words and words[0] in GROUPS else ""
    description = GROUPS.get(
        group,
        "Robots with camera and radio in buildings made from floor plans. Each command has its own --help. "
        + _EVERYWHERE_HELP,
    )
    summaries, rest = command_list(group), words[1:] if group else words
    rest = ["--help" if word == HELP_ALL else word for word in rest]
    if rest and not rest[0].startswith("-"):
        check_choice("the command", rest[0], summaries)
    commands = {name: _stand_in(text) for name, text in summaries.items()}
    if any(word.startswith(_COMPLETION) for word in rest):
        commands |= {name: with_options(load_command(name)) for name in COMMANDS if " " not in name}
        commands |= {name: _union(name) for name in GROUPS}
    prog = f"robosim {group}".strip()
    tyro.extras.subcommand_cli_from_dict(commands, prog=prog, description=description, args=rest)


def _stand_in(summary: str) -> Callable[..., None]:
    """A function with the summary of a command, for lists of commands."""

    def command() -> None: ...

    command.__doc__ = summary
    return command


def _explained(error: Exception) -> tuple[int, str]:
    """Exit status and one line for an error."""
    text = " ".join(str(error).split())
    if isinstance(error, ChildProcessError):
        return 1, text
    if (place := place_in_part(error)) and not is_ours(error):
        status = 2 if isinstance(error, ValueError) else 1
        return status, f"{type(error).__name__} in your own part, {place}: {text}. --debug shows all of it."
    if isinstance(error, ValueError):
        return 2, text
    if isinstance(error, ImportError) and error.name in EXTRAS:
        return 2, str(missing_extra(error.name, "this"))
    if isinstance(error, OSError):
        if error.errno in _FULL:
            where = f" ({error.filename})" if error.filename else ""
            return 1, (
                f"cannot write{where}: {error.strerror}. Finished parts are saved. Make room, or choose another "
                "--out, and give the same command again."
            )
        return 2, text
    if isinstance(error, MemoryError):
        return 1, f"out of memory ({text or 'no more could be had'}). Use fewer --workers, or a smaller plan."
    return 1, f"internal error, {type(error).__name__}: {text}. Please report it with what --debug shows."


def _union(group: str) -> Any:
    """The commands of a group as one type, for completion."""
    return Union[  # noqa: UP007
        tuple(
            Annotated[
                Any,
                tyro.conf.subcommand(name=name, constructor=with_options(load_command(f"{group} {name}"))),
            ]
            for name in command_list(group)
        )
    ]
