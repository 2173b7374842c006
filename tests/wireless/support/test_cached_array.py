"""Arrays cached on disk: computed once for all that they depend on, and again when damaged."""

import os

import numpy as np
import pytest

from wireless.support import cached_array as module
from wireless.support.cached_array import cached_array, cached_arrays


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    return tmp_path / "robosim"


class Maker:
    """Counts how often it computes."""

    def __init__(self) -> None:
        self.made = 0

    def __call__(self) -> np.ndarray:
        self.made += 1
        return np.array([1.0, np.nan, -0.0, 1e-300])


def test_it_is_computed_once_for_what_it_depends_on(folder, tmp_path):
    """Values, code, library and processor: each change is another array. The bits are those that were computed."""
    code, make = tmp_path / "code.py", Maker()
    code.write_text("1")
    first = cached_array("it", [b"a", b"b"], [code], make)
    again = cached_array("it", [b"a", b"b"], [code], make)
    assert make.made == 1 and first.tobytes() == again.tobytes()
    cached_array("it", [b"ab", b""], [code], make)
    assert make.made == 2
    code.write_text("2")
    cached_array("it", [b"a", b"b"], [code], make)
    assert make.made == 3 and len(list(folder.glob("it-*.cached"))) == 3


@pytest.mark.parametrize("content", [b"", b"x" * 100, None])
def test_a_damaged_file_is_computed_again(folder, content):
    make = Maker()
    cached_array("it", [b"a"], [], make)
    (file,) = folder.glob("it-*.cached")
    file.write_bytes(file.read_bytes()[:-1] if content is None else content)
    cached_array("it", [b"a"], [], make)
    cached_array("it", [b"a"], [], make)
    assert make.made == 2


def test_without_a_folder_it_is_computed(monkeypatch):
    make = Maker()
    monkeypatch.setattr(module, "writable_folder", lambda folders: None)
    for _ in range(2):
        assert cached_array("it", [b"a"], [], make).size == 4
    assert make.made == 2


def test_cached_arrays_returns_arrays_of_all_types_in_their_order(folder):
    made = [np.arange(12.0).reshape(4, 3), np.array(0.1), np.array([True, False]), np.empty((0, 2), np.int64)]
    for _ in range(2):
        arrays = cached_arrays("they", [b"a"], [], lambda: made)
        assert [array.dtype for array in arrays] == [array.dtype for array in made]
        assert all(map(np.array_equal, arrays, made))
    arrays = cached_arrays("they", [b"a"], [], lambda: pytest.fail("made again"))
    assert all(array.flags.writeable and array.flags.c_contiguous for array in arrays)


def test_cached_array_bounds_the_files_of_a_name(folder, monkeypatch):
    """Files of 32 kB: the newest remain, of 70 kB in all; a single array above that is not stored."""
    monkeypatch.setattr(module, "MAX_BYTES", 70_000)
    for key in range(3):
        cached_array("it", [bytes([key])], [], lambda: np.zeros(4000))
        for age, file in enumerate(sorted(folder.glob("it-*"), key=lambda path: -path.stat().st_mtime)):
            os.utime(file, (1e9 - age, 1e9 - age))
    cached_array("it", [b"large"], [], lambda: np.zeros(9000))
    assert len(list(folder.glob("it-*.cached"))) == 2
    for key in (1, 2):
        cached_array("it", [bytes([key])], [], lambda: pytest.fail("made again"))
