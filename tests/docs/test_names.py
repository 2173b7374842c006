"""Names in docstrings, comments and pages exist: modules, classes, their members, files and folders.

Sources are parsed, not imported: importing all of them would bind a process to one OpenGL.
"""

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

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
_PATH = re.compile(
    r"`((?!robosim/TargetSearch)(?:robosim|slam|wireless|tests|docs|assets|scripts)/[\w./-]+)`"
)


def written(path: Path) -> str:
    """Docstrings and comments of a source file, or the text of a page without its blocks of code."""
    text = path.read_text("utf-8")
    if path.suffix == ".md":
        return re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    strings = [node.value for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Constant)]
    comments = re.findall(r"#.*", text)
    return "\n".join([string for string in strings if isinstance(string, str)] + comments)


def names_in(body: list[ast.stmt]) -> set[str]:
    """Names that statements define or import, also those under conditions."""
    names: set[str] = set()
    for node in body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.If | ast.With | ast.Try):
            names |= names_in(node.body)
        else:
            names |= {item.id for item in ast.walk(node) if isinstance(item, ast.Name)}
    return names


@cache
def modules() -> dict[str, set[str]]:
    """Names of each module by its dotted name; public names of packages are in their stubs."""
    known: dict[str, set[str]] = defaultdict(set)
    for package in PACKAGES:
        for path in [*(ROOT / package).rglob("*.py"), *(ROOT / package).rglob("*.pyi")]:
            words = list(path.relative_to(ROOT).with_suffix("").parts)
            module = ".".join(words[:-1] if words[-1] == "__init__" else words)
            known[module] |= names_in(ast.parse(path.read_text("utf-8")).body)
            known[module.rpartition(".")[0]].add(module.rpartition(".")[2])
    return known


@cache
def classes() -> dict[str, set[str]]:
    """Members of all classes by the class's name, with those of the classes that they derive from."""
    members, bases = defaultdict(set), defaultdict(set)
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ClassDef):
                own = names_in(node.body)
                own |= {
                    item.attr
                    for item in ast.walk(node)
                    if isinstance(item, ast.Attribute) and isinstance(item.ctx, ast.Store)
                }
                members[node.name] |= own
                bases[node.name] |= {base.id for base in node.bases if isinstance(base, ast.Name)}
    for _ in range(3):
        for name in list(members):
            members[name] |= {member for base in bases[name] for member in members.get(base, ())}
    return members


def resolves(dotted: str) -> bool:
    """Whether a dotted name is a module, a name in one, or a member of a class there."""
    words = dotted.split(".")
    for count in range(len(words), 0, -1):
        if (module := ".".join(words[:count])) in modules():
            break
    else:
        return False
    names = words[count:]
    if not names:
        return True
    return names[0] in modules()[module] and (len(names) == 1 or names[1] in classes().get(names[0], ()))


def unknown_names(text: str) -> list[str]:
    """Names in a text that do not exist."""
    missing = [name for name in _DOTTED.findall(text) if not resolves(name)]
    missing += [
        f"{owner}.{member}"
        for owner, member in _MEMBER.findall(text)
        if owner in classes() and member not in classes()[owner]
    ]
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
