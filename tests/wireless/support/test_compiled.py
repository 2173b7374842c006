"""Compiled functions: what runs is what the sources say, wherever it is kept."""

import contextlib
import errno
import fcntl
import importlib
import inspect
import os
import sys
import threading

import numba
import numpy as np
import pytest

import slam.learning.restoring
import slam.support.axes
import slam.support.compiled
import slam.support.compiled_files
import slam.support.linked
import wireless.linkstate.learning.restoring
import wireless.support.axes
import wireless.support.compiled
import wireless.support.compiled_files
import wireless.support.linked
from tests.wireless.support.mini_package import edit, forget, run, start, told
from wireless.support.compiled_files import KEPT


def no_folder(path):
    """Make a path that no folder can be made at: also root cannot."""
    path.parent.mkdir(exist_ok=True)
    path.write_text("")


@pytest.fixture(params=["beside the source", "NUMBA_CACHE_DIR", "the user's", "none"])
def place(request, mini, tmp_path, monkeypatch):
    """Where compiled functions can be kept; the folders before it cannot be written."""
    if request.param == "NUMBA_CACHE_DIR":
        monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "named"))
    elif request.param != "beside the source":
        for folder in (mini, mini / "parts"):
            no_folder(folder / "__pycache__")
    if request.param == "none":
        no_folder(tmp_path / "user")
        no_folder(tmp_path / "named")
        monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "named"))
        return None
    return {
        "beside the source": mini / "__pycache__",
        "NUMBA_CACHE_DIR": tmp_path / "named" / "robosim",
        "the user's": tmp_path / "user" / "robosim",
    }[request.param]


def test_a_changed_loop_in_another_file_is_what_runs(place, mini, caplog):
    """Wherever it is kept. Numba would go on with the old version, which the calling function has swallowed.

    That compiling takes its time is said when it does, once, and otherwise not.
    """
    assert run() == (1025.0, True)
    [message] = caplog.messages
    if place is None:
        assert "compiled in each run" in message and "Set NUMBA_CACHE_DIR" in message
    else:
        assert "kept for later runs" in message
        assert list(place.glob("mini.loops.outer-*.compiled"))
    caplog.clear()
    assert run() == (1025.0, place is None)
    assert len(caplog.messages) == (place is None)
    edit(mini / "parts" / "inner.py", "return factor", "return -factor")
    assert run() == (1021.0, True)
    edit(mini / "parts" / "inner.py", "return -factor", "return factor")
    assert run() == (1025.0, place is None)


@pytest.mark.parametrize(
    ("file", "old", "new", "value"),
    [
        ("parts/inner.py", "Pair(x, 100.0)", "Pair(2.0 * x, 100.0)", 1027.0),
        ("parts/inner.py", "factor=2.0", "factor=4.0", 1027.0),
        ("parts/inner.py", "STEP = 10.0", "STEP = 20.0", 1045.0),
        ("parts/inner.py", "[1.0, 2.0, 4.0]", "[1.0, 3.0, 4.0]", 1035.0),
        ("parts/inner.py", "first: float\n    second", "second: float\n    first", 1223.0),
        ("units.py", "SCALE = 3.0", "SCALE = 4.0", 1026.0),
        (
            "loops.py",
            "@compiled\ndef outer",
            "from mini.parts.inner import inner as twice\n\n\n@compiled\ndef outer",
            None,
        ),
        ("parts/inner.py", "Some of everything", "All", None),
        (
            "parts/inner.py",
            "TABLE = np",
            "OTHER = 1.0\n\n\ndef other():\n    return OTHER\n\n\nTABLE = np",
            None,
        ),
    ],
)
def test_what_machine_code_is_made_of_names_its_file(mini, file, old, new, value):
    """A constant, a default, a table, fields of a tuple in any file make another; words and neighbours do not."""
    assert run() == (1025.0, True)
    edit(mini / file, old, new)
    assert run() == ((1025.0, False) if value is None else (value, True))


def test_fields_of_an_argument_are_told_by_name(mini):
    """`Pair(float64, float64)` is all that numba's name of the type says, whichever comes first."""
    pair = importlib.import_module("mini.parts.inner").Pair(1.0, 2.0)
    assert run("first_of", pair)[0] == 1.0
    edit(mini / "parts" / "inner.py", "first: float\n    second", "second: float\n    first")
    forget()
    pair = importlib.import_module("mini.parts.inner").Pair(first=1.0, second=2.0)
    loops = importlib.import_module("mini.loops")
    assert loops.first_of(pair) == 1.0


@pytest.mark.parametrize("damage", ["empty", "cut", "bits", "other", "folder"])
def test_a_damaged_file_is_compiled_again(mini, damage):
    """Numba would end in an error of pickle or, in machine code, in whatever the machine makes of it."""
    assert run() == (1025.0, True)
    kept = [*(mini / "__pycache__").glob("*outer*"), *(mini / "parts" / "__pycache__").glob("*.compiled")]
    assert len(kept) == 2
    for path in kept:
        data = path.read_bytes()
        if damage == "folder":
            path.unlink()
            path.mkdir()
        else:
            middle = len(data) // 2
            flipped = data[:middle] + bytes([data[middle] ^ 16]) + data[middle + 1 :]
            path.write_bytes(
                {"empty": b"", "cut": data[:-100], "bits": flipped, "other": b"\x80\x04N." * 20}[damage]
            )
    assert run() == (1025.0, True)
    assert run() == (1025.0, damage == "folder")


