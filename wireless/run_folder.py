"""Folders that long runs write into, and go on in after an interruption.

A folder belongs to one set of settings, which `settings.json` holds: what was written with others is not mixed in.
One process is at work in it at a time. Files appear whole or not at all.
"""

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

SETTINGS = "settings.json"


class DatasetError(ValueError):
    """A folder that holds something else, or is in use."""


def claim(folder: Path, settings: dict[str, Any], *, begun: bool) -> None:
    """Note the settings in a folder, or find the same ones there.

    Args:
        folder: The folder.
        settings: All that results depend on, in JSON's own types.
        begun: Whether the folder holds results of this kind; settings beside other files bind all the same.

    Raises:
        DatasetError: If it holds results of other ones.
    """
    path = folder / SETTINGS
    if begun or (path.exists() and _holds_more(folder)):
        try:
            there = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            raise DatasetError(
                f"{folder} holds results, but no readable {SETTINGS} that says of what. Use another folder, or "
                "empty it."
            ) from None
        if there != settings:
            raise DatasetError(
                f"{folder} holds results of other settings: {_difference(there, settings)}. Use another folder, or "
                "the same settings."
            )
        return
    with whole(path) as partial:
        partial.write_text(json.dumps(settings, indent=2) + "\n", encoding="utf-8")


def _holds_more(folder: Path) -> bool:
    """Whether there is any file but the settings; hidden ones are locks and files not yet whole."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return any(path.name != SETTINGS and not path.name.startswith(".") for path in files)


def _difference(there: Any, now: Any, name: str = "") -> str:
    """What differs, by the names of the innermost settings."""
    if isinstance(there, dict) and isinstance(now, dict):
        parts = [
            _difference(there.get(key), now.get(key), str(key))
            for key in {**there, **now}
            if there.get(key) != now.get(key)
        ]
        return ", ".join(parts)
    return f"{name} {_short(there)} there, {_short(now)} now"


def _short(value: Any) -> str:
    """A value, or how many there are of a long list."""
    return f"{len(value)} of them" if isinstance(value, list) and len(str(value)) > 80 else str(value)


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A temporary path that takes its name when the block ends without an error."""
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Keep other processes out of a folder.

    Raises:
        DatasetError: If one is at work there.
    """
    lock = folder / ".lock"
    with lock.open("w") as handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise DatasetError(
                f"Another process is at work in {folder}. Wait for it, or use another folder."
            ) from None
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)
