"""What every file that this package reads goes through: whatever is wrong with it leaves as one line with its name."""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

#: Larger files are treated as mistakes unless their reader sets another limit [bytes].
MOST_BYTES = 200_000_000


class DataError(ValueError):
    """A file that cannot be used; the message names it, what is wrong and what to do."""


@contextmanager
def reading(path: Path, what: str, remedy: str, *, most_bytes: int = MOST_BYTES) -> Iterator[BinaryIO]:
    """A regular file, open for as long as the block lasts, which is where it is taken apart and checked.

    Args:
        path: The file.
        what: What it should hold, with its article: "links".
        remedy: What to do about a damaged one: a sentence.
        most_bytes: Size above which it is rejected.

    Raises:
        DataError: For whatever goes wrong, in one line; a ValueError raised inside becomes its reason.
    """
    try:
        with open(_opened(path, most_bytes), "rb") as file:
            yield file
    except DataError:
        raise
    except Exception as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        line = "".join(c if c.isprintable() else " " for c in reason)[:300]
        missing = " is missing" if isinstance(error, KeyError) else ""
        name = str(path) if str(path).isprintable() else repr(str(path))
        message = f"{name}: not readable as {what} ({' '.join(line.split())}{missing}). {remedy}"
        raise DataError(message) from error


def _opened(path: Path, most_bytes: int) -> int:
    """Number of the open file; a pipe is not waited for, and a device is not read."""
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    found = os.fstat(number)
    if stat.S_ISREG(found.st_mode) and found.st_size <= most_bytes:
        return number
    os.close(number)
    raise ValueError(
        f"{found.st_size} bytes, expected at most {most_bytes}"
        if stat.S_ISREG(found.st_mode)
        else "it is no regular file"
    )