def test_old_versions_and_halves_do_not_pile_up(mini):
    """Of a function's versions the last few stay, and what a killed process left goes after an hour."""
    assert run()[1]
    folder = mini / "__pycache__"
    [mine] = folder.glob("mini.loops.outer-*")
    for i in range(KEPT + 4):
        (folder / f"mini.loops.outer-{i:032x}.compiled").write_bytes(b"old")
        os.utime(folder / f"mini.loops.outer-{i:032x}.compiled", (i, i))
    halves = [folder / f".mini.loops.outer-0.compiled.{age}.partial" for age in ("new", "old")]
    for half in halves:
        half.write_bytes(b"half")
    os.utime(halves[1], (1, 1))
    edit(mini / "parts" / "inner.py", "return factor", "return -factor")
    assert run()[1]
    assert len(list(folder.glob("mini.loops.outer-*"))) == KEPT
    assert mine.exists()
    assert [half.exists() for half in halves] == [True, False]


SHOW = """
    from mini.loops import outer

    print(outer(1.0), outer(1), outer(True), sum(outer.stats.cache_misses.values()))
"""


def test_processes_may_start_at_once(mini):
    """Three on an empty folder, each for three types of argument: all are right, and each is compiled by one of them.

    Numba numbers its files in an index that two processes may write at once: one's types, the other's code.
    """
    said = [told(process).split() for process in [start(mini, SHOW) for _ in range(3)]]
    assert [values for *values, _ in said] == [["1025.0"] * 3] * 3
    assert sum(int(compiled) for *_, compiled in said) == 3
    assert told(start(mini, SHOW)).split() == ["1025.0"] * 3 + ["0"]
    assert not list(mini.rglob(".*.compiled.*"))


def test_a_process_waits_for_another_that_compiles(mini):
    """What the other has put there in the meantime is what runs."""
    assert run() == (1025.0, True)
    [kept] = (mini / "__pycache__").glob("mini.loops.outer-*.compiled")
    aside = kept.rename(mini / "aside")
    with kept.with_name(f".{kept.name}.lock").open("wb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        threading.Timer(0.5, lambda: (aside.rename(kept), lock.close())).start()
        assert run() == (1025.0, False)


@pytest.mark.parametrize("why", ["the other never ends", "the disk knows no locks"])
def test_without_a_lock_it_compiles_all_the_same(mini, monkeypatch, why):
    """Twice compiled is as right as once: each of two functions is waited for with patience, or not at all."""
    edit(mini / "compiled_files.py", "PATIENCE_S, LOOK_S = 600.0", "PATIENCE_S, LOOK_S = 0.2")
    asked = []

    def refused(lock, how):
        asked.append(lock)
        raise (
            BlockingIOError if why == "the other never ends" else OSError(errno.ENOLCK, "No locks available")
        )

    monkeypatch.setattr(fcntl, "flock", refused)
    assert run() == (1025.0, True)
    assert len(set(asked)) == 2
    assert len(asked) > 2 if why == "the other never ends" else len(asked) == 2


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
    assert len(sys.modules["mini.loops"].power._part.signatures) == 1


def test_a_loop_that_another_calls_can_be_called_from_python_too(mini):
    """In either order; what the other calls of it has no code to unpack arguments, and is a file of its own."""
    assert run() == (1025.0, True)
    inner = sys.modules["mini.parts.inner"].inner
    assert inner(1.0) == 25.0
    assert len(list((mini / "parts" / "__pycache__").glob("mini.parts.inner.inner-*.compiled"))) == 2
    assert sys.modules["mini.loops"].outer(2.0) == 1027.0


def test_the_first_loop_that_is_not_on_disk_is_told(mini):
    """Once, whatever is compiled after it; and not where all are on disk."""

    def calls() -> int:
        forget()
        told = []
        files = importlib.import_module("mini.compiled_files")
        files.when_first.append(lambda: told.append(1))
        loops = importlib.import_module("mini.loops")
        assert (loops.outer(1.0), loops.outer(np.float32(1.0))) == (1025.0, 1025.0)
        return len(told)

    assert [calls(), calls()] == [1, 0]


def test_no_garbage_is_looked_for_while_a_loop_compiles(mini, monkeypatch):
    """And again afterwards, also if nothing can be compiled."""
    import gc

    edit(mini / "loops.py", "return inner(x) + 1000.0", "return inner(x) + nothing_there")
    assert gc.isenabled()
    with pytest.raises(numba.TypingError):
        run()
    assert gc.isenabled()


def test_a_folder_filled_by_another_user_is_read(mini):
    """Of a package that nobody may write, as in a container: what was compiled before serves all."""
    assert run()[1]
    before = sorted(mini.rglob("*"))
    folders = [mini, *(path for path in before if path.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    try:
        with contextlib.suppress(FileExistsError):
            (mini.parent / "user").write_text("")
        assert run() == (1025.0, False)
        assert sorted(mini.rglob("*")) == before
    finally:
        for folder in folders:
            folder.chmod(0o755)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (wireless.support.compiled, slam.support.compiled),
        (wireless.support.compiled_files, slam.support.compiled_files),
        (wireless.support.linked, slam.support.linked),
        (wireless.linkstate.learning.restoring, slam.learning.restoring),
        (wireless.support.axes, slam.support.axes),
    ],
    ids=["compiled", "compiled_files", "linked", "restoring", "axes"],
)
def test_slam_and_wireless_have_one_text(one, other):
    """Neither package imports the other, so that both have these files."""
    assert inspect.getsource(one) == inspect.getsource(other)
