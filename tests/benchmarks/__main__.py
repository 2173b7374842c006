"""Benchmarks: what is measured, how fast and how accurate. Each writes its results as JSON, and prints its tables.

python -m tests.benchmarks NAME --help
python -m tests.benchmarks readme        the README's table of numbers, made again from docs/results/data
"""

import ast
import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import tyro

#: Benchmarks; each is a module with a function `main`.
BENCHMARKS = (
    "tracing", "estimation", "labels", "edges", "render", "physics", "episode", "search", "belief",
    "exploration", "mapping", "robot_logs", "localization", "warsaw_flat", "warsaw_powers", "warsaw_places",
    "measured_hall", "endurance", "environment", "live", "plans", "start", "tracer_peer", "map_errors",
    "mapex", "senses", "people", "blockage", "robots", "learning", "readme", "clusters",
    "large_buildings", "uwb_apartment", "outlines", "team_logs", "team_frame", "indoor_office", "full_wave",
    "compare", "team_coverage", "team_search", "silence", "link_states", "leaks", "ranging",
)  # fmt: skip
PROGRAM = "python -m tests.benchmarks"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark that the first argument names; the exit status is 1, and a line says why, if it cannot."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if not words or words[0] not in BENCHMARKS:
        tyro.extras.subcommand_cli_from_dict(
            {name: _listed(name) for name in BENCHMARKS}, prog=PROGRAM, description=__doc__, args=words
        )
        return
    command = importlib.import_module(f"tests.benchmarks.{words[0]}").main
    try:
        tyro.cli(command, prog=f"{PROGRAM} {words[0]}", args=words[1:])
    except ValueError as error:
        sys.exit(f"{PROGRAM} {words[0]}: {' '.join(str(error).split())}")


def _listed(name: str) -> Callable[[], None]:
    """A function with the first sentence of a benchmark's help, which is read without importing its module."""
    tree = ast.parse((Path(__file__).parent / f"{name}.py").read_text(encoding="utf-8"))
    found = next(node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "main")

    def command() -> None: ...

    command.__doc__ = (ast.get_docstring(found) or "").split("\n\n")[0]
    return command


if __name__ == "__main__":
    main()
