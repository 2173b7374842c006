"""The bytes of a floor plan's file, or one sentence on why there are none."""

from pathlib import Path

from robosim.floorplan import MapError

#: Larger files are not floor plans; reading them whole would only exhaust the memory [bytes].
MAX_BYTES = 2_000_000_000


def read_plan_bytes(path: Path, what: str = "floor plan", max_bytes: int = MAX_BYTES) -> bytes:
    """Content of a regular, not empty file.

    Args:
        path: The file.
        what: What it is, for the message.
        max_bytes: Size above which it is refused.

    Raises:
        MapError: If it is missing, a folder or a device, unreadable, empty or too large.
    """
    try:
        if path.is_dir():
            raise MapError(f"{path}: is a folder, expected the file of a {what}.")
        if not path.is_file():
            raise MapError(f"{path}: no such file, expected a {what}. Check the spelling and the folder.")
        size = path.stat().st_size
        if size > max_bytes:
            raise MapError(f"{path}: {size} bytes, expected at most {max_bytes} for a {what}.")
        content = path.read_bytes()
    except OSError as error:
        raise MapError(f"{path}: cannot read this {what}: {error.strerror or error}.") from error
    if not content:
        raise MapError(f"{path}: the file is empty, expected a {what}. Copy or export it again.")
    return content
