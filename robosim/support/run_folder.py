"""Folders of results: their command, their settings, and a lock.

Every command that writes into a folder claims it. `settings.json` names the command, and for runs that resume all that
their results depend on: other settings are not mixed in. One process is at work in a folder at a time. Partial files of
a killed one are removed.
"""

import contextlib
import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from robosim.support.files import plain, remove_partials, write_json
from robosim.support.reading import FileError, one_line, shown
from robosim.support.text_in import read_json

SETTINGS = "settings.json"
#: 1 kB for each building of a data set with ten transmitters.
_MOST_SETTINGS = 500_000_000


class FolderError(ValueError):
    """A folder that cannot be written to, holds something else, or is in use."""


@contextmanager
def run_folder(
    folder: Path, command: str, settings: Mapping[str, Any] | None = None, *, grows: tuple[str, ...] = ()
) -> Iterator[Path]:
    """Work in a folder alone; it is made if it is missing, and removed again if it stays empty.

    `settings` hold everything that results depend on, if the run resumes. `grows` names settings that are dictionaries
    to which a later run may add keys, or of which it may need only some.

    Raises:
        FolderError: If the folder cannot be used, is in use, or holds results of another command or of other settings.
    """
    folder = Path(folder)
    check_folder(folder, command)
    made = _make(folder)
    with _alone(folder):
        try:
            ours = (folder / SETTINGS).exists()
            before = set() if ours else set(_results(folder))
            if _stored(folder) is not None:
                remove_partials(folder)
            _settle(folder, command, settings, grows)
            try:
                yield folder
            except BaseException:
                if not ours and set(_results(folder)) == before:
                    (folder / SETTINGS).unlink(missing_ok=True)  # a user's folder stays as it was
                raise
        finally:
            if not _holds_results(folder):
                (folder / SETTINGS).unlink(missing_ok=True)
                for empty in made:
                    _remove_empty(empty)


def check_folder(folder: Path, command: str) -> None:
    """Raise FolderError if a command cannot write its results into a folder; nothing is changed."""
    folder = Path(folder)
    at = folder
    while not _exists(at):
        at = at.parent
    if not at.is_dir():
        raise FolderError(f"out is {str(folder)!r}, but {str(at)!r} is no folder. Choose another.")
    if not os.access(at, os.W_OK | os.X_OK):
        raise FolderError(f"out is {str(folder)!r}, but you may not write to {str(at)!r}. Choose another.")
    there = _stored(folder)
    if there is not None and there["command"] != command and _holds_results(folder):
        raise FolderError(
            f"out is {str(folder)!r}, which holds the results of `robosim {one_line(there['command'], 80)}`. "
            f"Choose another folder for `robosim {command}`."
        )


def _exists(path: Path) -> bool:
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError as error:
        raise FolderError(
            f"out is {str(path)[:200]!r}, which cannot be a folder ({error.strerror}). Choose another."
        ) from error
    return True


def _make(folder: Path) -> list[Path]:
    """Make a folder if it is missing; it and those above it that were missing too, itself first."""
    missing = [at for at in (folder, *folder.parents) if not at.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        for at in missing:
            _remove_empty(at)
        raise FolderError(
            f"out is {str(folder)!r}, which cannot be made ({error.strerror}). Choose another."
        ) from error
    return missing


def _remove_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):  # something else lies there by now
        folder.rmdir()


def _settle(folder: Path, command: str, settings: Mapping[str, Any] | None, grows: tuple[str, ...]) -> None:
    """Note command and settings, or find the same ones."""
    now: dict[str, Any] = json.loads(json.dumps(plain(dict(settings or {})), allow_nan=False))
    there = _stored(folder)
    if there is None and (folder / SETTINGS).exists():
        raise FolderError(
            f"{folder / SETTINGS}: does not say of which command and settings the files next to it are. Choose another "
            "folder, or empty this one."
        )
    if there is not None and settings is not None and _holds_results(folder):
        before = there["settings"]
        if difference := _difference(before, now, grows):
            raise FolderError(
                f"{shown(folder)} holds results of other settings: {one_line(difference, 400)}. Choose another folder, "
                "or the same settings."
            )
        for name in grows:
            now[name] = {**before.get(name, {}), **now[name]}
    if there is None or there["settings"] != now or there["command"] != command:
        write_json(folder / SETTINGS, {"command": command, "settings": now})


def _stored(folder: Path) -> dict[str, Any] | None:
    """Return the content of `settings.json`, if this package wrote it."""
    try:
        keys = ("command", "settings")
        there = read_json(folder / SETTINGS, "settings", keys=keys, most_bytes=_MOST_SETTINGS)
        return there if isinstance(there["command"], str) and isinstance(there["settings"], dict) else None
    except FileError:
        return None


def _holds_results(folder: Path) -> bool:
    """Whether there is any file but the settings."""
    return next(_results(folder), None) is not None


def _results(folder: Path) -> Iterator[Path]:
    """Files but the settings.

    Hidden ones are not yet whole; folders inside that were claimed by others are their own.
    """
    for root, folders, files in os.walk(folder):
        if SETTINGS in files and Path(root) != folder:
            folders.clear()
            continue
        for name in files:
            if not name.startswith(".") and name != SETTINGS:
                yield Path(root) / name
        folders[:] = [name for name in folders if not name.startswith(".")]


def _difference(there: Any, now: Any, grows: tuple[str, ...] = (), name: str = "") -> str:
    """Return the differences, by the names of the innermost settings; empty if there are none."""
    if isinstance(there, dict) and isinstance(now, dict):
        parts = []
        for key in {**there, **now}:
            if name.split(".")[0] in grows and not (key in there and key in now):
                continue
            path = f"{name}.{key}" if name else str(key)
            parts.append(_difference(there.get(key), now.get(key), grows, path))
        return ", ".join(text for text in parts if text)
    return "" if there == now else f"{name} {_short(there)} there, {_short(now)} now"


def _short(value: Any) -> str:
    """A value, or how many there are of a long list."""
    return f"{len(value)} of them" if isinstance(value, list) and len(str(value)) > 80 else str(value)[:80]


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep other processes out of a folder, where its file system can."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise FolderError(
                f"Another process is at work in {shown(folder)}. Wait for it, or choose another folder."
            ) from None
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(handle)
