"""The package that tests of compiled functions compile."""

import inspect
import shutil
import sys
import textwrap

import pytest

import robosim.support.compiled
from tests.robosim.support.mini_package import SOURCES, forget


@pytest.fixture
def mini(tmp_path, monkeypatch):
    """Folder of the package, with the real `compiled.py`; the user's cache is empty."""
    folder = tmp_path / "mini"
    for name, text in SOURCES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(textwrap.dedent(text))
    shutil.copy(inspect.getfile(robosim.support.compiled), folder)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    # Python does not detect a second edit within a second.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield folder
    forget()
