"""The boundary: one line that names the file, whatever is wrong with it."""

import logging
import os
import socket
import warnings
import zlib

import numpy as np
import pytest

from robosim.plans.floorplan import MapError
from robosim.support.reading import FileError, read_bytes, reading, shown

REMEDY = "Bake it again."


def error_of(path, kind=FileError):
    """The message of a file that is wrong before it is opened; one line that names it."""
    with pytest.raises(FileError) as error:
        read_bytes(path, "a cake", REMEDY, most_bytes=100, kind=kind)
    message = str(error.value)
    assert type(error.value) is kind and shown(path) in message and "\n" not in message
    assert error.value.file == path
    return message


def thrown(path, error):
    """The message of an error that strikes inside."""
    with pytest.raises(FileError) as caught, reading(path, "a cake", REMEDY):
        raise error
    message = str(caught.value)
    assert shown(path) in message and "\n" not in message and message.isprintable()
    assert caught.value.__cause__ is error or caught.value is error
    return message


@pytest.fixture
def cake(tmp_path):
    path = tmp_path / "cake.txt"
    path.write_bytes(b"layers")
    return path


def test_a_regular_file_is_read(cake):
    assert read_bytes(cake, "a cake") == b"layers"


def test_what_is_no_regular_file_is_an_error(cake, tmp_path):
    """A pipe would be waited for and a device read for ever, were they opened."""
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket"))
        assert "is a socket" in error_of(tmp_path / "socket")
    (tmp_path / "lost").symlink_to("nowhere")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "zero").symlink_to("/dev/zero")
    (tmp_path / "empty").touch()
    (tmp_path / "long").write_bytes(bytes(101))
    assert "is a folder, expected a cake" in error_of(tmp_path)
    assert "is a named pipe" in error_of(tmp_path / "pipe")
    assert "is a device" in error_of(tmp_path / "zero")
    assert "no such file" in error_of(tmp_path / "none")
    assert "a link to a file that is not there" in error_of(tmp_path / "lost")
    assert "symbolic links" in error_of(tmp_path / "loop")
    assert "Not a directory" in error_of(cake / "slice")
    assert "File name too long" in error_of(tmp_path / ("x" * 5000))
    assert "embedded null" in error_of(tmp_path / "a\0b")  # byte or character, as Python has it
    assert "the file is empty, expected a cake. Bake it again." in error_of(tmp_path / "empty")
    assert "101 bytes, expected a cake of at most 100" in error_of(tmp_path / "long", MapError)


def test_a_link_to_a_regular_file_is_followed(cake, tmp_path):
    (tmp_path / "link").symlink_to(cake)
    assert read_bytes(tmp_path / "link", "a cake") == b"layers"


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (zlib.error("Error -3 while\ndecompressing"), "(Error -3 while decompressing)"),
        (MemoryError(), "(it needs more memory than there is)"),
        (RecursionError("maximum recursion depth exceeded"), "(it is nested too deeply)"),
        (UnicodeDecodeError("utf-8", b"\x8c", 0, 1, "invalid"), "(byte 0 is no UTF-8 text)"),
        (KeyError("flour"), "('flour' is missing)"),
        (OSError(5, "Input/output error"), "(Input/output error)"),
        (IndexError(), "(IndexError)"),
        (TypeError("\x1b[31m" + "x" * 9999), "(\\x1b[31mxxx"),
        (ValueError("two layers, expected three"), "(two layers, expected three)"),
    ],
)
def test_whatever_a_library_throws_is_one_line(cake, error, words):
    message = thrown(cake, error)
    assert f"{cake}: not readable as a cake {words}" in message
    assert message.endswith(REMEDY)
    assert len(message) < 600 + len(str(cake))


def test_interrupts_pass(cake):
    for error in (KeyboardInterrupt, SystemExit):
        with pytest.raises(error), reading(cake, "a cake"):
            raise error


def test_what_names_a_file_already_passes_through_outer_boundaries(cake, tmp_path):
    """The icing's error is not blamed on the cake; one without a file gets the name of the innermost one."""
    with pytest.raises(FileError) as error, reading(cake, "a cake"):
        read_bytes(tmp_path / "icing", "icing")
    assert "icing: no such file" in str(error.value) and "cake" not in str(error.value)
    with pytest.raises(MapError, match=r"cake\.txt: no room$"), reading(cake, "a cake", kind=MapError):
        raise MapError("no room")


def test_names_are_shown_in_one_printable_line(tmp_path):
    path = tmp_path / "a\nb\x1b[0m\udce4"
    assert "a\\nb\\x1b[0m\\udce4: no such file" in error_of(path)
    assert len(shown("x" * 5000)) < 500


def test_messages_of_libraries_are_not_printed(cake, caplog):
    """Their loggers and warnings speak again afterwards."""
    loud = logging.getLogger("trimesh")
    with reading(cake, "a cake"):
        loud.error("traceback follows")
        warnings.warn("deprecated", stacklevel=1)
        assert np.array([1.0, 0.0])[0] == 1
    assert not caplog.records
    loud.error("again")
    with pytest.raises(UserWarning):
        warnings.warn("again", stacklevel=1)
    assert [record.message for record in caplog.records] == ["again"]
