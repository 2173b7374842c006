"""Recorded crowds and trajectories: interpolation, and one line for each kind of damage."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from robosim.movers.mover_file import mover_of_file
from robosim.support.reading import FileError
from robosim.support.tum import write_tum

HERE = np.zeros(3)
ROWS = "time,id,x,y,heading\n0,a,0,0,0\n2,a,2,0,1.5707963\n1,b,5,5,3\n3,b,5,6,-3\n"


@pytest.fixture
def crowd(tmp_path):
    def write(text: str):
        path = tmp_path / "crowd.csv"
        path.write_text(text)
        return path

    return write


def test_poses_are_linear_in_time_and_absent_outside_of_it(crowd):
    """Turns take the smaller angle."""
    mover = mover_of_file(crowd(ROWS))
    np.testing.assert_allclose(mover.poses(1.0, HERE)[0], [1, 0, np.pi / 4], atol=1e-6)
    np.testing.assert_allclose(mover.poses(2.0, HERE)[1], [5, 5.5, np.pi], atol=1e-6)
    assert np.isnan(mover.poses(0.5, HERE)[1]).all() and np.isnan(mover.poses(2.5, HERE)[0]).all()


def test_parquet_is_the_same(crowd, tmp_path):
    table = pa.table(
        {"time": [0.0, 2, 1, 3], "id": ["a", "a", "b", "b"], "x": [0.0, 2, 5, 5], "y": [0.0, 0, 5, 6]}
    )
    pq.write_table(table, tmp_path / "crowd.parquet")
    mover = mover_of_file(tmp_path / "crowd.parquet")
    expected = mover_of_file(crowd(ROWS))
    for time in (0.3, 1.2, 2.9):
        np.testing.assert_allclose(mover.poses(time, HERE)[:, :2], expected.poses(time, HERE)[:, :2])
    # Without headings people face where they walk.
    np.testing.assert_allclose(mover.poses(1.5, HERE)[:, 2], [0, np.pi / 2])


def test_a_trajectory_is_another_robot(tmp_path):
    poses = np.array([[0.0, 0, 3.1], [1, 0, -3.1]])
    write_tum(tmp_path / "robot.tum", np.array([10.0, 11.0]), poses)
    mover = mover_of_file(tmp_path / "robot.tum")
    x, _, yaw = mover.poses(0.5, HERE)[0]
    assert x == pytest.approx(0.5) and abs(yaw) == pytest.approx(np.pi, abs=1e-6)
    assert mover.bodies[0].look == "cylinder"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("time,id,x\n0,a,0\n", "column y is missing"),
        ("time,id,x,y\n0,a,0,0\n0,a,1,0\n", "id a has two rows at time 0"),
        ("time,id,x,y\n0,a,0,nan\n", "y"),
        ("time,id,x,y\n0,a,0,1e9\n", "y of row 1 is 1000000000"),
        ("time,id,x,y\n0,a,0,north\n", "column y"),
        ("time,id,x,y,heading\n0,a,0,0,270\n", "heading of row 1 is 270"),
        ("time,id,x,y\n", "0 different ids"),
        ("", "crowd.csv"),
    ],
)
def test_damaged_files_are_rejected_in_one_line(crowd, text, reason):
    with pytest.raises(FileError, match=reason) as error:
        mover_of_file(crowd(text))
    assert "crowd.csv" in str(error.value) and "\n" not in str(error.value)


def test_people_who_stand_face_where_they_came_to(crowd):
    """Along y, 3 m, and then 2 s in one place."""
    mover = mover_of_file(crowd("time,id,x,y\n0,a,1,1\n2,a,1,4\n4,a,1,4\n"))
    np.testing.assert_allclose(mover.poses(3.0, HERE)[0], [1, 4, np.pi / 2])


def test_crowds_that_come_late_are_reported(crowd, caplog):
    """Times since midnight, in an episode that begins at 0 s."""
    mover_of_file(crowd("time,id,x,y\n40000,a,1,1\n40002,a,1,4\n"))
    assert "40000 to 40002 s" in caplog.text
    caplog.clear()
    mover_of_file(crowd(ROWS))
    assert not caplog.text
