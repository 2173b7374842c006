"""Compiled loops: what runs is what the sources say, whatever is cached."""

import importlib
import os
import pickle
import sys
import threading
import time

import pytest

from robosim.support.compiled import MAX_VERSIONS
from tests.robosim.support.mini_package import edit, forget, output_of, run, start


def block_folder(path):
    """Put a file where a folder is needed: then root cannot create it either."""
    path.parent.mkdir(exist_ok=True)
    path.write_text("")


@pytest.fixture(params=["NUMBA_CACHE_DIR", "the user's", "none"])
def cache_folder(request, mini, tmp_path, monkeypatch):
    """Where loops are cached; folders before it are not writable."""
    if request.param != "the user's":
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "named"))
    if request.param == "none":
        block_folder(tmp_path / "user")
        block_folder(tmp_path / "named")
        return None
    return tmp_path / ("named" if request.param == "NUMBA_CACHE_DIR" else "user") / "robosim"


def test_a_changed_loop_in_another_file_is_compiled_again(cache_folder, mini, caplog):
    """Numba alone would use the old version, which is part of the cached caller. One message reports compilation."""
    assert run() == (1025.0, True)
    [message] = caplog.messages
    if cache_folder is None:
        assert "Each run compiles" in message and "Set NUMBA_CACHE_DIR" in message
    else:
        assert "first those of mini.loops" in message and "robosim warm-up" in message
        assert list(cache_folder.glob("mini.loops-*/outer/*/*.nbc"))
    caplog.clear()
    assert run() == (1025.0, cache_folder is None)
    assert len(caplog.messages) == (cache_folder is None)
    edit(mini / "parts" / "inner.py", "return factor", "return -factor")
    assert run() == (1021.0, True)
    edit(mini / "parts" / "inner.py", "return -factor", "return factor")
    assert run() == (1025.0, cache_folder is None)
    assert not list(mini.rglob("*.nb?"))


@pytest.mark.parametrize(
    ("file", "old", "new", "value"),
    [
        ("parts/inner.py", "Pair(x, 100.0)", "Pair(2.0 * x, 100.0)", 1027.0),
        ("parts/inner.py", "factor=2.0", "factor=4.0", 1027.0),
        ("parts/inner.py", "STEP = 10.0", "STEP = 20.0", 1045.0),
        ("parts/inner.py", "[1.0, 2.0, 4.0]", "[1.0, 3.0, 4.0]", 1035.0),
        ("parts/inner.py", "first: float\n    second", "second: float\n    first", 1223.0),
        ("units.py", "SCALE = 3.0", "SCALE = 4.0", 1026.0),
    ],
)
def test_a_change_in_any_imported_module_counts(mini, file, old, new, value):
    """A constant, a default, a table, fields of a record; also through an import of an import."""
    assert run() == (1025.0, True)
    edit(mini / file, old, new)
    assert run() == (value, True)


def test_modules_that_are_not_imported_do_not_count(mini):
    assert run() == (1025.0, True)
    (mini / "other.py").write_text("SCALE = 5.0\n")
    importlib.import_module("mini.other")
    assert run() == (1025.0, False)


def test_a_change_after_the_import_is_not_cached(mini):
    """Old code must not be cached as that of the new source."""
    forget()
    outer = importlib.import_module("mini.loops").outer
    time.sleep(0.02)
    edit(mini / "parts" / "inner.py", "return factor", "return -factor")
    assert outer(1.0) == 1025.0
    assert run() == (1021.0, True)


def test_records_are_matched_by_field_names(mini):
    """The name of a record's type in numba does not contain the fields."""
    pair = importlib.import_module("mini.parts.inner").Pair(1.0, 2.0)
    assert run("first_of", pair)[0] == 1.0
    edit(mini / "parts" / "inner.py", "first: float\n    second", "second: float\n    first")
    forget()
    pair = importlib.import_module("mini.parts.inner").Pair(first=1.0, second=2.0)
    loops = importlib.import_module("mini.loops")
    assert loops.first_of(pair) == 1.0


