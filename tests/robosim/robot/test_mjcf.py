"""A building and a robot as MJCF: what MuJoCo opens by itself behaves like what is simulated here."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import shapely

from robosim import export_mjcf
from robosim.building.building import BuildingConfig, make_building
from robosim.robot.robots import robot_of_radius
from tests.plans import room, two_rooms
from tests.robots import ROBOTS


def opened(path) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_path(str(path))
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_robot_stands_drives_and_is_stopped_by_a_wall(name, tmp_path):
    """At rest it keeps its place to 1 mm; both wheels at 0.2 m/s it drives straight, and its hull stops at the wall.

    A room of 6 m x 4 m, the robot a metre from the wall ahead: it comes to rest a radius from it, within 2 mm.
    """
    robot = ROBOTS[name]
    building = make_building(room(6.0, 4.0))
    _, south, east, north = building.free.bounds
    start = np.array([east - 1.0, (south + north) / 2, 0.0])
    model, data = opened(export_mjcf(building, tmp_path / "mujoco.xml", robot=robot, pose=start))
    mujoco.mj_step(model, data, 200)
    place = data.body("robot").xpos
    np.testing.assert_allclose(place, [*start[:2], 0.0], atol=1e-3)
    data.ctrl[:] = 0.2 / robot.wheel_radius_m
    mujoco.mj_step(model, data, 200)
    assert place[0] == pytest.approx(start[0] + 0.2, abs=0.01)
    assert place[1] == pytest.approx(start[1], abs=1e-3)
    assert data.sensor("touch").data[0] == 0
    mujoco.mj_step(model, data, 2000)
    assert data.sensor("touch").data[0] > 0
    assert place[0] == pytest.approx(east - robot.hull.radius_m, abs=2e-3)


@pytest.mark.parametrize("tolerance_m", [0.0, 0.1], ids=["cells", "straightened"])
def test_walls_are_where_they_are_in_map(tolerance_m, tmp_path):
    """Far from the origin and turned: from the robot's place rays at hull height meet walls where the plan has them.

    Judge: the distance along the ray to the boundary of free space. To 0.5 mm, as MJCF has six digits.
    """
    plan = replace(two_rooms(0.8), origin=(612.3456, -87.654, 0.7), name='a <b> & "c"')
    building = make_building(plan, config=BuildingConfig(tolerance_m=tolerance_m))
    path = export_mjcf(building, tmp_path / "mujoco.xml")
    assert [file.name for file in tmp_path.iterdir()] == ["mujoco.xml"]  # no temporary file is left
    model, data = opened(path)
    mujoco.mj_forward(model, data)
    x, y, _ = data.body("robot").xpos
    assert building.free.contains(shapely.Point(x, y).buffer(0.1))
    outside = data.body("robot").id
    for angle in np.linspace(0, 2 * np.pi, 24, endpoint=False):
        along = np.array([np.cos(angle), np.sin(angle), 0.0])
        found = mujoco.mj_ray(
            model, data, np.array([x, y, 0.5]), along, None, 1, outside, np.zeros(1, np.int32), np.zeros(3)
        )
        ray = shapely.LineString([(x, y), (x + 50 * along[0], y + 50 * along[1])])
        first = min(
            shapely.distance(shapely.Point(x, y), part)
            for part in shapely.get_parts(ray.intersection(building.free.boundary))
        )
        assert found == pytest.approx(first, abs=5e-4)


def test_a_robot_in_a_wall_is_an_error(tmp_path):
    """The message says where, or that it fits nowhere, and nothing is written."""
    building = make_building(room(3.0, 3.0))
    with pytest.raises(ValueError, match="not in free space"):
        export_mjcf(building, tmp_path / "mujoco.xml", pose=np.array([-1.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match=r"radius 2\.0 m fits nowhere"):
        export_mjcf(building, tmp_path / "mujoco.xml", robot=robot_of_radius(2.0))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("radius_m", [0.001, 0.05, 0.10, 0.18, 0.3, 5.0])
def test_there_is_a_robot_of_every_radius(radius_m):
    """Named ones by their radius; others too, with wheels inside of the hull."""
    robot = robot_of_radius(radius_m)
    assert robot.hull.radius_m == radius_m and robot.track_m <= 2 * radius_m
    assert (robot in ROBOTS.values()) == (radius_m in (0.10, 0.18))
