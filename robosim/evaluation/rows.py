"""Episodes of an evaluation as read from their files, with checks of the row that each adds to the table."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from robosim.recording.episode_file import Head, RecordedEpisode, read_episode, read_head

#: Columns that are looked at by name. All others are numbers, or null where there is none.
_TEXT, _WHOLE = ("plan", "policy", "ended"), ("task", "repeat", "seed", "steps", "collisions")
_NUMBERS = (
    "spl", "shortest_m", "final_distance_m", "path_length_m", "coverage", "deepest_penetration_m",
    "deepest_by_distance_m", "position_error_rms_m",
)  # fmt: skip
_PLACES = {"start": 3, "target": 2}
#: Whole numbers up to here are distinct in floating-point columns.
_LARGEST = 1e15


def name_of(row: Mapping[str, Any]) -> str:
    """What an episode's file is called, unique in an evaluation: PLAN/TASK-POLICY-REPEAT.

    A policy that is a file lies in folders of its own, which are no folders of the evaluation.
    """
    policy = str(row["policy"]).replace("/", "_").replace("\\", "_")
    return f"{row['plan']}/{row['task']:03d}-{policy}-{row['repeat']}"


def read_job_head(path: Path) -> Head:
    """Read the result of an episode; FileError if the file is damaged, or another than its name says."""
    return read_head(path, lambda head: _check(head, path))


def read_job_episode(path: Path) -> RecordedEpisode:
    """Read an episode; errors as in `read_job_head`."""
    return read_episode(path, lambda head: _check(head, path))


def _check(head: Head, path: Path) -> None:
    check_row(head.row)
    if name_of(head.row) != f"{path.parent.name}/{path.stem}":
        raise ValueError(f"it is the episode {name_of(head.row)[:80]}, not that of its name")


def check_row(row: Mapping[str, Any]) -> None:
    """Raise ValueError for the first column of a row that no episode has."""
    at, found = row.get("arrived_at_step"), row.get("transmitter")
    good = {
        **{name: isinstance(row.get(name), str) for name in _TEXT},
        **{name: _is_whole(row.get(name)) for name in _WHOLE},
        "arrived": isinstance(row.get("arrived"), bool) and row["arrived"] == (at is not None),
        "arrived_at_step": "arrived_at_step" in row and (at is None or _is_whole(at)),
        **{name: is_number(row.get(name)) for name in _NUMBERS},
        **{name: _is_place(row.get(name), length) for name, length in _PLACES.items()},
        "transmitter": found is None or _is_place(found, 2),
    }
    good |= {name: value is None or is_number(value) for name, value in row.items() if name not in good}
    for name, fine in good.items():
        if not fine:
            raise ValueError(f"{name} of the episode is {str(row.get(name))[:80]!r}")


def is_number(value: Any) -> bool:
    """Whether a value of JSON is a number that a table can hold."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= _LARGEST


def _is_whole(value: Any) -> bool:
    return is_number(value) and isinstance(value, int) and value >= 0


def _is_place(value: Any, length: int) -> bool:
    return isinstance(value, list) and len(value) == length and all(map(is_number, value))
