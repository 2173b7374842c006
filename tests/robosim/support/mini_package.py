"""A package of a few files with compiled functions, as large as it takes to see how they are compiled and cached."""

import importlib
import logging
import os
import subprocess
import sys
import textwrap

#: A package of two files, of which one calls the other's functions.
SOURCES = {
    "__init__.py": "",
    "units.py": "SCALE = 3.0\n",
    "parts/__init__.py": "",
    "parts/inner.py": """
        from typing import NamedTuple

        import numpy as np

        from mini import units
        from mini.compiled import compiled


        class Pair(NamedTuple):
            first: float
            second: float


        TABLE = np.array([1.0, 2.0, 4.0])
        STEP = 10.0


        @compiled
        def inner(x, factor=2.0):
            \"\"\"Some of everything that machine code is made of.\"\"\"
            pair = Pair(x, 100.0)
            return factor * pair.first + TABLE[1] * STEP + units.SCALE
    """,
    "loops.py": """
        from mini.compiled import compiled
        from mini.parts.inner import inner


        @compiled
        def outer(x):
            return inner(x) + 1000.0


        @compiled
        def first_of(pair):
            return pair.first
    """,
}


def forget():
    """As a new process: nothing of the package is imported."""
    logging.getLogger("robosim.compiled_loops").disabled = False
    for name in [name for name in sys.modules if name.partition(".")[0] == "mini"]:
        del sys.modules[name]
    importlib.invalidate_caches()


def run(name="outer", *arguments):
    """What a function of the package returns in a new process, and whether it was compiled there."""
    forget()
    function = getattr(importlib.import_module("mini.loops"), name)
    value = function(*(arguments or (1.0,)))
    return value, sum(function.dispatcher.stats.cache_misses.values()) > 0


def edit(file, old, new):
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))


def start(mini, program):
    """A new process in which the package can be imported."""
    environment = {**os.environ, "PYTHONPATH": str(mini.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(program)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def output_of(process):
    """Output of a process that ends without error."""
    out, error = process.communicate(timeout=600)
    assert process.returncode == 0, f"status {process.returncode}\n{error}"
    return out
