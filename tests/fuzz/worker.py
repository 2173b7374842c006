"""Runs cases of the fuzzer in a process of its own, given on standard input, and says what came of each.

A case is a target and a number; with the common seed they give the damage. Good is: read, or rejected in one line that
names the file. All else is a failure: another kind of error, many lines, no name, more than a gigabyte, more than
20 s, code that was run, anything else said on standard error.
"""

import json
import logging
import os
import random
import resource
import shutil
import sys
import tempfile
import time
import traceback
from dataclasses import asdict, dataclass
from pathlib import Path
from unittest.mock import patch

import matplotlib.pyplot as plt

from robosim.support.reading import is_ours
from tests.fuzz.mutations import damage
from tests.fuzz.targets import TARGETS, Target
from tests.fuzz.trees import CANARY_MODULE, MARKER

MOST_MB, MOST_S = 1000, 20.0
#: Failures of a case; whatever else it comes to is good.
BAD = ("traceback", "unnamed", "lines", "said more", "slow", "memory", "code run", "died", "hung")


@dataclass(frozen=True)
class Case:
    """Which damage to which target."""

    target: str
    number: int
    seed: int = 0


@dataclass(frozen=True)
class Outcome:
    """What came of a case."""

    kind: str
    """read, rejected, or one of `BAD`."""
    method: str
    """How the file was damaged."""
    file: str
    """Which one."""
    seconds: float
    peak_mb: float
    """Memory above that of the process before."""
    message: str
    """What was said, or the traceback."""


def run_case(case: Case, target: Target, seeds: Path, work: Path, content: bytes | None = None) -> Outcome:
    """Damage a copy of a seed and read it; the damaged copy stays in `work`/case.

    Args:
        case: Which damage.
        target: What reads it.
        seeds: Folder of all seeds.
        work: Folder to work in.
        content: What the only file that the target damages is to hold; damage by the case's number if not given.
    """
    folder, here, canaries = work / "case", work / "here", work / "canaries"
    canaries.mkdir(parents=True, exist_ok=True)
    (canaries / "canary.py").write_text(CANARY_MODULE)
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(seeds / target.seed, folder)
    shutil.rmtree(here, ignore_errors=True)
    here.mkdir(parents=True)
    rng = random.Random(f"{case.seed}/{case.target}/{case.number}")
    file = rng.choice(sorted(path for path in folder.glob(target.files) if path.is_file()))
    method = "given"
    if content is None:
        method = damage(file, sorted(path for path in seeds.rglob("*") if path.is_file()), rng)
    else:
        file.write_bytes(content)
    os.chdir(here)
    sys.modules.pop("canary", None)
    before_mb = _forget_peak()
    begin = time.process_time()  # a busy machine is no fault of a reader; what waits is found by its silence
    with patch.object(sys, "path", [str(canaries), *sys.path]):
        kind, message, said = _called(target, folder, file)
    seconds, peak_mb = time.process_time() - begin, _peak_mb() - before_mb
    if kind == "rejected":
        # A file that is not there cannot be named.
        named = "" if method in ("missing", "dangling") else file.name
        kind = _judged(message, [named, target.names or named], folder)
    if kind in ("read", "rejected") and said.strip():
        kind, message = "said more", f"{message}\n{said}"
    for bad, happened in (("slow", seconds > MOST_S), ("memory", peak_mb > MOST_MB)):
        kind = bad if happened and kind in ("read", "rejected") else kind
    if any((place / MARKER).exists() for place in (here, folder, file.parent)):
        kind = "code run"
    return Outcome(kind, method, str(file.relative_to(folder)), round(seconds, 3), round(peak_mb, 1), message)


def _called(target: Target, folder: Path, file: Path) -> tuple[str, str, str]:
    """Read, rejected or traceback; the message; and what else was said on standard error, by whatever language."""
    kind, message, code = "read", "", 0
    # A command prints warnings, which may not stand next to a rejection; what a reader logs is no concern of its own.
    disabled = logging.root.manager.disable
    logging.disable(logging.NOTSET if target.is_command else logging.CRITICAL)
    with tempfile.TemporaryFile() as captured:
        stored = os.dup(2)
        os.dup2(captured.fileno(), 2)
        try:
            target.call(folder, file)
        except SystemExit as error:
            code = error.code if isinstance(error.code, int) else 1
        except ValueError as error:
            own = type(error) is ValueError or is_ours(error)
            kind, message = ("rejected", str(error)) if own else ("traceback", traceback.format_exc())
        except BaseException:
            kind, message = "traceback", traceback.format_exc()
        finally:
            logging.disable(disabled)
            sys.stderr.flush()
            plt.close("all")
            os.dup2(stored, 2)
            os.close(stored)
        captured.seek(0)
        said = captured.read().decode("utf-8", "replace")
    if target.is_command and kind != "traceback":
        if code == 2:
            return "rejected", said.removesuffix("\n"), ""
        return ("read", "", "") if code == 0 else ("traceback", said, "")
    return kind, message, said


def _judged(message: str, names: list[str], folder: Path) -> str:
    """Whether a rejection is one line, and names the folder and one of the names."""
    if "\n" in message or not message.isprintable():
        return "lines"
    return "rejected" if any(name in message for name in names) and str(folder) in message else "unnamed"


def _status(name: str) -> float:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name):
            return int(line.split()[1]) / 1000
    return 0.0


def _peak_mb() -> float:
    return _status("VmHWM")


def _forget_peak() -> float:
    """Begin to measure the peak again; memory now."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return _peak_mb()
    return _status("VmRSS")


def serve(seeds: Path, work: Path, targets: list[str]) -> None:
    """Run the cases of some targets that come in, a line each, until there are no more."""
    answers = os.fdopen(os.dup(1), "w")
    # Whatever the readers print is of no interest here.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    warm_up(seeds, work, targets)
    # A backstop: what needs more is out of memory rather than the machine.
    most = int(_status("VmSize") * 1e6) + 4_000_000_000
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        case = Case(**json.loads(line))
        outcome = run_case(case, TARGETS[case.target], seeds, work)
        print(json.dumps(asdict(outcome)), file=answers, flush=True)


def warm_up(seeds: Path, work: Path, targets: list[str]) -> None:
    """Read good files once, so that what is compiled and imported at first use is no part of a case."""
    for target in map(TARGETS.__getitem__, targets):
        if not (seeds / target.seed).is_dir():
            continue
        folder = work / "warm"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(seeds / target.seed, folder)
        file = min(path for path in folder.glob(target.files) if path.is_file())
        _called(target, folder, file)


if __name__ == "__main__":
    serve(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