@pytest.mark.parametrize("damage", ["empty", "cut", "bits", "other", "folder"])
@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_a_damaged_file_is_compiled_again(mini, tmp_path, damage, suffix):
    """Numba alone would raise an error of pickle, or run damaged machine code."""
    assert run() == (1025.0, True)
    files = [*(tmp_path / "user").rglob(f"*.{suffix}")]
    assert len(files) == 2
    for path in files:
        data = path.read_bytes()
        if damage == "folder":
            path.unlink()
            path.mkdir()
        else:
            middle = len(data) // 2
            flipped = data[:middle] + bytes([data[middle] ^ 16]) + data[middle + 1 :]
            path.write_bytes(
                {"empty": b"", "cut": data[:-10], "bits": flipped, "other": b"\x80\x04N." * 20}[damage]
            )
    assert run() == (1025.0, True)
    assert run() == (1025.0, False)


def test_a_full_disk_is_reported(mini, monkeypatch, caplog):
    """The loop runs all the same."""
    outer = importlib.import_module("mini.loops").outer

    def fail(path, *args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", fail)
    assert outer(1.0) == outer(2.0) - 2.0 == 1025.0
    assert caplog.text.count("No space left") == 2
    assert len(outer.dispatcher.signatures) == 1


def test_old_versions_are_deleted(mini, tmp_path):
    """The most recently used ones remain, and all of the last hour, which other processes may be using."""

    def folders():
        return list((tmp_path / "user" / "robosim").glob("mini.loops-*"))

    for i in range(MAX_VERSIONS + 2):
        (mini / "units.py").write_text(f"SCALE = {float(i)}\n")
        assert run() == (1022.0 + i, True)
    assert len(folders()) == MAX_VERSIONS + 2
    for folder in folders():
        os.utime(folder, (folder.stat().st_atime, folder.stat().st_mtime - 7200))
    assert run() == (1022.0 + i, False)
    assert len(folders()) == MAX_VERSIONS


SHOW = """
    from mini.loops import outer

    print(outer(1.0), outer(1), outer(True), sum(outer.dispatcher.stats.cache_misses.values()))
"""


def test_processes_may_start_at_the_same_time(mini):
    """Three processes on an empty folder, three types of argument: each type is compiled by one process.

    Numba's index of a function's files would mix up code of different types if two processes wrote it at once.
    """
    lines = [output_of(process).split() for process in [start(mini, SHOW) for _ in range(3)]]
    assert [values for *values, _ in lines] == [["1025.0"] * 3] * 3
    assert sum(int(count) for *_, count in lines) == 3
    assert output_of(start(mini, SHOW)).split() == ["1025.0"] * 3 + ["0"]


def test_threads_may_start_at_the_same_time(mini):
    """No thread waits for another that waits for it, whether it compiles the caller or the function called."""
    loops = importlib.import_module("mini.loops")
    inner = sys.modules["mini.parts.inner"].inner
    values = []
    calls = [lambda: values.append(loops.outer(1.0)), lambda: values.append(inner(1.0) + 1000.0)]
    threads = [threading.Thread(target=call, daemon=True) for call in 3 * calls]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(120)
    assert values == [1025.0] * 6


def test_without_locks_loops_are_compiled(mini, monkeypatch):
    """As on a disk that has none: two processes may then compile the same loop."""

    def fail(lock, how):
        raise OSError(37, "No locks available")

    monkeypatch.setattr("fcntl.lockf", fail)
    assert run() == (1025.0, True)
    assert run() == (1025.0, False)


def test_a_constant_is_compiled_as_any_number(mini):
    """Called with 2, with 3 and with a variable, an inner loop is compiled once."""
    edit(
        mini / "loops.py",
        "@compiled\ndef outer",
        """@compiled
def power(x, n):
    return x**n


@compiled
def powers(x, n):
    return power(x, 2) + power(x, 3) + power(x, n)


@compiled
def outer""",
    )
    assert run("powers", 2.0, 4) == (28.0, True)
    assert len(sys.modules["mini.loops"].power.dispatcher.signatures) == 1


def test_a_loop_can_be_pickled(mini):
    outer = importlib.import_module("mini.loops").outer
    assert pickle.loads(pickle.dumps(outer)) is outer


def test_numba_is_imported_at_the_first_call(mini):
    program = """
        import sys

        from mini.loops import outer

        assert "numba" not in sys.modules
        print(outer(1.0), "numba" in sys.modules)
    """
    assert output_of(start(mini, program)).split() == ["1025.0", "True"]


def test_loops_can_be_interpreted(mini):
    """For debuggers, with `NUMBA_DISABLE_JIT`."""
    program = """
        import os

        os.environ["NUMBA_DISABLE_JIT"] = "1"
        from mini.loops import outer

        print(outer(1.0), outer.dispatcher is outer.py_func)
    """
    assert output_of(start(mini, program)).split() == ["1025.0", "True"]
