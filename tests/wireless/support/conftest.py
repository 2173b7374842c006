"""The package that tests of compiled functions compile."""

import inspect
import shutil
import sys
import textwrap

import pytest

import wireless.support.compiled
import wireless.support.compiled_files
import wireless.support.linked
from tests.wireless.support.mini_package import SOURCES, forget


@pytest.fixture
def mini(tmp_path, monkeypatch):
    """Folder of the package, with the real machinery in it; nothing else in the user's caches."""
    folder = tmp_path / "mini"
    for name, text in SOURCES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(textwrap.dedent(text))
    for module in (wireless.support.compiled, wireless.support.compiled_files, wireless.support.linked):
        shutil.copy(inspect.getfile(module), folder)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    # Python, too, takes two edits within a second for one.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield folder
    forget()
