"""Recorded searches: the folder of one episode, or of an evaluation with many.

Only files of the given folder are read; no plan is needed, and nothing is simulated.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.drawing.snapshot import Layer, Snapshot
from robosim.evaluation.episode_file import Episode, read_episode, read_head
from robosim.live.moments import Moment, Recording
from robosim.recording.decision_log import DECISIONS, DecisionLog, read_decisions
from robosim.support.reading import FileError, one_line
from robosim.support.text_in import read_json
from slam.grid import GridFrame
from wireless.paths import LinkState

EPISODES = "episodes"


def is_episode(folder: Path) -> bool:
    """Whether a folder is that of an episode."""
    return (Path(folder) / DECISIONS).is_file()


def is_evaluation(folder: Path) -> bool:
    """Whether a folder is that of an evaluation."""
    return (Path(folder) / EPISODES).is_dir()


def check_results(folder: Path) -> None:
    """Raise ValueError for a folder without a recorded search.

    Raises:
        ValueError: If it holds neither an episode nor an evaluation.
    """
    if not (is_episode(folder) or is_evaluation(folder)):
        raise ValueError(
            f"{folder}: neither an episode ({DECISIONS}) nor an evaluation ({EPISODES}/). Give a floor plan, or a "
            "folder of `robosim episode` or `robosim evaluate`."
        )


def read_recording(folder: Path) -> Recording:
    """All of an episode, from its log alone.

    Raises:
        FileError: If the log is damaged; the message names the file and the fix.
        ValueError: If it holds no decision.
    """
    log = read_decisions(folder)
    if not len(log):
        raise ValueError(f"{folder}: the episode ended where it began, without a decision to show.")
    recording = Recording(_title(folder), log.rings, log.target, ended=_ended(folder))
    for moment in _moments(log):
        recording.add(moment)
    return recording


def _moments(log: DecisionLog) -> Iterator[Moment]:
    for snapshot in log.snapshots():
        yield Moment.of(snapshot, seeks_target=log.seeks_target)


def _result(folder: Path) -> Mapping[str, Any]:
    """The episode's `result.json`; empty if that is missing or damaged, since the log suffices."""
    try:
        return read_json(Path(folder) / "result.json", "the result of an episode")
    except FileError:
        return {}


def _title(folder: Path) -> str:
    result = _result(folder)
    words = [one_line(str(result[name]), 40) for name in ("goal", "plan") if name in result]
    return ", ".join(words) or Path(folder).resolve().name


def _ended(folder: Path) -> str:
    return one_line(str(_result(folder).get("ended", "recorded")), 40)


@dataclass(frozen=True, eq=False)
class Searched:
    """A task of an evaluation, by one policy."""

    row: Mapping[str, Any]
    """Identity and scores."""
    path: Path
    """Its file."""
    slower: float
    """Its steps over those of the fastest policy on the same task; infinite if another arrived and it did not, NaN if
    nobody did."""


def read_searches(folder: Path) -> list[Searched]:
    """The episodes of an evaluation: failures first, then those that took longest beside others on the same task.

    Raises:
        FileError: If one is damaged.
        ValueError: If there is none.
    """
    files = sorted((Path(folder) / EPISODES).glob("*/*.npz"))
    if not files:
        raise ValueError(f"{folder}: no episode is finished yet. Let `robosim evaluate` go on.")
    rows = [(read_head(path).row, path) for path in files]
    fastest: dict[tuple[Any, ...], float] = {}
    for row, _ in rows:
        task = _task(row)
        fastest[task] = min(fastest.get(task, np.inf), _steps(row))
    found = [Searched(row, path, _times(_steps(row), fastest[_task(row)])) for row, path in rows]
    # What another policy could do is told before what nobody could.
    return sorted(
        found, key=lambda one: (one.row["arrived"], -1.0 if math.isnan(one.slower) else -one.slower, one.path)
    )


def _task(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["plan"], row["task"], row["repeat"]


def _steps(row: Mapping[str, Any]) -> float:
    return float(row["arrived_at_step"]) if row["arrived"] else np.inf


def _times(steps: float, fastest: float) -> float:
    if np.isinf(fastest):
        return math.nan
    return steps / max(fastest, 1.0)


def recording_of(searched: Searched) -> Recording:
    """An episode of an evaluation: its ways, goals and link states, on the map that its robot had in the end.

    Raises:
        FileError: If the file is damaged.
    """
    episode = read_episode(searched.path)
    row = searched.row
    frame = GridFrame(
        origin_xy=(float(episode.built_frame[0]), float(episode.built_frame[1])),
        resolution_m=float(episode.built_frame[2]),
        shape=(max(episode.built.shape[0], 1), max(episode.built.shape[1], 1)),
    )
    built = Layer(frame, episode.built if episode.built.size else np.zeros((1, 1), np.uint8))
    title = f"{row['policy']}, {row['plan']}, task {row['task']}"
    recording = Recording(
        title, episode.rings or [_box(frame)], np.array(row["target"], float), ended=str(row["ended"])
    )
    for i in range(len(episode.goals)):
        recording.add(_moment(episode, i, built))
    if not len(episode.goals):
        raise ValueError(f"{searched.path}: the episode ended where it began, without a decision to show.")
    return recording


def _moment(episode: Episode, i: int, built: Layer) -> Moment:
    blank = np.full((1, 1, 3), 235, np.uint8)
    snapshot = Snapshot(
        rgb=blank,
        depth_mm=np.zeros((1, 1), np.uint16),
        pose=episode.poses[i].astype(float),
        estimate=episode.estimates[i].astype(float),
        built=built,
        goal=episode.goals[i].astype(float),
        text=f"step {i}",
        reason=episode.reasons[i],
        decisions=float(episode.decisions[i]),
    )
    more: dict[str, Any] = {"coverage": float(episode.coverage[i])}
    more["seeks_target"] = episode.head.row["policy"] != "explore"
    if i < len(episode.links):
        true, believed, snr_db, _ = episode.links[i]
        more |= {"true_state": LinkState(int(true)), "believed_state": LinkState(int(believed))}
        if np.isfinite(snr_db):
            more["snr_db"] = float(snr_db)
    return Moment(snapshot=snapshot, **more)


def _box(frame: GridFrame) -> Float[np.ndarray, "4 2"]:
    """Outline of a map [m], for an episode of version 0.1, which keeps no walls."""
    rows, columns = frame.shape
    return frame.to_points(np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], float))
