"""Benchmarks: what is measured, how fast and how accurate. `python -m tests.benchmarks --help` lists them."""

import ast
import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import tyro

#: Benchmarks by name, and the module and function of each.
BENCHMARKS = {
    "render": "commands_whole:render",
    "physics": "commands_whole:physics",
    "navigation": "commands_maps:navigation",
    "exploration": "commands_maps:exploration",
    "episode": "commands_whole:episode",
    "slam": "commands_maps:slam",
    "belief": "commands_whole:belief",
    "endurance": "commands_maps:endurance",
    "wireless": "commands_radio:wireless",
    "storeys": "commands_radio:storeys",
    "estimation": "commands_radio:estimation",
    "labels": "commands_radio:labels",
    "edges": "commands_radio:edges",
    "scattering": "commands_radio:scattering",
    "positioning": "commands_radio:positioning",
    "live": "commands_live:live",
    "environment": "commands_whole:environment",
    "plans": "commands_figures:plans",
    "search": "commands_figures:search",
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark that the first argument names; the exit status is 2 if an argument is wrong."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    prog = "python -m tests.benchmarks"
    if not words or words[0] not in BENCHMARKS:
        tyro.extras.subcommand_cli_from_dict(
            {name: _listed(name) for name in BENCHMARKS}, prog=prog, description=__doc__, args=words
        )
        return
    module, function = BENCHMARKS[words[0]].split(":")
    benchmark = getattr(importlib.import_module(f"tests.benchmarks.{module}"), function)
    try:
        tyro.cli(benchmark, prog=f"{prog} {words[0]}", args=words[1:])
    except ValueError as error:
        sys.exit(f"{prog}: {' '.join(str(error).split())}")


def _listed(name: str) -> Callable[[], Any]:
    """A function with the first sentence of a benchmark's help, which is read without importing its module."""
    module, function = BENCHMARKS[name].split(":")
    tree = ast.parse((Path(__file__).parent / f"{module}.py").read_text(encoding="utf-8"))
    found = next(node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == function)

    def command() -> None: ...

    command.__doc__ = (ast.get_docstring(found) or "").split("\n\n")[0]
    return command


if __name__ == "__main__":
    main()
