"""Tests that `make quick` leaves out, listed in `slow.txt`: folders, modules, and functions of half a second or more.

`pytest -m "not slow" --durations=0 | python tests/slow_tests.py` adds functions that became slow to the list.
"""

import re
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
LIST = TESTS / "slow.txt"
#: Setup or call of a slow test [s].
SLOW_S = 0.5


def read_slow() -> list[str]:
    """Return folders, modules and `module::function`, relative to the folder of tests."""
    return LIST.read_text().split()


def mark_slow(items: Iterable[pytest.Item]) -> None:
    """Mark the tests of slow folders and modules, and slow functions."""
    slow = set(read_slow())
    for item in items:
        if item.path.is_relative_to(TESTS):
            module = item.path.relative_to(TESTS)
            function = f"{module.as_posix()}::{item.name.partition('[')[0]}"
            if not slow.isdisjoint({function, module.as_posix(), *(p.as_posix() for p in module.parents)}):
                item.add_marker(pytest.mark.slow)


def add_slow(durations: str) -> None:
    """Add functions to the list from the table of durations that pytest prints."""
    rows = re.findall(r"^([\d.]+)s (?:call|setup) +tests/([^\s\[]+)", durations, re.MULTILINE)
    slow = {function for seconds, function in rows if float(seconds) >= SLOW_S}
    LIST.write_text("".join(f"{name}\n" for name in sorted({*read_slow(), *slow})))


if __name__ == "__main__":
    add_slow(sys.stdin.read())
