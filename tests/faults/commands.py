"""Every command that writes, small: what the fault tests run, and how its results are compared."""

import json
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

#: What differs from run to run: times, and what they were measured with.
TIMES = ("timing", "seconds", "parts", "ms", "relative_speed")
#: And how their names end.
OF_TIMES = ("_ms", "_per_s")
#: What `Material` has to hold for a command.
EPISODE, FRAMES, LINKS, LOG, SHARED = "episode", "frames", "links", "log", "shared"
_QUICK = "--physics kinematic --mapper classical --link-states true --max-steps 10"


@dataclass(frozen=True)
class Command:
    """A command of `robosim`."""

    words: str
    """What is typed, with places of the plan and of other material."""
    goes_on: bool = True
    """Whether it goes on where it was stopped; otherwise it begins again."""
    workers: bool = False
    """Whether it works with processes of its own."""
    keeps: tuple[str, ...] = ()
    """Files that are there after Ctrl-C and SIGTERM too."""
    needs: tuple[str, ...] = ()
    """Material."""
    differ: tuple[str, ...] = field(default=("*.png", "*.html", "timing.parquet", "*.mp4"))
    """Files that may differ from run to run, since times or dates are in them."""


COMMANDS = {
    "episode": Command(
        f"episode {{plan}} --goal explore --seed 1 {_QUICK}",
        goes_on=False,
        keeps=("result.json", "trajectory.tum", "map.yaml", "episode.npz"),
    ),
    "replay": Command("replay {episode}", goes_on=False, needs=(EPISODE,)),
    "plan": Command("plan {plan}", goes_on=False),
    "calibrate": Command("calibrate --runs 2000 --physics kinematic", goes_on=False),
    "slam": Command("slam {log}", goes_on=False, needs=(LOG,)),
    "generate": Command("generate --count 3 --seed 4", goes_on=False),
    "trace": Command("trace {plan} --tx 1,1 --tx 4,2 --grid 0.3 --workers 2 --no-plots", workers=True),
    "dataset": Command(
        "dataset {plan} --tx-per-plan 4 --grid 0.6 --estimator pca --format mmwrobotnav --format deepmimo --workers 2",
        workers=True,
    ),
    "collect": Command("collect --homes 4 --steps 5 --workers 2", workers=True),
    "evaluate": Command(
        f"evaluate {{plan}} --targets 2 --policies explore --workers 2 {_QUICK}",
        workers=True,
        # A suite names its plans from where it lies.
        differ=("*.png", "*.html", "timing.parquet", "suite.yaml"),
    ),
    "train link-state": Command(
        "train link-state --data {links} --epochs 4 --folds 1 --n-folds 2 --workers 2",
        workers=True,
        needs=(LINKS,),
    ),
    "train mapper": Command(
        "train mapper --data {frames} --steps 20 --batch 4 --widths 4 8 --threads 1", needs=(FRAMES,)
    ),
    "train explorer": Command(
        "train explorer --rounds 2 --homes 2 --decisions 6 --held-out 1 --workers 2", workers=True
    ),
}


def contents(folder: Path, command: Command) -> dict[str, Any]:
    """All that a command left, as it can be compared: files by name, without times."""
    found: dict[str, Any] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_dir():
            continue
        name = path.relative_to(folder).as_posix()
        if any(path.match(pattern) for pattern in command.differ):
            found[name] = "there"
        elif path.suffix == ".json":
            found[name] = _without_times(json.loads(path.read_text()))
        elif path.suffix == ".npz":
            with np.load(path) as file:
                found[name] = {key: _without_times_in(file[key]) for key in file.files}
        elif path.suffix == ".pt":
            found[name] = "there"
        else:
            found[name] = path.read_bytes()
    return found


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {
            key: _without_times(item)
            for key, item in value.items()
            if key not in TIMES and not key.endswith(OF_TIMES)
        }
    return [_without_times(item) for item in value] if isinstance(value, list) else value


def _without_times_in(array: np.ndarray) -> Any:
    """An array as it can be compared; a head in JSON loses its times."""
    if array.dtype.kind == "U" and array.ndim == 0 and str(array)[:1] == "{":
        return _without_times(json.loads(str(array)))
    return array.dtype.str, array.shape, array.tobytes()


def copied(folder: Path, to: Path) -> Path:
    """A copy of a folder, for a command that writes into it."""
    shutil.copytree(folder, to)
    return to
