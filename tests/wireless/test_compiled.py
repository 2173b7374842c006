"""Compiled functions on disk never outlive the sources they were made from."""

import os

from wireless.compiled import _forget_outdated


def test_a_change_in_any_source_drops_what_was_compiled(tmp_path, caplog):
    """Numba would go on calling the old version of a function that another file's function has swallowed.

    That compiling will take its time is told when it will, and not again.
    """
    source, kept = tmp_path / "fields.py", tmp_path / "__pycache__" / "links.trace-1.py311.nbi"
    source.write_text("a = 1")
    kept.parent.mkdir()
    _forget_outdated(tmp_path)
    kept.write_text("")
    _forget_outdated(tmp_path)
    assert kept.exists()
    assert caplog.text.count("compiles its inner loops") == 1
    os.utime(source, ns=(1, 1))
    _forget_outdated(tmp_path)
    assert not kept.exists()
    assert caplog.text.count("compiles its inner loops") == 2
