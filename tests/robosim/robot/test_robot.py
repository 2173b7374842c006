"""The robot's body: its size, its balance, and what its wheels do without any feedback."""

import subprocess
import sys

import mujoco
import numpy as np
import pytest

from robosim.robot.body import add_robot
from robosim.robot.collision import WallSolids
from robosim.robot.motion import SpeedProfile
from robosim.robot.physics import PhysicsConfig, add_floor, add_walls, new_spec
from robosim.robot.robots import RobotConfig
from tests.robots import ROBOTS

ROBOT_NAMES = sorted(ROBOTS)


def model(robot: RobotConfig, walls: WallSolids | None = None) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The robot at the origin of a wide floor, at rest."""
    config = PhysicsConfig()
    spec = new_spec(config)
    add_floor(spec, np.array([20.0, 20.0]))
    if walls is not None:
        add_walls(spec, walls, config, origin=np.zeros(2), height_m=2.5)
    add_robot(spec, robot, config)
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    mujoco.mj_step(compiled, data, 200)
    return compiled, data


def roll(compiled, data, robot: RobotConfig, v_mps: float, w_radps: float, duration_s: float) -> None:
    """Drive the wheels by a trapezoid of speeds, with no look at where the robot is."""
    top, ramp = max(abs(v_mps), abs(w_radps) * robot.track_m / 2), 2.0
    profile = SpeedProfile.fastest(top * duration_s, speed_mps=top, accel_mps2=ramp)
    dt = compiled.opt.timestep
    for k in range(round(profile.duration_s / dt) + 100):
        pace = (profile.fraction((k + 1) * dt) - profile.fraction(k * dt)) / dt * duration_s
        rim = w_radps * robot.track_m / 2
        data.ctrl[:] = pace * np.array([v_mps - rim, v_mps + rim]) / robot.wheel_radius_m
        mujoco.mj_step(compiled, data)


def pose(data) -> np.ndarray:
    x, y, _, qw, _, _, qz = data.joint("robot").qpos
    return np.array([x, y, 2 * np.arctan2(qz, qw)])


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_wheels_drive_straight_and_turn_in_place(name):
    """Open loop, 5 m ahead: 0.6 mm short. A full turn: within 0.04 degrees, and 0.01 mm off its place.

    Cylinders for wheels scrub: 9 to 14 degrees short. Wheels that are out of balance (MuJoCo puts a body's
    mass where the body is in its parent if not given) shake it: 100 mm and 6 degrees.
    """
    robot = ROBOTS[name]
    compiled, data = model(robot)
    roll(compiled, data, robot, 0.5, 0.0, 10.0)
    x, y, yaw = pose(data)
    assert abs(x - 5) < 2e-3 and abs(y) < 1e-4 and abs(yaw) < 1e-4
    roll(compiled, data, robot, 0.0, 2.0, np.pi)
    turned = pose(data)
    assert abs(np.degrees((turned[2] + np.pi) % (2 * np.pi) - np.pi)) < 0.2
    assert np.hypot(*(turned - [x, y, 0])[:2]) < 1e-3


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_wheels_follow_an_arc(name):
    """Differential drive: turning at w while going v leads along a circle of radius v / w."""
    robot = ROBOTS[name]
    compiled, data = model(robot)
    roll(compiled, data, robot, 0.3, 1.2, np.pi / 1.2)
    x, y, yaw = pose(data)
    assert abs(x) < 3e-3 and abs(y - 0.5) < 3e-3
    assert abs(abs(yaw) - np.pi) < 3e-3


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_a_robot_left_alone_stands_still(name):
    """Ten seconds: not a micrometre, not a hair's tilt. Casters and wheels carry it, wheels most."""
    robot = ROBOTS[name]
    compiled, data = model(robot)
    before = data.joint("robot").qpos.copy()
    mujoco.mj_step(compiled, data, 2000)
    after = data.joint("robot").qpos
    np.testing.assert_allclose(after, before, atol=1e-6)
    assert data.ncon == 4
    assert abs(after[2]) < 1e-4


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_walls_see_a_circle_of_the_hulls_radius(name):
    """Contact distance with a wall and with an edge, at all headings, is a disk's. Exact to 1e-6 m."""
    robot = ROBOTS[name]
    x = robot.hull.radius_m + 0.01
    block = WallSolids(np.array([[x + 0.5, 0.0, 0.5, 0.5, 0.0]]))
    compiled, data = model(robot, block)
    body, touch = data.joint("robot").qpos, data.sensor("touch").data
    height = body[2]
    for y in (0.0, 0.3, 0.5 + robot.hull.radius_m / 2):  # along the face, and at the corner at y = 0.5
        for yaw in np.linspace(0, np.pi, 5):
            for depth_m in (-0.004, 0.001, 0.004):
                beyond = max(y - 0.5, 0.0)
                gap = np.sqrt((robot.hull.radius_m - depth_m) ** 2 - beyond**2)
                body[:] = x - gap, y, height, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)
                mujoco.mj_forward(compiled, data)
                found, distance = touch
                assert (found > 0) == (depth_m > 0)
                if depth_m > 0:
                    assert distance == pytest.approx(-depth_m, abs=1e-6)


