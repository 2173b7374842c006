"""A search as the page shows it: its steps so far, from a running process or from a recorded episode."""

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.recording.episode_file import RecordedEpisode
from robosim.recording.step_codec import decode_belief, decode_map, decode_step
from robosim.step import Step


@dataclass(eq=False)
class Recording:
    """Steps in the order in which they come; encoded, since a thousand of them must fit into memory."""

    title: str
    """Plan and policy, or who drives."""
    rings: Sequence[Float[np.ndarray, "_ 2"]]
    """Outlines of the building's free space [m]."""
    target: Float[np.ndarray, "2"] | None
    """Position of the target [m]; None if it is not searched for."""
    height_m: float = 2.5
    """Height of the walls."""
    ended: str = ""
    """How it ended; empty while it runs."""
    _rows: list[Mapping[str, Any]] = field(default_factory=list)
    _lines: list[tuple[float, ...]] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __len__(self) -> int:
        with self._lock:
            return len(self._rows)

    def __getitem__(self, number: int) -> Step:
        with self._lock:
            row = self._rows[number]
        map_ = decode_map(row, None)
        assert map_ is not None  # each row has its whole map
        return decode_step(number, row, map_, decode_belief(row, None))

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
        """True and estimated positions of the first steps [m].

        Args:
            count: How many.
        """
        table = self._table()[:count]
        return table[:, 3:5], table[:, 5:]

    def _table(self) -> Float[np.ndarray, "n 7"]:
        with self._lock:
            return np.array(self._lines, float).reshape(-1, 7)


def recording_of(episode: RecordedEpisode, title: str) -> Recording:
    """All of a recorded episode.

    Raises:
        FileError: If a step is damaged.
        ValueError: If it holds no decision.
    """
    if not len(episode):
        where = episode.path.parent if episode.has_pictures else episode.path
        raise ValueError(f"{where}: the episode ended where it began, without a decision to show.")
    head = episode.head
    target = episode.target if head.seeks_target else None
    recording = Recording(title, episode.rings, target, ended=str(head.row["ended"])[:40])
    for row in episode.rows():
        recording.add(row)
    return recording
