"""Runs the blocks of a page in order, in a separate process: Python, and optionally commands.

A block is also written to a file if the line before it is the file's name, as in "`mine.py`:", or if it begins with the
name in a comment.
"""

import contextlib
import doctest
import io
import re
import shlex
import sys
from pathlib import Path

#: Shorten a command: values that replace those on the page, and options that are added.
SHORT = {
    "--targets": "1",
    "--generated": "1",
    "--homes": "1",
    "--steps": "2",
    "--plan": "homes:1",
    "--episodes": "1",
}
ADDED: dict[str, dict[str, str]] = {
    "episode": {"--max-steps": "5", "--no-video": ""},
    "evaluate": {"--max-steps": "5", "--workers": "1"},
    "collect-searches": {"--most-steps": "20"},
    "dataset": {"--tx-per-plan": "1", "--grid": "2", "--workers": "1"},
    "collect": {"--workers": "1"},
    "trace": {"--grid": "2", "--no-plots": "", "--workers": "1"},
}
_BLOCK = re.compile(r"(?:`([\w.]+)`:\n\n)?^```(\w+)\n(?:# ([\w.]+)\n)?(.*?)^```$", re.MULTILINE | re.DOTALL)
#: Times and rates, which differ from run to run.
_TIME = re.compile(r"[\d.,:]+(?= (?:s|min|links/s|decisions/s)\b)|\d+:\d\d:\d\d")


def run_page(page: Path, commands: bool = False, short: bool = True) -> int:
    """Run all blocks, and count those that print something else than the page.

    Args:
        page: A page in Markdown.
        commands: Whether to run its commands of robosim too.
        short: Whether to shorten commands; the others must print the next block of text, except for times.
    """
    names: dict[str, object] = {"__name__": "page"}
    failures, printed = 0, ""
    write_named_blocks(page, Path())
    for i, (_, language, _, body) in enumerate(_BLOCK.findall(page.read_text("utf-8"))):
        name = f"{page.name}, block {i}"
        if language == "python" and ">>>" not in body:
            exec(compile(body, name, "exec"), names)
        elif language == "python":
            test = doctest.DocTestParser().get_doctest(body, names, name, str(page), 0)
            runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
            runner.run(test, clear_globs=False)
            failures += runner.failures
            names = test.globs
        elif language == "console" and commands:
            printed = "".join(_run(line, short) for line in commands_in(body))
        elif language == "text" and printed and not short:
            missing = [line for line in _lines(body) if line not in _lines(printed)]
            sys.stdout.writelines(f"{name}: nothing prints '{line}'\n" for line in missing)
            failures += bool(missing)
    return failures


def write_named_blocks(page: Path, folder: Path) -> None:
    """Write the blocks of a page that name a file into a folder."""
    for before, _, inside, body in _BLOCK.findall(page.read_text("utf-8")):
        if before or inside:
            (folder / (before or inside)).write_text(body, "utf-8")


def commands_in(text: str) -> list[str]:
    """Calls of robosim in a block, after the prompt or without one."""
    lines = text.replace("\\\n", " ").splitlines()
    calls = [line.removeprefix("$ ") for line in lines if line.startswith(("$ robosim ", "robosim "))]
    return [line.split("  #")[0] for line in calls]


def _run(line: str, short: bool) -> str:
    """Run a command and return its output."""
    from robosim.cli import main
    from robosim.commands.output import console

    words = shlex.split(line)[1:]
    if short:
        added = ADDED.get(words[0], {})
        for option, value in (SHORT | added).items():
            if option in words:
                words[words.index(option) + 1] = value
            elif option in added:
                words += [option, value] if value else [option]
    out = io.StringIO()
    console.width, console.file = 200, out
    with contextlib.redirect_stdout(out):
        main(words)
    return out.getvalue()


def _lines(text: str) -> list[str]:
    """Lines without progress bars and installation hints, with a placeholder for times."""
    lines = [line for line in text.splitlines() if line.strip() and not re.search("[━╸╺]", line)]
    return [_TIME.sub("#", re.sub(r"pip install \w+; ", "", " ".join(line.split()))) for line in lines]
