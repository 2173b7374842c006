"""Recorded searches on disk: the folder of an episode, or of an evaluation with many.

Only files in the given folder are read; no plan is needed, and nothing is simulated.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robosim.evaluation.rows import read_job_episode, read_job_head
from robosim.live.recording import Recording, recording_of
from robosim.recording.episode_file import EPISODE, read_episode

EPISODES = "episodes"


def is_episode(folder: Path) -> bool:
    """Whether a folder is that of an episode, of this version or an earlier one."""
    return any((Path(folder) / name).is_file() for name in (EPISODE, "decisions.npz"))


def check_results(folder: Path) -> None:
    """Check that a folder holds something to show.

    Raises:
        ValueError: If it does not.
    """
    if not (is_episode(folder) or (Path(folder) / EPISODES).is_dir()):
        raise ValueError(
            f"{folder}: neither an episode ({EPISODE}) nor an evaluation ({EPISODES}/). Give a floor plan, or a "
            "folder of `robosim episode` or `robosim evaluate`."
        )


def read_recording(folder: Path) -> Recording:
    """The episode of a folder.

    Raises:
        FileError: If the file is damaged; the message names the file and the fix.
        ValueError: If it holds no decision.
    """
    episode = read_episode(Path(folder))
    row = episode.head.row
    return recording_of(episode, f"{str(row['policy'])[:40]}, {str(row['plan'])[:40]}")


@dataclass(frozen=True, eq=False)
class Searched:
    """A task of an evaluation, by one policy."""

    row: Mapping[str, Any]
    """Identity and scores."""
    path: Path
    """Its file."""
    slower: float
    """Its steps over those of the fastest policy on the same task; infinite if only others arrived, NaN if none."""

    def read(self) -> Recording:
        """Its episode, on the map that the robot had in the end.

        Raises:
            FileError: If the file is damaged.
            ValueError: If it holds no decision.
        """
        row = self.row
        return recording_of(
            read_job_episode(self.path), f"{row['policy']}, {row['plan']}, task {row['task']}"
        )


def read_searches(folder: Path) -> list[Searched]:
    """The episodes of an evaluation: failures first, then those slowest relative to other policies on the same task.

    Raises:
        FileError: If one is damaged.
        ValueError: If there is none.
    """
    files = sorted((Path(folder) / EPISODES).glob("*/*.npz"))
    if not files:
        raise ValueError(f"{folder}: no episode is finished yet. Let `robosim evaluate` go on.")
    rows = [(read_job_head(path).row, path) for path in files]
    fastest: dict[tuple[Any, ...], float] = {}
    for row, _ in rows:
        fastest[_task(row)] = min(fastest.get(_task(row), math.inf), _steps(row))
    searches = [Searched(row, path, _relative(_steps(row), fastest[_task(row)])) for row, path in rows]
    # Tasks that another policy could do come before those that none could do.
    return sorted(
        searches,
        key=lambda one: (one.row["arrived"], 1.0 if math.isnan(one.slower) else -one.slower, one.path),
    )


def _task(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["plan"], row["task"], row["repeat"]


def _steps(row: Mapping[str, Any]) -> float:
    return float(row["arrived_at_step"]) if row["arrived"] else math.inf


def _relative(steps: float, fastest: float) -> float:
    return math.nan if math.isinf(fastest) else steps / max(fastest, 1.0)
