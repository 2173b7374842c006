"""Runs the blocks of a page in order, in a separate process: Python, and optionally commands.

    python tests/docs/run_page.py PAGE...

With the Python of an environment in which a wheel is installed, this runs commands and Python of pages from the wheel
alone, each page in an empty folder. It prints a line for each page and each failure, and fails if there is one. Files
of a reader and extras may be missing if the message says so. Commands that serve or train print their help.

A block is also written to a file if the line before it is the file's name, as in "`mine.py`:", or if it begins with the
name in a comment.
"""

import contextlib
import doctest
import io
import re
import shlex
import subprocess
import sys
import tempfile
from collections import Counter
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
#: Commands that serve until they are stopped, or train for long.
ENDLESS = ("live", "train", "calibrate")
#: What a command or a block of Python says that lacks an input; it is counted, and no failure.
LACKS = {
    "a file": re.compile(
        r"does not exist|No such file|no such file|is missing|not found|holds no|has no data set"
    ),
    "an extra": re.compile(
        r"pip install '?robosim-wireless\[|pip install -e '\.\[|No module named '(?!robosim|slam|wireless)"
    ),
}
_IN_TABLE = re.compile(r"^\| `(robosim [^`]+)` \|", re.MULTILINE)
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
        if language == "python":
            failures += run_python(body, names, name)
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
        shorten(words)
    out = io.StringIO()
    console.width, console.file = 200, out
    with contextlib.redirect_stdout(out):
        main(words)
    return out.getvalue()


def shorten(words: list[str]) -> None:
    """Replace and add options of a command, so that it takes seconds."""
    added = ADDED.get(words[0], {})
    for option, value in (SHORT | added).items():
        if option in words:
            words[words.index(option) + 1] = value
        elif option in added and not (option == "--grid" and {"--rx", "--along"}.intersection(words)):
            words += [option, value] if value else [option]


def _lines(text: str) -> list[str]:
    """Lines without progress bars and installation hints, with a placeholder for times."""
    lines = [line for line in text.splitlines() if line.strip() and not re.search("[━╸╺]", line)]
    return [_TIME.sub("#", re.sub(r"pip install \w+; ", "", " ".join(line.split()))) for line in lines]


def run_installed(page: Path) -> int:
    """Run commands, those of tables too, and Python of a page; print what fails, and return the number of failures.

    A block of Python that needs names of one that lacks an input lacks it too.
    """
    text, lacking = page.read_text("utf-8"), ""
    names: dict[str, object] = {"__name__": "page"}
    counts: Counter[str] = Counter()
    write_named_blocks(page, Path())
    plain = re.sub(r"^```$(?=\n(?:make|robosim) )", "```console", text, flags=re.MULTILINE)
    for _, language, _, body in _BLOCK.findall(plain):
        if language == "console":
            for line in commands_in(body):
                counts[_outcome(line, *_command(line))] += 1
        elif language == "python":
            out = io.StringIO()
            try:
                with contextlib.redirect_stdout(out):
                    status = run_python(body, names, page.name)
                output = out.getvalue()
            except Exception as error:
                status, output = 1, f"{type(error).__name__}: {error}"
            output = lacking if lacking and re.search("(Name|Attribute)Error", output) else output
            outcome = _outcome(body.split("\n")[0], status, output)
            lacking = output if outcome.startswith("lack") else lacking
            counts[outcome] += 1
    for line in _IN_TABLE.findall(text):
        counts[_outcome(line, *_command(line))] += 1
    print(
        f"{page.name}: {', '.join(f'{number} {what}' for what, number in sorted(counts.items()))}", flush=True
    )
    return counts["failed"]


def run_python(body: str, names: dict[str, object], name: str) -> int:
    """Run a block; return the number of prompts that print something else than the block shows."""
    if ">>>" not in body:
        exec(compile(body, name, "exec"), names)
        return 0
    test = doctest.DocTestParser().get_doctest(body, names, name, name, 0)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    runner.run(test, clear_globs=False)
    names.update(test.globs)
    return runner.failures


def _command(line: str) -> tuple[int, str]:
    """Status and output of a shortened command in a process of its own."""
    words = shlex.split(line)[1:]
    words = [*words, "--help"] if words[0] in ENDLESS else words
    shorten(words)
    done = subprocess.run(
        [sys.executable, "-m", "robosim", *words], capture_output=True, text=True, check=False, timeout=600
    )
    return done.returncode, done.stdout + done.stderr


def _outcome(line: str, status: int, output: str) -> str:
    """Whether a command ran, lacks an input, or failed, of which the end of its output is printed."""
    if status == 0:
        return "ran"
    for what, pattern in LACKS.items():
        if pattern.search(output) and "Traceback" not in output:
            print(f"lacks {what}: {line}\n    {' '.join(output.split())[:200]}", flush=True)
            return f"lack {what}"
    print(f"FAILED {line}\n{output[-600:]}", flush=True)
    return "failed"


if __name__ == "__main__":
    failures = 0
    if len(sys.argv) == 3 and sys.argv[1] == "--here":
        sys.exit(run_installed(Path(sys.argv[2])))
    for page in sys.argv[1:]:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, __file__, "--here", str(Path(page).resolve())]
            failures += subprocess.run(command, cwd=folder, check=False).returncode
    sys.exit(failures > 0)
