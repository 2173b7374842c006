"""Runs the Python on a page: blocks named python, one after the other, in a process of its own."""

import doctest
import re
from pathlib import Path

_FENCE = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def run_page(page: Path) -> int:
    """Run all blocks; the number of those that print something else than the page says."""
    names: dict[str, object] = {"__name__": "page"}
    failures = 0
    for i, block in enumerate(_FENCE.findall(page.read_text("utf-8"))):
        name = f"{page.name}, block {i}"
        if ">>>" not in block:
            exec(compile(block, name, "exec"), names)
            continue
        test = doctest.DocTestParser().get_doctest(block, names, name, str(page), 0)
        runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
        runner.run(test, clear_globs=False)
        failures += runner.failures
        names = test.globs
    return failures
