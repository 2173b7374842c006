"""Plans from arrays in memory and in `.npy` files."""

import io

import numpy as np
import pytest

from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, MapError
from robosim.plans.formats.plan_array import plan_from_array

NAN = float("nan")


@pytest.mark.parametrize(
    "array",
    [
        np.array([[0, 1, 2], [0, 0, 1]]),
        np.array([[0, 1, 2], [0, 0, 1]], np.int8),
        np.array([[0, 1, 2], [0, 0, 1]], ">u4"),
        np.array([[0.0, 1.0, NAN], [0.19, 0.1, 0.66]]),
        np.array([[0.0, 1.0, 0.5], [0.19, 0.1, 0.66]], np.float32),
    ],
)
def test_states_and_probabilities_mean_the_same(tmp_path, array):
    """In memory and in a file: row 0 has the lowest y."""
    np.save(tmp_path / "plan.npy", array)
    for plan in (plan_from_array(array, 0.1), read_plan(tmp_path / "plan.npy", resolution_m=0.1)):
        np.testing.assert_array_equal(plan.occupancy, [[FREE, OCCUPIED, UNKNOWN], [FREE, FREE, OCCUPIED]])
        assert plan.resolution_m == 0.1


def test_true_is_occupied():
    np.testing.assert_array_equal(plan_from_array(np.array([[True, False]]), 1.0).free, [[False, True]])


def test_probabilities_at_a_threshold_are_unknown():
    plan = plan_from_array(np.array([[0.2, 0.7, 0.1, 0.8]]), 1.0, free_thresh=0.2, occupied_thresh=0.7)
    np.testing.assert_array_equal(plan.occupancy, [[UNKNOWN, UNKNOWN, FREE, OCCUPIED]])


@pytest.mark.parametrize(
    ("array", "word"),
    [
        (np.array([[0, 3]]), "a cell is 3"),
        (np.array([[0, -1]]), "a cell is -1"),
        (np.array([[0, 100]], np.uint8), "percentages"),
        (np.array([[0.0, 1.5]]), "1.5"),
        (np.array([[0.0, -0.1]]), "-0.1"),
        (np.array([[0.0, np.inf]]), "inf"),
        (np.array([["a"]]), "<U1"),
        (np.array([[1j]]), "complex128"),
        (np.zeros((2, 2, 2)), "(2, 2, 2)"),
        (np.zeros((0, 2)), "(0, 2)"),
        (np.ones((2, 2)), "no free space"),
        (np.full((2, 2), NAN), "no free space"),
    ],
)
def test_bad_arrays_are_said(tmp_path, array, word):
    np.save(tmp_path / "plan.npy", array)
    with pytest.raises(MapError) as error:
        read_plan(tmp_path / "plan.npy", resolution_m=0.1)
    assert word in str(error.value)
    assert "plan.npy" in str(error.value)


def npy(header):
    buffer = io.BytesIO()
    text = header.ljust(117).encode() + b"\n"
    buffer.write(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + b"\0" * 64)
    return buffer.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"garbage",
        npy("{'descr': '|u1', 'fortran_order': False, 'shape': (1000000, 1000000), }"),
        npy("{'descr': '|u1', 'fortran_order': False, 'shape': (-4, 16), }"),
        npy("{'descr': '|O', 'fortran_order': False, 'shape': (1, 1), }"),
        npy("{'descr': '|u1'}"),
        npy("1 + 1"),
    ],
)
def test_damaged_files_are_said(tmp_path, content):
    """Headers that lie about the size must not allocate the memory; pickles must not run."""
    (tmp_path / "plan.npy").write_bytes(content)
    with pytest.raises(MapError, match=r"plan\.npy"):
        read_plan(tmp_path / "plan.npy", resolution_m=0.1)


def test_a_file_needs_its_resolution(tmp_path):
    np.save(tmp_path / "plan.npy", np.zeros((2, 2)))
    with pytest.raises(MapError, match=r"plan\.npy.*--resolution"):
        read_plan(tmp_path / "plan.npy")
