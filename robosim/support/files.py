"""Files that appear whole or not at all.

A file is written next to its place under a hidden name, `.NAME.partial-PID.SUFFIX`. It takes its own name when it is
whole, and is removed after an error. A killed process leaves it, and the next command in that folder removes it
(`robosim.support.run_folder`).
"""

import io
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary path next to `path` to write to; it takes that name when the block ends without an error."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = partial_path(path)
    try:
        with disk_errors(path):
            yield partial
            os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A temporary folder that takes the place of `path` when the block ends without an error."""
    path = Path(path)
    partial = partial_path(path)
    shutil.rmtree(partial, ignore_errors=True)
    try:
        with disk_errors(path):
            partial.mkdir(parents=True)
            yield partial
            shutil.rmtree(path, ignore_errors=True)
            os.replace(partial, path)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Errors of the disk inside the block name the file, which the error of a full disk does not do by itself."""
    try:
        yield
    except OSError as error:
        if error.errno is not None and str(error.filename) in ("None", str(partial_path(path))):
            error.filename = str(path)
        raise


def partial_path(path: Path) -> Path:
    """Where a file or folder lies as long as it is not whole."""
    # The suffix stays last, since writers of images and videos choose the format by it.
    return path.with_name(f".{path.stem}.partial-{os.getpid()}{path.suffix}")


def remove_partials(folder: Path) -> None:
    """Remove partial files of killed processes in a folder and those below; no other process may work there."""
    for left in list(folder.rglob(".*.partial-*")):
        if left.is_dir() and not left.is_symlink():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file of some bytes."""
    with whole_file(path) as partial:
        partial.write_bytes(content)


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder, each whole, in their order; names may have folders in them."""
    for name, content in files.items():
        write_whole(folder / name, content)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a dictionary as indented JSON; not-a-number becomes null, which all readers take."""
    write_whole(path, json_bytes(content))


def json_bytes(content: dict[str, Any]) -> bytes:
    """A dictionary as indented JSON; not-a-number becomes null, which all readers take."""
    return (json.dumps(plain(content), indent=2, allow_nan=False) + "\n").encode()


def npz_bytes(arrays: Mapping[str, Any], *, compressed: bool = True) -> bytes:
    """Arrays as a NumPy archive, the same bytes for the same arrays."""
    buffer = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(buffer, **arrays)
    return buffer.getvalue()


def plain(value: Any) -> Any:
    """Convert a value to JSON's own types; not-a-number becomes None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and value != value:
        return None
    if isinstance(value, (str, int, float, bool)) or value is None:
        return value
    return str(value)
