"""One page a module for the reference of the Python interface, and a list of them by room."""

import ast
from pathlib import Path

from made_pages import write_pages
from sphinx.application import Sphinx

#: Rooms that are not for use from Python.
_INNER = {"support", "commands", "rendering"}
_INNER_MODULES = {"robosim.cli", "robosim.__main__", "robosim.doctor"}
#: What each package is for, in the order in which they are listed.
_PACKAGES = {
    "robosim": "Floor plans and buildings, the robot, its senses, episodes, data sets, evaluation.",
    "wireless": "Radio: materials, traced paths, arrays, sounding, estimation, link states.",
    "slam": "Mapping and moving: map, pose, planning, control, exploration.",
}


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write(app: Sphinx) -> None:
    source = Path(app.srcdir)
    folder = source / "reference" / "api"
    folder.mkdir(parents=True, exist_ok=True)
    wanted: dict[str, str] = {}
    for package in _PACKAGES:
        root = source.parent / package
        rooms: dict[str, list[str]] = {}
        for path in sorted(root.rglob("*.py")):
            name = ".".join(path.relative_to(source.parent).with_suffix("").parts)
            parts = name.split(".")
            if (
                path.name == "__init__.py"
                or _INNER & set(parts)
                or name in _INNER_MODULES
                or parts[-1][0] == "_"
            ):
                continue
            rooms.setdefault(".".join(parts[:-1]), []).append(name)
        for module in [m for modules in rooms.values() for m in modules]:
            wanted[f"{module}.rst"] = _module_page(source.parent, module)
        wanted[f"{package}.rst"] = _package_page(source.parent, package, rooms)
    write_pages(folder, wanted, ".rst")


def _module_page(root: Path, module: str) -> str:
    title = f"``{module}``"
    members = ", ".join(_members(root.joinpath(*module.split(".")).with_suffix(".py")))
    listed = f"   :members: {members}" if members else ""
    return f":orphan:\n\n{title}\n{'=' * len(title)}\n\n.. automodule:: {module}\n{listed}\n"


def _members(path: Path) -> list[str]:
    """Public names of a module itself: functions, classes, and constants that are explained by a `#:` before them."""
    text = path.read_text("utf-8")
    lines, found = text.splitlines(), []
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.append(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign) and lines[node.lineno - 2].startswith("#:"):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found += [
                name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)
            ]
    return [name for name in found if not name.startswith("_")]


def _package_page(root: Path, package: str, rooms: dict[str, list[str]]) -> str:
    title = f"``{package}``"
    out = [title, "=" * len(title), "", _PACKAGES[package], ""]
    exported = _exported(root / package / "__init__.pyi")
    if exported:
        out += [
            f"Names that ``{package}`` itself offers",
            "-" * 60,
            "",
            ".. list-table::",
            "   :widths: 35 65",
            "",
        ]
        for name, module, original in exported:
            what = _first_line(root, module, original)
            out += [f"   * - :py:obj:`{package}.{name} <{module}.{original}>`", f"     - {what}"]
        out += [""]
    for room, modules in rooms.items():
        heading = f"``{room}``" if room != package else f"Modules of ``{package}`` itself"
        out += [heading, "-" * len(heading), "", ".. list-table::", "   :widths: 45 55", ""]
        for module in modules:
            out += [f"   * - :doc:`{module}`", f"     - {_first_line(root, module)}"]
        out += [""]
    return "\n".join(out)


def _exported(path: Path) -> list[tuple[str, str, str]]:
    """Public names of a package, the module of each, and its name there, in the order of the stub."""
    imports = [node for node in ast.parse(path.read_text("utf-8")).body if isinstance(node, ast.ImportFrom)]
    return [(alias.name, node.module or "", alias.name) for node in imports for alias in node.names]


def _first_line(root: Path, module: str, name: str | None = None) -> str:
    """The first line of the docstring of a module, or of something in it."""
    path = root.joinpath(*module.split(".")).with_suffix(".py")
    if not path.exists():
        path = path.with_suffix("") / "__init__.py"
    node: ast.AST | None = ast.parse(path.read_text("utf-8"))
    if name is not None:
        node = next((n for n in node.body if getattr(n, "name", None) == name), None)
    text = (ast.get_docstring(node) if node else None) or ""
    return text.split("\n")[0].replace("`", "``").replace("*", r"\*")