@pytest.mark.parametrize(("name", "radius_m"), [("turtlebot", 0.10), ("locobot", 0.18)])
def test_the_robot_looks_its_size(name, radius_m):
    """All that is drawn lies inside of the hull's circle, from the floor to the camera at 1.25 m."""
    robot = ROBOTS[name]
    assert robot.hull.radius_m == radius_m
    compiled, data = model(robot)
    mujoco.mj_forward(compiled, data)
    drawn = [g for g in range(compiled.ngeom) if compiled.geom_group[g] != 3 and compiled.geom_bodyid[g] > 1]
    top = max(data.geom_xpos[g][2] + compiled.geom_aabb[g][5] for g in drawn)
    assert top == pytest.approx(1.25, abs=0.03)
    for g in drawn:
        centre, half = compiled.geom_aabb[g][:3], compiled.geom_aabb[g][3:]
        corners = centre + half * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        if compiled.geom_type[g] == mujoco.mjtGeom.mjGEOM_CYLINDER:  # its box has corners it has not
            rim = np.linspace(0, 2 * np.pi, 100)
            corners = np.vstack(
                [
                    np.column_stack([half[0] * np.cos(rim), half[0] * np.sin(rim), s * half[2] + 0 * rim])
                    for s in (-1, 1)
                ]
            )
        world = data.geom_xpos[g] + corners @ data.geom_xmat[g].reshape(3, 3).T
        assert np.hypot(world[:, 0], world[:, 1]).max() <= radius_m + 1e-6, compiled.geom(g).name


def test_profiles_keep_their_bounds():
    """Speed and acceleration of the fastest profile, by differences; and it covers the whole length."""
    for length_m in (0.01, 0.25, 3.0):
        profile = SpeedProfile.fastest(length_m, speed_mps=0.5, accel_mps2=3.0)
        time_s = np.linspace(0, profile.duration_s, 2001)
        place = np.array([profile.fraction(t) for t in time_s]) * length_m
        step_s = time_s[1]
        assert place[0] == 0 and place[-1] == length_m
        speed = np.diff(place) / step_s
        assert speed.min() > -1e-9 and speed.max() < 0.5 + 1e-6
        assert np.abs(np.diff(speed)).max() / step_s < 3.0 * (1 + 1e-3)
    assert SpeedProfile.fastest(0.0, speed_mps=0.5, accel_mps2=3.0).fraction(0.0) == 1.0


def test_speeds_out_of_reach_are_reduced_along_the_arc():
    robot = RobotConfig()
    v, w = robot.within_reach(2.0, 10.0)
    assert w / v == pytest.approx(5.0)
    assert v + w * robot.track_m / 2 == pytest.approx(robot.max_speed_mps)
    assert robot.within_reach(0.1, -0.2) == (0.1, -0.2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius_m": 0.0}, "radius_m is 0.0, expected 0.001 to 5 m"),
        ({"mass_kg": np.nan}, "mass_kg is nan"),
        ({"track_m": 0.3}, "outside"),
    ],
)
def test_impossible_robots_are_errors(change, message):
    with pytest.raises(ValueError, match=message):
        RobotConfig(**change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"timestep_s": 0.02}, "timestep_s"),
        ({"control_period_s": 0.001}, "control_period_s"),
        ({"wall_friction": -1.0}, "wall_friction"),
    ],
)
def test_impossible_physics_is_an_error(change, message):
    with pytest.raises(ValueError, match=message):
        PhysicsConfig(**change)


def test_loading_the_physics_starts_no_process():
    """One that a signal meets leaves a traceback on the terminal, without need: glfw would start one."""
    setup = (
        "import sys; sys.addaudithook(lambda event, _: print(event) if event == 'subprocess.Popen' else None)"
    )
    code = f"{setup}; import robosim.robot.dynamic; assert 'mujoco' in sys.modules"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=600, check=True
    )
    assert run.stdout == ""
