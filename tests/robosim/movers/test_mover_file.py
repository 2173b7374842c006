"""Files of movers: doors by closed forms, and one line for each kind of damage."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.movers.mover import Surroundings
from robosim.movers.mover_file import Door, DoorConfig, mover_of_file
from robosim.support.reading import FileError
from tests.plans import two_rooms

BUILDING = make_building(two_rooms(0.8))
FAR = np.array([0.5, 0.5, 0.0])
RNG = np.random.default_rng(0)


def begun(robot=FAR, **config) -> Door:
    door = Door(
        DoorConfig(door=(3.1, 1.1), width_m=0.8, closed_deg=90, open_deg=0, open_s=((5, 15),), **config)
    )
    door.reset(Surroundings(BUILDING, np.array(robot), 0.1), RNG)
    return door


def test_a_door_opens_and_closes_in_two_seconds():
    """Directions of the leaf before, during and after; the posts cover it from the hinge on."""
    door = begun()
    found = {time: door.poses(time, FAR) for time in (0.0, 4.9, 6.0, 8.0, 14.9, 16.0, 20.0)}
    angle = {time: float(np.degrees(poses[0, 2])) for time, poses in found.items()}
    assert angle[0.0] == angle[4.9] == angle[20.0] == pytest.approx(90)
    assert angle[8.0] == angle[14.9] == pytest.approx(0)
    assert 0 < angle[6.0] < 90 and 0 < angle[16.0] < 90
    reach = np.hypot(*(found[0.0][:, :2] - (3.1, 1.1)).T)
    assert np.diff(reach).max() <= 2 * door.bodies[0].radius_m + 1e-9
    assert reach[0] < 0.05 and 0.75 < reach[-1] < 0.8


def test_a_door_stops_for_the_robot():
    """It closes again once the robot has left."""
    door, below = begun(), np.array([3.3, 1.75, 0.0])
    for k in range(150):
        door.poses(0.1 * k, FAR)
    stopped = [door.poses(15 + 0.1 * k, below) for k in range(100)][-1]
    assert np.hypot(*(stopped[:, :2] - below[:2]).T).min() >= 0.1 + 0.03
    assert 0 < np.degrees(stopped[0, 2]) < 90
    assert np.degrees([door.poses(26 + 0.1 * k, FAR) for k in range(30)][-1][0, 2]) == pytest.approx(90)


def test_a_file_lists_doors_crowds_and_trajectories(tmp_path):
    (tmp_path / "crowd.csv").write_text("time,id,x,y\n0,a,1,1\n9,a,2,1\n")
    (tmp_path / "trolley.tum").write_text("0 4 1 0 0 0 0 1\n9 5 1 0 0 0 0 1\n")
    (tmp_path / "movers.yaml").write_text(
        "- door: [3.1, 1.1]\n  width_m: 0.8\n  open_s: [[0, 5]]\n"
        "- crowd: crowd.csv\n- trajectory: trolley.tum\n  radius_m: 0.3\n  height_m: 1.0\n"
    )
    mover = mover_of_file(tmp_path / "movers.yaml")
    mover.reset(Surroundings(BUILDING, FAR, 0.1), RNG)
    poses = mover.poses(4.5, FAR)
    assert len(poses) == len(mover.bodies) == 14 + 2
    np.testing.assert_allclose(poses[-2:, :2], [[1.5, 1.0], [4.5, 1.0]])
    assert mover.bodies[-1].radius_m == 0.3 and mover.bodies[-2].look == "person"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[]", "no list of 1 to 100"),
        ("- gate: [1, 2]", "entry 1: it has the keys gate, expected door, crowd or trajectory"),
        ("- door: [1, 2]\n  with_m: 1", "with_m"),
        ("- door: [1, 2]\n  width_m: 50", "width_m is 50"),
        ("- door: north", "entry 1: door"),
        ("- crowd: missing.csv", "missing.csv"),
        ("- trajectory: 3", "expected door, crowd or trajectory"),
        ("a: [", "movers.yaml"),
    ],
)
def test_damaged_files_are_rejected_in_one_line(tmp_path, text, reason):
    (tmp_path / "movers.yaml").write_text(text)
    with pytest.raises(FileError) as error:
        mover_of_file(tmp_path / "movers.yaml")
    assert reason in str(error.value) and "movers.yaml" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("interval", ["[15, 5]", "[5, 5]", "[.nan, 5]"])
def test_mover_of_file_rejects_doors_that_open_after_they_close(tmp_path, interval):
    path = tmp_path / "movers.yaml"
    path.write_text(f"- door: [3.0, 2.0]\n  open_s: [{interval}]\n")
    with pytest.raises(FileError, match=r"movers.yaml: .*entry 1: .*open_s"):
        mover_of_file(path)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("robot.tum", "0 100 100 0 0 0 0 1\n1 101 100 0 0 0 0 1\n"),
        ("people.csv", "time,id,x,y\n0,a,-50,1\n1,a,-49,1\n"),
        ("movers.yaml", "- door: [40.0, 2.0]\n"),
    ],
)
def test_reset_rejects_movers_outside_of_the_building(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    surroundings = Surroundings(BUILDING, FAR, 0.2)
    with pytest.raises(ValueError, match="outside of the building"):
        mover_of_file(path).reset(surroundings, np.random.default_rng(0))
