"""Opens every file of a user.

Within `reading`, each error of a damaged file becomes one line that names the file, what is wrong and what would be
right; the library's error is its cause. Folders, pipes, devices, dangling links and very large files are rejected
before they are opened. `robosim.support.text_in` and `arrays_in` bound size and content.
"""

import logging
import os
import stat
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

#: Larger files are rejected unless their reader says otherwise [bytes].
MOST_BYTES = 200_000_000
#: Letters of a path, of a library's message, and of a whole message.
_PATH, _REASON, _MESSAGE = 400, 300, 2000
_COPY = "Copy or export it again."
#: Libraries whose warnings of a damaged file would be printed in addition to our line.
_TALKATIVE = ("trimesh", "PIL")
#: Packages of this project.
PACKAGES = ("robosim", "slam", "wireless")
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


class FileError(ValueError):
    """A file that cannot be used; the message is one line with its name, what is wrong and what would be right."""

    file: Path | None = None
    """The file, once the error has passed the boundary."""


@contextmanager
def reading(
    path: str | Path,
    what: str,
    remedy: str = _COPY,
    *,
    most_bytes: int = MOST_BYTES,
    kind: type[FileError] = FileError,
) -> Iterator[BinaryIO]:
    """A regular file, open as long as the block lasts, which parses and checks it.

    `what` is its expected content with an article, such as "a mesh"; `remedy` is a sentence.

    Raises:
        FileError: Of the given kind, for any failure inside, and for anything but a regular file of `most_bytes` at
            most. The words of a ValueError inside become the reason; an error that names a file passes.
    """
    number = _opened(Path(path), shown(path), what, remedy, most_bytes, kind)
    with open(number, "rb") as file, naming(path, what, remedy, kind=kind):
        yield file


@contextmanager
def naming(
    path: str | Path, what: str, remedy: str = _COPY, *, kind: type[FileError] = FileError
) -> Iterator[None]:
    """The errors of `reading`, for content that is parsed after its file was closed."""
    path, name = Path(path), shown(path)
    with _quiet():
        try:
            yield
        except FileError as error:
            message = str(error) if name in str(error) else f"{name}: {error}"
            if error.file is None and (type(error) is not kind or message != str(error) or "\n" in message):
                raise _named(kind(one_line(message, _MESSAGE)), path) from error
            error.file = error.file or path
            raise
        except Exception as error:
            if is_ours(error) and name in str(error):
                raise _named(kind(one_line(str(error), _MESSAGE)), path) from error
            message = f"{name}: not readable as {what} ({reason_of(error)}). {remedy}"
            raise _named(kind(message), path) from error


def read_bytes(
    path: str | Path,
    what: str,
    remedy: str = _COPY,
    *,
    most_bytes: int = MOST_BYTES,
    kind: type[FileError] = FileError,
) -> bytes:
    """Content of a regular file that is not empty; arguments and errors as in `reading`."""
    with reading(path, what, remedy, most_bytes=most_bytes, kind=kind) as file:
        return file.read()


def expanded(path: str | Path) -> Path:
    """A path with ~ and ~somebody as their home; as it is where there is no such home."""
    try:
        return Path(path).expanduser()
    except RuntimeError:
        return Path(path)


def shown(path: str | Path) -> str:
    """A path as a message can hold it: in one printable line, the end of it if it is endless."""
    text = one_line(str(path), None)
    return text if len(text) <= _PATH else f"...{text[-_PATH:]}"


def one_line(text: str, max_letters: int | None = _REASON) -> str:
    """A text in one line of printable letters, cut short if it has too many of them."""
    line = " ".join(text.split()) if max_letters is not None else text
    if not line.isprintable():
        line = "".join(
            c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in line
        )
    return line if max_letters is None or len(line) <= max_letters else f"{line[:max_letters]}..."


def reason_of(error: BaseException) -> str:
    """Return the reason of a library's error on a file, in a few words."""
    if isinstance(error, MemoryError):
        return "it needs more memory than there is"
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if isinstance(error, UnicodeDecodeError):
        return f"byte {error.start} is no {error.encoding.upper()} text"
    if isinstance(error, KeyError) and error.args:
        return f"{one_line(repr(error.args[0]))} is missing"
    if isinstance(error, OSError) and error.strerror:
        return one_line(error.strerror)
    return one_line(str(error)).rstrip(".") or type(error).__name__


def _opened(path: Path, name: str, what: str, remedy: str, most_bytes: int, kind: type[FileError]) -> int:
    """The open file's number; its kind is checked again after opening, since another file may have taken its name."""
    try:
        _check(os.stat(path), name, what, remedy, most_bytes, kind)
        # Without O_NONBLOCK, opening a pipe that took the file's place would wait.
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            _check(os.fstat(number), name, what, remedy, most_bytes, kind)
        except BaseException:
            os.close(number)
            raise
        return number
    except FileError as error:
        error.file = path
        raise
    except FileNotFoundError as error:
        problem = "no such file" if not path.is_symlink() else "a link to a file that is not there"
        hint = "Check the spelling and the folder."
        raise _named(kind(f"{name}: {problem}, expected {what}. {hint}"), path) from error
    except (OSError, ValueError) as error:
        raise _named(kind(f"{name}: cannot be read ({reason_of(error)}), expected {what}."), path) from error


def _check(
    status: os.stat_result, name: str, what: str, remedy: str, most_bytes: int, kind: type[FileError]
) -> None:
    """Raise an error for anything but a regular file of a possible size."""
    for is_kind, words in _KINDS:
        if is_kind(status.st_mode):
            raise kind(f"{name}: is {words}, expected {what} in a regular file.")
    if not status.st_size:
        raise kind(f"{name}: the file is empty, expected {what}. {remedy}")
    if status.st_size > most_bytes:
        raise kind(f"{name}: {status.st_size} bytes, expected {what} of at most {most_bytes}.")


def _named(error: FileError, path: Path) -> FileError:
    error.file = path
    return error


def is_ours(error: BaseException) -> bool:
    """Whether an error is of a class of this project, whose messages say what is wrong in our words."""
    return type(error).__module__.partition(".")[0] in PACKAGES


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress warnings of libraries about a file that we check ourselves."""
    # None where this is nested: setting a level is slow.
    loggers = [logger for logger in map(logging.getLogger, _TALKATIVE) if logger.level <= logging.CRITICAL]
    levels = [logger.level for logger in loggers]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for logger in loggers:
            logger.setLevel(logging.CRITICAL + 1)
        try:
            yield
        finally:
            for logger, level in zip(loggers, levels, strict=True):
                logger.setLevel(level)
