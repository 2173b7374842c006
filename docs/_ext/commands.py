"""Pages of the command line, made from each command's own parser when the site is built."""

import argparse
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import tyro
from made_pages import write_pages

from robosim.commands.command_table import COMMANDS, GROUPS, load_command, with_options
from robosim.commands.option_help import option_registry

if TYPE_CHECKING:
    from sphinx.application import Sphinx

#: What a parser appends to the help of an option.
_ENDING = re.compile(r" *\((required|repeatable|default: ?(.*?))?(?:; )?(?:range: ([^()]*))?\)$")
#: Choices as a parser writes them, with what else an option takes: {a,b}|FILE.
_CHOICES = re.compile(r"\{([^}]*)\}(\|.*)?")
#: What every page of a command ends with.
_EVERYWHERE = (
    "Every command also takes `--json`, `--quiet`, `--debug` and `--version`: {doc}`/reference/cli`."
)


def setup(app: "Sphinx") -> dict[str, bool]:
    """Connect."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write(app: "Sphinx") -> None:
    folder = Path(app.srcdir) / "reference" / "commands"
    folder.mkdir(parents=True, exist_ok=True)
    wanted = {}
    for command in dict.fromkeys(name.split()[0] for name in COMMANDS):
        inner = [name for name in COMMANDS if name.split()[0] == command]
        if command in GROUPS:
            title = f"# `robosim {command}`\n\n{_prose(GROUPS[command])}.\n\n"
            body = title + "".join(page(name, 2) for name in inner)
        else:
            body = page(inner[0], 1)
        wanted[f"{command}.md"] = f"{body}{_EVERYWHERE}\n"
    write_pages(folder, wanted, ".md")


def page(name: str, level: int) -> str:
    """What a command does, its arguments and its options as Markdown, from a heading of a level on."""
    parser = parser_of(name)
    parts = [
        f"({parser.prog.replace(' ', '-')})=",
        f"{'#' * level} `{parser.prog}`",
        _description(parser.description or ""),
    ]
    for group in parser._action_groups:
        if group.title == "common options":
            continue
        entries = [_entry(action) for action in group._group_actions if action.dest != "help"]
        if entries:
            title = (group.title or "").removeprefix("positional ").capitalize()
            parts += [f"**{title}**" if level > 1 else f"{'#' * (level + 1)} {title}"]
            parts += [_prose(group.description or ""), *entries]
    return "\n\n".join(part for part in parts if part) + "\n\n"


def parser_of(name: str) -> argparse.ArgumentParser:
    """The parser of a command."""
    with warnings.catch_warnings():
        # The only description of a parser that tyro offers.
        warnings.filterwarnings("ignore", "get_parser", DeprecationWarning)
        return tyro.extras.get_parser(
            with_options(load_command(name)), prog=f"robosim {name}", registry=option_registry(brief=False)
        )


def _description(text: str) -> str:
    """Paragraphs; the example in a block of its own."""
    out = []
    for paragraph in text.split("\n\n"):
        line = " ".join(paragraph.split())
        if line.startswith("Example: "):
            out.append(f"```console\n$ {line.removeprefix('Example: ')}\n```")
        elif line:
            out.append(_prose(line))
    return "\n\n".join(out)


def _entry(action: argparse.Action) -> str:
    """An entry of a definition list: the option with its type; its meaning, its choices and its default."""
    text = " ".join((action.help or "").split())
    ending = _ENDING.search(text)
    text = _ENDING.sub("", text)
    value, several = _value(action)
    names: list[str] = []
    if choices := _CHOICES.fullmatch(value):
        names = [name for name in re.split("[,|]", choices[1] + (choices[2] or "")) if name != "None"]
        value = ""
    name = ", ".join(action.option_strings) or action.dest.upper()
    term = " ".join(filter(None, [name, value if action.option_strings else "", several]))
    sentences = [_prose(text)]
    if names:
        sentences.append(f"One of {', '.join(f'`{name}`' for name in names)}.")
    if type(action).__name__ == "BooleanOptionalAction":  # tyro has one of its own
        sentences.append("On by default." if action.default else "Off by default.")
    elif ending and ending[1] == "required":
        sentences.append("Required.")
    elif ending and ending[1] == "repeatable" and "several times" not in text:
        sentences.append("Can be given several times.")
    elif ending and ending[2] not in (None, "None", ""):
        sentences.append(f"Default: `{ending[2]}`.")
    if ending and ending[3]:
        sentences.append(f"Range: {ending[3]}.")
    return f"`{term}`\n: {' '.join(filter(None, sentences)) or '–'}"


def _value(action: argparse.Action) -> tuple[str, str]:
    """The type of an option's value, and dots if it takes several."""
    # Of [[STR [STR ...]]] one STR is left.
    value = re.sub(r"^\[+(\{[^}]*\}[^\[\] ]*|[^\[\] ]+)( \[.*|\]*)$", r"\1", str(action.metavar or ""))
    return value.removeprefix("{None}|"), "..." if action.nargs == "*" else ""


def _prose(text: str) -> str:
    """Text of a terminal as Markdown: nothing in it is markup but names in backticks."""
    parts = re.split(r"(`[^`]*`)", text)
    parts[::2] = [re.sub(r"([\\*_<>\[\]$|#])", r"\\\1", part) for part in parts[::2]]
    return "".join(parts)
