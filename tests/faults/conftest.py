"""Running commands and disturbing them.

`pytest tests/faults` tries each fault on some commands, at one moment, and each of the main commands once at least;
`make faults` (--long --moments 20) tries all faults on all commands, at twenty random moments each, and prints counts.
"""

import fcntl
import os
import random
import re
import signal
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from robosim.cli import main
from robosim.plans.files import write_ros
from tests.faults.commands import COMMANDS, EPISODE, FRAMES, LINKS, LOG, Command, contents, copied
from tests.plans import two_rooms
from tests.robot_logs import Drive

#: Nothing that a command starts may be at work so long after it has ended [s].
ORPHANS_S = 10
#: A command that does not end within this time hangs [s]; on a machine ten times slower it would not.
HANGS_S = 900


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add how often, and whether all commands."""
    parser.addoption("--moments", type=int, default=1, help="random moments at which each fault strikes")
    parser.addoption("--long", action="store_true", help="also commands that are left out every day")
    parser.addoption("--moment-seed", type=int, default=1, help="seed of the moments")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """A test for each command that a fault can meet; every day for those that a test names."""
    if "name" in metafunc.fixturenames:
        can_meet = getattr(metafunc.function, "commands", lambda command: True)
        daily = getattr(metafunc.function, "daily", COMMANDS)
        long = metafunc.config.getoption("--long")
        metafunc.parametrize(
            "name", [name for name, c in COMMANDS.items() if can_meet(c) and (long or name in daily)]
        )


@dataclass
class Ended:
    """How a command ended."""

    status: int
    said: str
    complained: str
    seconds: float


@dataclass
class Reference:
    """How a command does when nothing disturbs it."""

    seconds: float
    contents: dict[str, Any]


class Bench:
    """Material for commands, and what they come to undisturbed; made once for all processes that run tests."""

    def __init__(self, folder: Path, shared: Path | None) -> None:
        self.folder, self.shared = folder, shared
        self.plan = folder / "pair.yaml"
        folder.mkdir(exist_ok=True)
        with self._alone("plan"):
            if not self.plan.exists():
                write_ros(two_rooms(0.8), self.plan)
        self._references: dict[str, Reference] = {}

    def words(self, command: Command, folder: Path) -> list[str]:
        """What is typed for a command in a folder of its own; makes the material that it needs."""
        places: dict[str, Any] = {"plan": self.plan}
        for need in command.needs:
            if need == EPISODE:
                # A replay writes into the episode's folder: each has its own.
                places[EPISODE] = folder / "out"
                if not places[EPISODE].exists():
                    copied(self.out("episode"), places[EPISODE])
            elif need == FRAMES:
                places[FRAMES] = self.out("collect")
            elif need == LINKS:
                places[LINKS] = self._made(
                    Command("dataset --generated 3 --tx-per-plan 1 --grid 0.5 --estimator pca --workers 2"),
                    LINKS,
                )
            elif need == LOG:
                places[LOG] = self._log()
            elif self.shared is None:
                pytest.skip("needs public measurements in ../shared, which are not part of this project")
            else:
                # One building is enough.
                places |= {"labels": folder / "labels", "maps": self.shared / "maps" / "gibson" / "train"}
                one = self.shared / "data" / "mmwrobotnav" / "Hominy"
                if not places["labels"].exists():
                    places["labels"].mkdir(parents=True)
                    (places["labels"] / "Hominy").symlink_to(one)
        words = command.words.format(**places).split()
        return words if EPISODE in command.needs else [*words, "--out", str(folder / "out")]

    def reference(self, name: str) -> Reference:
        """What a command comes to, run once."""
        if name not in self._references:
            folder = self._made(COMMANDS[name], f"reference-{name}")
            seconds = float((folder.parent / "seconds").read_text())
            self._references[name] = Reference(seconds, contents(folder, COMMANDS[name]))
        return self._references[name]

    def out(self, name: str) -> Path:
        """Where a command's results are that nothing disturbed."""
        return self._made(COMMANDS[name], f"reference-{name}")

    def _log(self) -> Path:
        """A robot's log."""
        path = self.folder / "room.log"
        with self._alone("log"):
            if not path.exists():
                path.write_text(Drive().raw())
        return path

    def _made(self, command: Command, name: str) -> Path:
        """Results of a command, run once."""
        folder = self.folder / name.replace(" ", "-")
        with self._alone(folder.name):
            if not (folder / "seconds").exists():
                folder.mkdir()
                ended = run(self.words(command, folder))
                assert ended.status == 0, (name, ended.complained)
                (folder / "seconds").write_text(str(ended.seconds))
        return folder / "out"

    @contextmanager
    def _alone(self, name: str) -> Iterator[None]:
        """One process at a time."""
        with open(self.folder / f"{name}.lock", "w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield


@pytest.fixture(scope="session")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """Material for commands."""
    shared = Path(__file__).resolve().parents[3] / "shared"
    base = tmp_path_factory.getbasetemp()
    together = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    return Bench(together / "faults", shared if shared.is_dir() else None)


@pytest.fixture
def moments(request: pytest.FixtureRequest) -> Callable[[str, float], list[float]]:
    """Random moments of a command that takes some seconds, from its start until a little after its end."""
    count = request.config.getoption("--moments")
    seed = request.config.getoption("--moment-seed")

    def draw(name: str, seconds: float) -> list[float]:
        rng = random.Random(f"{seed} {request.node.name} {name}")
        return [rng.uniform(0, 1.02 * seconds) for _ in range(count)]

    return draw


@contextmanager
def started(words: list[str], **options: Any) -> Iterator[subprocess.Popen]:
    """A command in a group of processes of its own, which has ended with the block."""
    process = subprocess.Popen(
        [sys.executable, "-X", "faulthandler", "-m", "robosim", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        **options,
    )
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def end_of(process: subprocess.Popen, begin: float) -> Ended:
    """Wait until a command has ended, and see that nothing goes on for long after it."""
    said, complained = process.communicate(timeout=HANGS_S)
    seconds, deadline = time.monotonic() - begin, time.monotonic() + ORPHANS_S
    while time.monotonic() < deadline and (left := _group(process.pid)):
        time.sleep(0.05)
    assert not left, f"still at work {ORPHANS_S} s after the end: {left}"
    return Ended(process.returncode, said, complained, seconds)


def run(words: list[str], **options: Any) -> Ended:
    """A command from its start to its end."""
    begin = time.monotonic()
    with started(words, **options) as process:
        return end_of(process, begin)


def _group(group: int) -> list[str]:
    """What the living processes of a group are called."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, _, rest = stat.read_text().rpartition(")")
        except OSError:
            continue
        state, _, its_group = rest.split()[:3]
        if int(its_group) == group and state != "Z":
            found.append(name)
    return found


def children(parent: int) -> list[int]:
    """Worker processes that a command has started."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
            command = (stat.parent / "cmdline").read_bytes()
        except OSError:
            continue
        if int(fields[1]) == parent and b"spawn_main" in command:
            found.append(int(stat.parent.name))
    return found


def no_crash(ended: Ended) -> None:
    """Whether a command ended as one that was written ends: no signal of the machine, no traceback."""
    assert ended.status not in (-signal.SIGSEGV, -signal.SIGABRT, -signal.SIGBUS), ended.complained
    assert "Traceback" not in ended.complained or before_us(ended), ended.complained
    assert "Fatal Python error" not in ended.complained, ended.complained
    assert "internal error" not in ended.complained, ended.complained


def before_us(ended: Ended) -> bool:
    """Whether Ctrl-C came before Python had loaded anything of ours, and Python reported it itself."""
    files = re.findall('File "(.*?)"', ended.complained)
    of_python = ("<frozen ", sysconfig.get_paths()["stdlib"])
    return (
        ended.status in (1, -signal.SIGINT)
        and "KeyboardInterrupt" in ended.complained
        and bool(files)
        and all(file.startswith(of_python) and "site-packages" not in file for file in files)
    )


def comes_to_the_same(bench: Bench, name: str, folder: Path) -> None:
    """Give the same command again: it ends well, with the same files as if nothing had happened, and no others."""
    command = COMMANDS[name]
    # In this process, since nothing disturbs it any more: it need not import everything.
    main(bench.words(command, folder))
    assert not list(folder.rglob(".*partial*"))
    if command.goes_on or name in ("episode", "replay"):
        assert contents(folder / "out", command) == bench.reference(name).contents
