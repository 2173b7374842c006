"""Fixtures of all tests, and floor plans and data that are not part of this project."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path

# Import large libraries before the first module of this project: while such a module loads, jaxtyping makes Python look
# for bytecode under another name, so libraries imported by it would be compiled again in each process.
import matplotlib.pyplot  # noqa: F401
import numba  # noqa: F401
import pytest
import scipy.optimize  # noqa: F401
import torch  # noqa: F401
from slow_tests import mark_slow
from typecheck import check_all_again

from robosim.support.workers import Workers

# Several test processes use all cores: additional threads would wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# A background job of a shell ignores Ctrl-C, and so would the processes that tests start.
if (
    signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    and threading.current_thread() is threading.main_thread()
):
    signal.signal(signal.SIGINT, signal.default_int_handler)

SHARED = Path(__file__).resolve().parents[2] / "shared"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark slow tests, which `make quick` leaves out."""
    mark_slow(items)


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of real floor plans and public measurements, which may not be shipped."""
    if not SHARED.is_dir():
        pytest.skip("needs the real floor plans in ../shared, which are not part of this project")
    return SHARED


@pytest.fixture(autouse=True)
def fresh_type_checks() -> None:
    """Check types again in each test."""
    check_all_again()


def _here(self, function, arguments) -> Future:
    """Call a worker's function in this process."""
    future = Future()
    try:
        future.set_result(function(*arguments))
    except Exception as error:
        future.set_exception(error)
    return future


@pytest.fixture
def in_process(monkeypatch) -> None:
    """Run workers' calls in this process: faster for few calls, and a test can patch them."""
    monkeypatch.setattr(Workers, "_submit", _here)


_submit = Workers._submit


@pytest.fixture(scope="session", autouse=True)
def one_worker_is_this_process() -> Iterator[None]:
    """Run a single worker in this process, since a start takes seconds. Several workers, or a cluster, are real."""

    def submit(self, function, arguments) -> Future:
        alone = self._count == 1 and self._cluster is None
        return (_here if alone else _submit)(self, function, arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workers, "_submit", submit)
        yield


@pytest.fixture
def real_workers(monkeypatch) -> None:
    """Run a single worker in a separate process, as for users."""
    monkeypatch.setattr(Workers, "_submit", _submit)


@pytest.fixture
def own_modules(monkeypatch) -> Iterator[None]:
    """Isolate modules that a test imports from its own folder."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)
    for name in ("mine", "broken", "pursuit"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    yield
    for name in set(sys.modules) - before:
        if name in ("mine", "broken", "pursuit"):
            del sys.modules[name]
