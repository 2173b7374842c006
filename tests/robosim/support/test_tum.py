"""Trajectories from other programs: headings are right, or the line is named."""

import logging
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robosim.support.reading import FileError
from robosim.support.tum import read_tum, write_tum


def rows(count=20, turn=0.1):
    """A robot that turns on a circle: times, x, y, z and the quaternion (qx, qy, qz, qw)."""
    k = np.arange(count)
    zero, half = np.zeros(count), turn * k / 2
    return np.column_stack([10 + 0.1 * k, np.cos(k), np.sin(k), zero, zero, zero, np.sin(half), np.cos(half)])


def read_rows(folder, values):
    path = folder / "track.tum"
    np.savetxt(path, values, header="timestamp x y z qx qy qz qw")
    return read_tum(path)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(-3.1, 3.1), min_size=1, max_size=9), st.floats(0.96, 1.04), st.sampled_from([-1, 1])
)
def test_headings_come_back_whatever_the_length_and_sign(tmp_path_factory, yaws, length, sign):
    """Quaternions of nearly unit length are normalised, and q and -q are the same turn: to 1e-6 rad."""
    yaw = np.array(yaws)
    values = rows(len(yaws))
    values[:, 6], values[:, 7] = sign * length * np.sin(yaw / 2), sign * length * np.cos(yaw / 2)
    _, poses = read_rows(tmp_path_factory.mktemp("tum"), values)
    off = poses[:, 2] - yaw
    assert np.abs((off + math.pi) % (2 * math.pi) - math.pi).max() < 1e-6


def test_what_was_written_is_read(tmp_path):
    times, poses = np.arange(5.0), np.random.default_rng(0).uniform(-3, 3, (5, 3))
    write_tum(tmp_path / "a.tum", times, poses)
    back = read_tum(tmp_path / "a.tum")
    np.testing.assert_allclose(back[0], times)
    np.testing.assert_allclose(back[1], poses, atol=1e-8)


def changed(row, columns, values):
    table = rows()
    table[row, columns] = values
    return table


QUATERNION = [4, 5, 6, 7]
TIPPED = math.sin(math.radians(20))


@pytest.mark.parametrize(
    ("values", "line", "words"),
    [
        (changed(7, QUATERNION, 0), 9, "length 0"),
        (changed(7, QUATERNION, [0, 0, 0, 1.2]), 9, "length 1.2"),
        (changed(0, QUATERNION, [0, 0, 0, 0.5]), 2, "length 0.5"),
        (rows()[:, [0, 1, 2, 3, 7, 4, 5, 6]], 2, "qw last"),
        (rows()[:, [0, 1, 2, 3, 7, 6, 5, 4]], 2, "qw last"),
        (changed(3, QUATERNION, [TIPPED, 0, 0, math.cos(math.radians(20))]), 5, "40 degrees"),
        (changed(1, 0, 10.0), 3, "10 s, after 10 s"),
        (changed(5, 0, 10.2), 7, "10.2 s, after 10.4"),
        (changed(5, 0, np.nan), 7, "NaN"),
        (changed(6, 1, np.nan), 8, "NaN"),
        (changed(6, 7, np.inf), 8, "NaN"),
        (rows()[:, :7], 2, "has 7 values, expected 8"),
        (np.column_stack([rows(), rows()[:, :4]]), 2, "KITTI"),
    ],
)
def test_what_is_no_pose_on_a_floor_is_named_by_its_line(tmp_path, values, line, words):
    with pytest.raises(FileError) as error:
        read_rows(tmp_path, values)
    said = str(error.value)
    assert f"line {line} " in said and words in said and "track.tum" in said and "\n" not in said


def test_words_are_named_by_their_line(tmp_path):
    (tmp_path / "track.tum").write_text("# a comment\n\n1 0 0 0 0 0 0 1\n2 0 zero 0 0 0 0 1\n")
    with pytest.raises(FileError, match=r"line 4: .*zero"):
        read_tum(tmp_path / "track.tum")


def test_a_ramp_keeps_its_heading_and_is_said(tmp_path, caplog):
    """Pitched up by 5 degrees and turned by 30: the heading is 30 degrees."""
    yaw, pitch = math.radians(30), math.radians(-5)
    cy, sy, cp, sp = math.cos(yaw / 2), math.sin(yaw / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    values = changed(4, QUATERNION, [-sp * sy, sp * cy, cp * sy, cp * cy])
    with caplog.at_level(logging.WARNING):
        _, poses = read_rows(tmp_path, values)
    assert poses[4, 2] == pytest.approx(yaw, abs=1e-9)
    assert "5.0 degrees (line 6)" in caplog.text
