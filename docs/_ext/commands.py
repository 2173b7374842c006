"""Pages of the command line, made from each command's own --help when the site is built."""

import contextlib
import io
import os
import re
from pathlib import Path

from made_pages import write_pages
from sphinx.application import Sphinx

from robosim.commands.table import COMMANDS, GROUPS

#: So wide that nothing is wrapped.
_WIDTH = "4000"


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / "reference" / "commands"
    folder.mkdir(parents=True, exist_ok=True)
    wanted = {}
    for command in dict.fromkeys(name.split()[0] for name in COMMANDS):
        inner = [name.split() for name in COMMANDS if name.split()[0] == command]
        if command in GROUPS:
            body = f"# `robosim {command}`\n\n{_prose(GROUPS[command])}\n\n"
            wanted[f"{command}.md"] = body + "".join(_page(words, 2) for words in inner)
        else:
            wanted[f"{command}.md"] = _page(inner[0], 1)
    write_pages(folder, wanted, ".md")


def _help(words: list[str]) -> str:
    """What a command says when asked for help."""
    from robosim.cli import main

    os.environ["COLUMNS"], before = _WIDTH, os.environ.get("COLUMNS")
    try:
        # Boxes are drawn where the terminal knows their characters.
        out = io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True)
        with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
            main([*words, "--help"])
    finally:
        os.environ.pop("COLUMNS")
        if before is not None:
            os.environ["COLUMNS"] = before
    return re.sub(r"\x1b\[[0-9;]*m", "", out.buffer.getvalue().decode())


def _description(text: str) -> str:
    """What stands between usage and the first box; the example in a block of its own."""
    paragraphs = text.split("╭")[0].split("\n\n")[1:]
    out = []
    for paragraph in paragraphs:
        line = " ".join(paragraph.split())
        if line.startswith("Example: "):
            out.append(f"```console\n$ {line.removeprefix('Example: ')}\n```")
        elif line:
            out.append(_prose(line))
    return "\n\n".join(out)


def _page(words: list[str], level: int) -> str:
    text = _help(words)
    name = " ".join(["robosim", *words])
    parts = [f"({name.replace(' ', '-')})=", f"{'#' * level} `{name}`", _description(text)]
    for title, options in _boxes(text):
        parts.append(
            f"**{title[0].upper()}{title[1:]}**" if level > 1 else f"{'#' * (level + 1)} {title.capitalize()}"
        )
        parts.extend(f"`{option}`\n: {_prose(what) or '–'}" for option, what in options)
    return "\n\n".join(parts) + "\n\n"


def _boxes(text: str) -> list[tuple[str, list[tuple[str, str]]]]:
    """Titles of the boxes in a help text, and the options in each with what they mean."""
    boxes: list[tuple[str, list[tuple[str, str]]]] = []
    options: list[tuple[str, str]] = []
    for line in text.splitlines():
        if line.startswith("╭"):
            options = []
            boxes.append((line.strip("╭╮─ "), options))
        elif line.startswith("│"):
            content = line[1:-1].removeprefix(" ").rstrip()
            if content.startswith("-") or (content and not content[0].isspace() and "  " in content):
                option, _, what = content.partition("  ")
                options.append((option.strip(), what.strip()))
            elif content.startswith(" ") and options:
                option, what = options[-1]
                options[-1] = option, f"{what} {content.strip()}"
    for _, found in boxes:
        found[:] = [entry for entry in found if not entry[0].startswith("-h")]
    return [(title, found) for title, found in boxes if found]


def _prose(text: str) -> str:
    """Text of a terminal as Markdown: nothing in it is markup but names in backticks."""
    parts = re.split(r"(`[^`]*`)", text)
    parts[::2] = [re.sub(r"([\\*_<>\[\]$|#])", r"\\\1", part) for part in parts[::2]]
    return "".join(parts)
