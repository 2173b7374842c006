"""Searches as the page shows them: their steps, from a running process or from the folder of an episode or evaluation.

Only files of the folder are read; no plan is needed, and nothing is simulated.
"""

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.evaluation.episodes import read_job_episode, read_job_head
from robosim.evaluation.search_scores import steps_to_arrival
from robosim.recording.episode_file import EPISODE, RecordedEpisode, read_team, robots_of_team
from robosim.recording.step_codec import decode_belief, decode_map, decode_step
from robosim.step import Step

EPISODES = "episodes"


@dataclass(eq=False)
class Recording:
    """Steps in order, encoded so that thousands fit into memory."""

    title: str
    """Policy and plan."""
    rings: Sequence[Float[np.ndarray, "_ 2"]]
    """Outlines of the building's free space [m]."""
    target: Float[np.ndarray, "2"] | None
    """Position of the target [m]; None without one."""
    height_m: float = 2.5
    """Height of the walls."""
    ended: str = ""
    """How it ended; empty while it runs."""
    robot: str = ""
    """Name of the robot in its team; empty alone."""
    mates: Sequence["Recording"] = ()
    """Recordings of the other robots of the team."""
    _rows: list[Mapping[str, Any]] = field(default_factory=list)
    _lines: list[tuple[float, ...]] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def robots(self) -> list["Recording"]:
        """This robot and the others of its team."""
        return [self, *self.mates]

    @property
    def outcome(self) -> str:
        """How the robot that arrived, or else the first one that was not lost, ended; empty while the search runs."""
        ends = [robot.ended for robot in self.robots]
        return min(ends, key=lambda ended: (not ended.startswith("arrived"), ended.startswith("lost")))

    def __len__(self) -> int:
        with self._lock:
            return len(self._rows)

    def __getitem__(self, number: int) -> Step:
        with self._lock:
            row = self._rows[number]
        layer = decode_map(row, None)
        assert layer is not None  # each row has its whole map
        return decode_step(number, row, layer, decode_belief(row, None))

    def add(self, row: Mapping[str, Any]) -> None:
        """Append a step, as encoded by `encode_step`."""
        snr_db = row["arrival"][0, 2] if len(row["arrival"]) else np.nan
        probability = row["state_probability"]
        state = np.nan if np.isnan(probability).any() else float(np.argmax(probability))
        error_cm = 100 * np.hypot(*(row["estimate"] - row["pose"])[:2])
        with self._lock:
            self._rows.append(row)
            self._lines.append((snr_db, state, error_cm, *row["pose"][:2], *row["estimate"][:2]))

    def time_lines(self) -> Float[np.ndarray, "n 3"]:
        """SNR [dB], estimated link state and position error [cm] at each step; NaN where unknown."""
        return self._table()[:, :3]

    def trajectories(self, count: int) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
        """True and estimated positions of the first steps [m]."""
        table = self._table()[:count]
        return table[:, 3:5], table[:, 5:]

    def _table(self) -> Float[np.ndarray, "n 7"]:
        with self._lock:
            return np.array(self._lines, float).reshape(-1, 7)


def is_episode(folder: Path) -> bool:
    """Whether a folder is that of an episode, of one robot or of a team."""
    return (Path(folder) / EPISODE).is_file() or bool(robots_of_team(Path(folder)))


def check_results(folder: Path) -> None:
    """Check that a folder is that of an episode or an evaluation; ValueError if it is not."""
    if not (is_episode(folder) or (Path(folder) / EPISODES).is_dir()):
        raise ValueError(
            f"{folder}: neither an episode ({EPISODE}) nor an evaluation ({EPISODES}/). Give a floor plan, or a "
            "folder of `robosim episode` or `robosim evaluate`."
        )


def read_recording(folder: Path) -> Recording:
    """The episode of a folder; that of a team is the recording of the first robot with those of the others.

    Raises:
        FileError: If the file is damaged; the message names the file and the remedy.
        ValueError: If it has no steps.
    """
    recordings = []
    for name, episode in read_team(Path(folder)).items():
        row = episode.head.row
        recordings.append(_make_recording(episode, f"{str(row['policy'])[:40]}, {str(row['plan'])[:40]}"))
        recordings[-1].robot = name
    recordings[0].mates = recordings[1:]
    return recordings[0]


@dataclass(frozen=True, eq=False)
class EvaluatedEpisode:
    """An episode of an evaluation."""

    row: Mapping[str, Any]
    """Identity and scores."""
    path: Path
    relative_steps: float
    """Its steps over those of the fastest policy on the same task; infinite if only others arrived, NaN if none."""

    def read(self) -> Recording:
        """Its steps, on the final map of the robot.

        Raises:
            FileError: If the file is damaged.
            ValueError: If it has no steps.
        """
        row = self.row
        title = f"{row['policy']}, {row['plan']}, task {row['task']}"
        return _make_recording(read_job_episode(self.path), title)


def read_evaluation(folder: Path) -> list[EvaluatedEpisode]:
    """The episodes of an evaluation: failures first, then those slowest relative to other policies on the same task.

    Raises:
        FileError: If a file is damaged.
        ValueError: If there is no episode.
    """
    files = sorted((Path(folder) / EPISODES).glob("*/*.npz"))
    if not files:
        raise ValueError(f"{folder}: no episode is finished yet. Continue `robosim evaluate`.")
    rows = [(read_job_head(path).row, path) for path in files]
    fastest: dict[tuple[Any, ...], float] = {}
    for row, _ in rows:
        fastest[_task(row)] = min(fastest.get(_task(row), math.inf), steps_to_arrival(row))
    episodes = []
    for row, path in rows:
        least = fastest[_task(row)]
        relative = math.nan if math.isinf(least) else steps_to_arrival(row) / max(least, 1.0)
        episodes.append(EvaluatedEpisode(row, path, relative))
    # Tasks that another policy completed come before those that none did.
    return sorted(
        episodes,
        key=lambda episode: (
            episode.row["arrived"],
            1.0 if math.isnan(episode.relative_steps) else -episode.relative_steps,
            episode.path,
        ),
    )


def _task(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["plan"], row["task"], row["repeat"]


def _make_recording(episode: RecordedEpisode, title: str) -> Recording:
    if not len(episode):
        where = episode.path.parent if episode.has_pictures else episode.path
        raise ValueError(f"{where}: the episode ended at its start, without a step to show.")
    head = episode.head
    target = episode.target if head.seeks_target else None
    recording = Recording(title, episode.rings, target, ended=str(head.row["ended"])[:40])
    for row in episode.rows():
        recording.add(row)
    return recording
