"""Names in docstrings, comments and pages exist: modules, classes, their members, files and folders."""

import ast
import importlib
import inspect
import pkgutil
import re
from collections import defaultdict
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("robosim", "slam", "wireless")
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
#: Pages of the present state; changelog and decisions name what was.
PAGES = sorted(
    path
    for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
    if not {"_build", "decisions", "api", "commands", "examples"} & set(path.parts)
    and path.name != "changelog.md"
)
_DOTTED = re.compile(r"`((?:robosim|slam|wireless)(?:\.\w+)+)`")
_MEMBER = re.compile(r"`([A-Z]\w+)\.(\w+)(?:\(\))?`")
_PATH = re.compile(r"`((?:robosim|slam|wireless|tests|docs|assets|scripts)/[\w./-]+)`")


def written(path: Path) -> str:
    """Docstrings and comments of a source file, or the text of a page without its blocks of code."""
    text = path.read_text("utf-8")
    if path.suffix == ".md":
        return re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    strings = [node.value for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Constant)]
    comments = re.findall(r"#.*", text)
    return "\n".join([string for string in strings if isinstance(string, str)] + comments)


@cache
def classes() -> dict[str, list[type]]:
    """All classes of the packages by name."""
    known: dict[str, list[type]] = defaultdict(list)
    for package in PACKAGES:
        for module in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
            if not module.name.endswith("__main__"):
                for name, item in vars(importlib.import_module(module.name)).items():
                    if inspect.isclass(item):
                        known[name].append(item)
    return known


def resolves(dotted: str) -> bool:
    """Whether a dotted name is a module, or a member of one."""
    words = dotted.split(".")
    for count in range(len(words), 0, -1):
        try:
            found: object = importlib.import_module(".".join(words[:count]))
        except ModuleNotFoundError:
            continue
        return all_members(found, words[count:])
    return False


def all_members(item: object, names: list[str]) -> bool:
    """Whether names lead from an object to a member of a member."""
    for name in names:
        if not has_member(item, name):
            return False
        item = getattr(item, name, None)
    return True


def has_member(item: object, name: str) -> bool:
    """Whether a class or module has an attribute, an annotated field, or an attribute that its code sets."""
    if hasattr(item, name) or name in getattr(item, "__annotations__", {}):
        return True
    if isinstance(item, ModuleType):
        return False
    try:
        return f"self.{name}" in inspect.getsource(item)  # type: ignore[arg-type]
    except (OSError, TypeError):
        return False


def unknown_names(text: str) -> list[str]:
    """Names in a text that do not exist."""
    missing = [name for name in _DOTTED.findall(text) if not resolves(name)]
    for owner, member in _MEMBER.findall(text):
        known = classes().get(owner, [])
        if known and not any(has_member(item, member) for item in known):
            missing.append(f"{owner}.{member}")
    paths = [name for name in _PATH.findall(text) if not name.startswith("docs/_build")]
    return missing + [name for name in paths if not (ROOT / name).exists()]


@pytest.mark.parametrize("path", [*SOURCES, *PAGES], ids=lambda path: path.relative_to(ROOT).as_posix())
def test_names_exist(path: Path) -> None:
    """Each dotted name, member of a class and path in backticks."""
    assert not unknown_names(written(path))


def test_unknown_names_are_found() -> None:
    """The check itself: a module, a member and a file that do not exist, next to those that do."""
    text = "`robosim.agent.Agent`, `Agent.act`, `robosim/agent.py`, `robosim.nothing`, `Agent.dream`, `docs/no.md`"
    assert unknown_names(text) == ["robosim.nothing", "Agent.dream", "docs/no.md"]
