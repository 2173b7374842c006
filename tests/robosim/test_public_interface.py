"""The public interface equals the recorded one: names with signatures, options with defaults, columns of files.

    python -m tests.robosim.test_public_interface

rewrites the record. Annotations are left out, since other versions of Python and libraries write them in other forms.
"""

import difflib
import inspect
import re
import sys
from collections.abc import Iterator
from enum import EnumType
from importlib import import_module
from pathlib import Path
from typing import Any

from robosim.commands.command_table import COMMANDS
from tests.docs.test_formats import documented

ROOT = Path(__file__).resolve().parents[2]
RECORD = ROOT / "docs" / "reference" / "public_interface.txt"
PACKAGES = ("robosim", "slam", "wireless")


def names() -> Iterator[str]:
    """Public names of the packages, with parameters and defaults; classes with their public members."""
    for package in PACKAGES:
        module = import_module(package)
        for name in module.__all__:
            value = getattr(module, name)
            yield f"{package}.{name}{signature(value)}"
            for member in sorted(members(value)) if inspect.isclass(value) else ():
                yield f"{package}.{name}.{member}{signature(inspect.getattr_static(value, member, None))}"


def members(owner: type) -> set[str]:
    """Public attributes and fields of a class and of those classes of the project that it derives from."""
    bases = [base for base in owner.__mro__ if base.__module__.split(".")[0] in PACKAGES]
    return {
        name
        for base in bases
        for name in [*vars(base), *inspect.get_annotations(base)]
        if not name.startswith("_")
    }


def signature(value: Any) -> str:
    """Parameters with their defaults, or nothing of a value that is not called."""
    value = getattr(value, "__func__", value)
    if not callable(value) or isinstance(value, EnumType):
        return ""
    try:
        parameters = inspect.signature(value).parameters.values()
    except ValueError:
        return "(...)"
    plain = [
        parameter.replace(annotation=inspect.Parameter.empty, default=_Default(parameter.default))
        if parameter.default is not inspect.Parameter.empty
        else parameter.replace(annotation=inspect.Parameter.empty)
        for parameter in parameters
    ]
    return str(inspect.Signature(plain))


class _Default:
    """A default that is written as its value if that is short, otherwise as its type."""

    def __init__(self, value: Any) -> None:
        plain = isinstance(value, bool | int | float | str | tuple | None.__class__)
        name = "<factory>" if repr(value) == "<factory>" else type(value).__name__
        self._text = repr(value) if plain and " object at " not in repr(value) else name

    def __repr__(self) -> str:
        return self._text


def options() -> Iterator[str]:
    """Arguments and options of all commands, as the pages of the command line have them."""
    sys.path.insert(0, str(ROOT / "docs" / "_ext"))
    try:
        page = import_module("commands").page
    finally:
        sys.path.pop(0)
    for name in COMMANDS:
        for term, text in re.findall(r"^`([^`\n]+)`\n: (.*)$", page(name, 1), re.MULTILINE):
            facts = re.findall(r"(?:Default: `.*?`|(?:On|Off) by default|Required)\.", text)
            yield " ".join([f"robosim {name} {term}", *facts])


def columns() -> Iterator[str]:
    """Columns, arrays and keys of files with their types, as the pages on files have them."""
    pages = "".join(page.read_text("utf-8") for page in sorted((ROOT / "docs" / "formats").glob("*.md")))
    for table in dict.fromkeys(re.findall(r"<!-- columns: (.+?) -->", pages)):
        for name, cells in documented(table).items():
            yield f"{table}: {name} {' '.join(cells[:1])}".rstrip()


def interface() -> list[str]:
    """All lines."""
    return [*names(), *options(), *columns()]


def test_the_public_interface_is_as_recorded() -> None:
    """Whatever others may depend on changes only on purpose."""
    changes = list(
        difflib.unified_diff(RECORD.read_text("utf-8").splitlines(), interface(), lineterm="", n=0)
    )
    assert not changes, (
        "The public interface differs from its record. Each change needs its line in CHANGELOG.md; then run "
        "'python -m tests.robosim.test_public_interface', which rewrites the record.\n"
        + "\n".join(changes[2:])
    )


def test_a_changed_default_is_a_change() -> None:
    """The check itself: names of parameters, their kind, and defaults are in a line; private members are not."""

    class Example:
        def __init__(self, size: float = 1.5, *, name: str | None = None) -> None: ...

        def run(self, *times: int) -> None: ...

    assert signature(Example) == "(size=1.5, *, name=None)"
    assert signature(Example.run) == "(self, *times)"


if __name__ == "__main__":
    RECORD.write_text("\n".join(interface()) + "\n", "utf-8")
