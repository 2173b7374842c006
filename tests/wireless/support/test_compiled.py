"""Compiled functions: what runs is what the sources say, wherever it is kept, and a signal finds it whole."""

import contextlib
import errno
import fcntl
import importlib
import inspect
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

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
from wireless.support.compiled_files import KEPT

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


def forget():
    """As a new process: nothing of the package is imported."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "mini"]:
        del sys.modules[name]
    importlib.invalidate_caches()


def run(name="outer", *arguments):
    """What a function of the package returns in a new process, and whether it was compiled there."""
    forget()
    function = getattr(importlib.import_module("mini.loops"), name)
    value = function(*(arguments or (1.0,)))
    return value, sum(function.stats.cache_misses.values()) > 0


def edit(file, old, new):
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))


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


def told(process):
    """What a process wrote; it ended well."""
    out, error = process.communicate(timeout=600)
    assert process.returncode == 0, f"status {process.returncode}\n{error}"
    return out


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


def machine_code():
    """Whether functions have machine code of their own: the one that another calls, and the one that calls it."""
    functions = (sys.modules["mini.parts.inner"].inner._part, sys.modules["mini.loops"].outer)
    made = [next(iter(function.overloads.values())).library for function in functions]
    return [any(not one.is_declaration for one in library._final_module.functions) for library in made]


def test_what_only_other_loops_call_is_linked_into_them(mini):
    """And has no machine code of its own."""
    assert run() == (1025.0, True)
    if not sys.modules["mini.linked"].works():
        pytest.skip("this version of numba has no such parts, or others")
    assert machine_code() == [False, True]


@pytest.mark.parametrize(
    ("part", "other"),
    [
        ('"JITCodeLibrary"', '"CodeLibraryOfAnotherName"'),
        ("_function_pass_manager(opt=_TIDY)", "_function_pass_manager(another_option=_TIDY)"),
        ("self._get_module_for_linking()", "self._another_method()"),
        ('"_ZN7cpython"', '"_ZN12another_name"'),
        ("template.context", "template.another_part"),
        ("options.fastmath", "options.another_option"),
    ],
)
def test_where_numba_has_other_parts_its_own_way_serves(mini, part, other):
    """Without a word; what is kept then serves as well where it has them, and the other way round."""
    edit(mini / "linked.py", part, other)
    assert run() == (1025.0, True)
    assert not sys.modules["mini.linked"].works()
    assert machine_code() == [True, True]
    edit(mini / "linked.py", other, part)
    assert run() == (1025.0, False)
    [kept] = (mini / "__pycache__").glob("mini.loops.outer-*.compiled")
    kept.unlink()
    assert run() == (1025.0, True)
    [kept] = (mini / "__pycache__").glob("mini.loops.outer-*.compiled")
    kept.unlink()
    edit(mini / "linked.py", part, other)
    assert run() == (1025.0, True)


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


#: A loop of a second whose result numba makes by calling Python, and Ctrl-C in it or in its compiling.
INTERRUPTED = """
    import os, signal, threading, time
    from typing import NamedTuple

    import numpy as np

    from mini.compiled import compiled


    class Result(NamedTuple):
        values: np.ndarray
        number: int


    @compiled
    def spin(rounds, n):
        x = np.ones(n)
        for i in range(rounds):
            x[i % n] = np.sin(x[i % n] + i)
        return Result(x, 1)


    def interrupted(delay, call, longer=None):
        for _ in range(20):
            through = False
            try:
                threading.Timer(delay, os.kill, (os.getpid(), SIGNAL)).start()
                call()
                through = True
                time.sleep(60)
            except Stop:
                # On a busy machine the signal may come when all is over: then once more, for longer.
                if not through or longer is None:
                    return
                longer()
            else:
                break
        raise SystemExit("not interrupted")


    class Ended(Exception):
        pass


    def end(number, frame):
        raise Ended


    SIGNAL, Stop = signal.SIGINT, KeyboardInterrupt
    interrupted(0.05, lambda: spin(10, 3))
    begin = time.perf_counter()
    spin(2_000_000, 3)
    rounds = max(1, int(2_000_000 * 0.3 / (time.perf_counter() - begin)))

    def more():
        global rounds
        rounds *= 2

    for i in range(4):
        interrupted(0.02 + 0.05 * i, lambda: spin(rounds, 3), more)
    SIGNAL, Stop = signal.SIGTERM, Ended
    signal.signal(SIGNAL, end)
    interrupted(0.1, lambda: spin(rounds, 3), more)
    assert signal.getsignal(signal.SIGTERM) is end
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    asked = []
    signal.signal(signal.SIGINT, lambda number, frame: asked.append(number))
    timer = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    assert spin(rounds, 3).number == 1
    timer.join()
    assert asked == [signal.SIGINT]
    print("whole")
"""


def test_signals_wait_until_a_loop_is_through(mini):
    """Ctrl-C in a loop of the main thread, and in its compiling, is a KeyboardInterrupt; so for other handlers.

    Left alone, it is raised where numba makes an array of the result, and the process ends with signal 11.
    """
    assert told(start(mini, INTERRUPTED)).split() == ["whole"]


def test_ctrl_c_during_a_trace_is_a_keyboard_interrupt():
    """Tracing in the main thread, interrupted four times in a process; before, it died at the first."""
    program = """
        import os, signal, threading, time

        import numpy as np
        import trimesh

        from wireless import Tracer, TracerConfig

        tracer = Tracer(trimesh.creation.box((8, 6, 3)), config=TracerConfig(scene="plan"))
        tx, rx = np.zeros((1, 3)), np.random.default_rng(0).uniform(-1, 1, (400, 3))
        tracer.trace(tx, rx[:1], workers=1)
        for i in range(4):
            try:
                threading.Timer(0.02 + 0.03 * i, os.kill, (os.getpid(), signal.SIGINT)).start()
                while True:
                    tracer.trace(tx, rx, workers=1)
            except KeyboardInterrupt:
                print("stopped")
    """
    root = Path(wireless.support.compiled.__file__).parents[3]
    process = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        cwd=root,
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert process.returncode != -signal.SIGSEGV, process.stderr
    assert process.returncode == 0 and process.stdout.split() == ["stopped"] * 4, process.stderr


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
