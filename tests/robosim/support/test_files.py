"""Files that appear whole or not at all, and errors of the disk that name them."""

import errno

import pytest

from robosim.support.files import disk_errors, partial_path, whole_file, whole_folder


@pytest.mark.parametrize("whole", [whole_file, whole_folder])
def test_an_error_of_the_disk_names_the_file_and_leaves_what_was_there(tmp_path, whole):
    """A full disk names no file by itself, and a writer names the temporary one."""
    path = tmp_path / "result.bin"
    with pytest.raises(OSError) as full, whole(path) as partial:
        target = partial if whole is whole_file else partial / "part"
        target.write_bytes(b"half")
        with open("/dev/full", "wb", buffering=0) as disk:
            disk.write(b"x")
    assert full.value.errno == errno.ENOSPC
    assert full.value.filename == str(path)
    assert not list(tmp_path.iterdir())


def test_a_temporary_name_is_replaced_and_any_other_stays(tmp_path):
    path = tmp_path / "result.bin"
    for filename, expected in [(partial_path(path), path), (tmp_path / "other", tmp_path / "other")]:
        with pytest.raises(PermissionError) as denied, disk_errors(path):
            raise PermissionError(errno.EACCES, "Permission denied", str(filename))
        assert denied.value.filename == str(expected)
        assert str(denied.value) == f"[Errno 13] Permission denied: '{expected}'"


def test_an_error_without_a_number_stays_as_it_is(tmp_path):
    """Such as those that libraries raise with a text alone."""
    with pytest.raises(OSError, match=r"^cannot write mode F$") as error, disk_errors(tmp_path / "a.png"):
        raise OSError("cannot write mode F")
    assert error.value.filename is None
