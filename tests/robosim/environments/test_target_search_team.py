"""Searches of several robots: PettingZoo's contract, and robots that stop, see and end the search for each other."""

import sys

import jaxtyping
import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from robosim import parallel_env
from robosim.environments.target_search import TargetSearch
from robosim.environments.target_search_team import TargetSearchTeam
from robosim.movers.movers import MoversConfig
from robosim.plans.floorplan import MapError
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.support.colours import robot_colour
from robosim.support.installation import install_command
from tests.plans import room, two_rooms

PLAN = two_rooms(0.8)
EXACT = SimulatorConfig(
    physics="kinematic", camera="none", robot=RobotConfig(lidar="ring-64", noise=NoiseModel(level=0))
)
FORWARD, LEFT, WAIT = 0, 1, 3


def made(plan=PLAN, observe=("depth", "odometry", "pose"), **options) -> TargetSearchTeam:
    return parallel_env(plan, observe=observe, **options)


def assert_same(first, second) -> None:
    """See that results of agents are the same, key by key."""
    if isinstance(first, dict):
        assert first.keys() == second.keys()
        for key in first:
            assert_same(first[key], second[key])
    else:
        assert np.asarray(first).dtype == np.asarray(second).dtype
        assert np.array_equal(first, second)


def gap_m(infos) -> float:
    """Distance between the centres of two robots [m]."""
    return float(np.hypot(*(infos["robot1"]["pose"] - infos["robot2"]["pose"])[:2]))


@pytest.mark.parametrize("options", [{}, {"actions": "velocity", "max_steps": 5}])
def test_parallel_env_passes_the_tests_of_pettingzoo(options):
    """Without a warning, which would fail this test; also where searches are truncated."""
    env = made(**options)
    parallel_api_test(env, num_cycles=20)
    parallel_seed_test(lambda: made(**options), num_cycles=10)
    env.close()


def test_parallel_env_repeats_a_search_of_a_seed():
    """All results are bit-identical; another seed has another start, and agents draw actions of their own."""
    envs = made(), made()
    first, second = (env.reset(seed=np.int64(7)) for env in envs)
    assert_same(dict(enumerate(first)), dict(enumerate(second)))
    rng = np.random.default_rng(1)
    for _ in range(15):
        actions = {agent: rng.choice([0, 0, 1, 2, 3]) for agent in envs[0].agents}
        ours, theirs = (dict(enumerate(env.step(actions))) for env in envs)
        assert_same(ours, theirs)
    assert not np.array_equal(envs[1].reset(seed=8)[1]["robot1"]["pose"], first[1]["robot1"]["pose"])
    assert envs[0].action_space("robot1") is not envs[0].action_space("robot2")


def test_team_of_one_does_what_the_environment_of_one_robot_does():
    """Spaces, observations, rewards and infos, bit for bit, with each sense but pictures."""
    observe = ("depth", "lidar", "odometry", "radio", "map", "pose")
    team, alone = made(observe=observe, robots=1, targets=1), TargetSearch(PLAN, observe=observe, targets=1)
    assert team.observation_space("robot1") == alone.observation_space
    assert team.action_space("robot1") == alone.action_space
    for ours, theirs in zip(team.reset(seed=3), alone.reset(seed=3), strict=True):
        assert_same(ours, {"robot1": theirs})
    for action in (0, 0, 1, 0, 2, 0):
        results = team.step({"robot1": action})
        for ours, theirs in zip(results, alone.step(action), strict=True):
            assert_same(ours, {"robot1": theirs})
    team.close()
    alone.close()


def test_robots_see_each_other():
    """In the middle of a room of 6 m, a turn shows the other robot in pictures and scans; alone, only walls."""
    config = SimulatorConfig(
        physics="kinematic", camera="plan", robot=RobotConfig(lidar="ring-64", noise=NoiseModel(level=0))
    )
    start = {"start": (3.0, 3.0, 0.0), "target": (0.5, 0.5)}
    nearest = {}
    for robots in (1, 2):
        env = made(room(6, 6), ("depth", "lidar"), robots=robots, config=config, depth="metres")
        observations, infos = env.reset(seed=1, options=start)
        scans, pictures = [], []
        for _ in range(36):
            observations, _, _, _, infos = env.step(
                {agent: WAIT if agent == "robot2" else LEFT for agent in env.agents}
            )
            scans.append(observations["robot1"]["lidar"].min())
            row = observations["robot1"]["depth"][len(observations["robot1"]["depth"]) // 2]
            pictures.append(row[row > 0].min(initial=9.0))
        nearest[robots] = min(scans), min(pictures)
        env.close()
    surface_m = gap_m(infos) - config.robot.hull.turning_m
    assert min(nearest[1]) > 2
    assert nearest[2] == pytest.approx((surface_m, surface_m), abs=0.15)


def test_robots_stop_at_each_other():
    """A robot that drives straight at another touches its hull and collides; both never overlap, wherever they go."""
    env = made(room(2, 2), ("lidar",), config=EXACT, rewards={"collision": -1.0})
    place = {"start": (1.0, 1.0, 0.0), "target": (0.2, 0.2)}
    _, infos = env.reset(seed=1, options=place)
    x, y, _ = infos["robot2"]["pose"]
    env.reset(seed=1, options={**place, "start": (1.0, 1.0, np.arctan2(y - 1, x - 1)), "target": (1.8, 0.2)})
    for _ in range(3):
        _, rewards, _, _, infos = env.step({"robot1": FORWARD, "robot2": WAIT})
    hulls_m = 2 * EXACT.robot.hull.turning_m
    assert gap_m(infos) == pytest.approx(hulls_m, abs=1e-6)
    assert rewards == {"robot1": -1.0, "robot2": 0.0}
    np.testing.assert_allclose(infos["robot2"]["pose"][:2], (x, y))
    rng = np.random.default_rng(1)
    for _ in range(60):
        if not env.agents:
            env.reset()
        infos = env.step({agent: rng.choice([0, 0, 1, 2]) for agent in env.agents})[4]
        assert gap_m(infos) >= hulls_m - 1e-6


def test_arrival_of_a_robot_ends_the_search_of_all():
    """Of two steps of 0.25 m to a target at 0.7 m; only the robot that arrives has the reward."""
    env = made(room(6, 6), ("lidar",), config=EXACT)
    env.reset(seed=1, options={"start": (3.0, 3.0, 0.0), "target": (3.7, 3.0)})
    ends = []
    while env.agents:
        _, rewards, terminated, truncated, infos = env.step({"robot1": FORWARD, "robot2": WAIT})
        ends.append(terminated)
    assert ends == [dict.fromkeys(env.possible_agents, ended) for ended in (False, True)]
    assert not any(truncated.values())
    assert infos["robot1"]["rewards"]["arrival"] == 10.0
    assert infos["robot2"]["rewards"]["arrival"] == 0.0
    assert rewards["robot2"] == pytest.approx(-0.01)  # it waited
    with pytest.raises(RuntimeError, match="Call reset first"):
        env.step({})
    env.reset()
    assert env.agents == env.possible_agents


def test_search_is_truncated_after_its_most_steps():
    env = made(observe=("pose",), max_steps=3)
    env.reset(seed=1)
    late = [env.step(dict.fromkeys(env.agents, LEFT))[3] for _ in range(3)]
    assert [any(agents.values()) for agents in late] == [False, False, True]
    assert late[-1] == {"robot1": True, "robot2": True}
    assert env.agents == []


def test_render_draws_all_robots():
    """Each has its colour in a picture of the plan."""
    env = made(observe=("pose",), robots=3, render_mode="rgb_array")
    env.reset(seed=1)
    first = env.render()
    for _ in range(4):
        env.step(dict.fromkeys(env.agents, FORWARD))
    last = env.render()
    assert first.shape == last.shape and last.dtype == np.uint8
    colours = [set(map(tuple, picture.reshape(-1, 3).tolist())) for picture in (first, last)]
    assert all(robot_colour(number) in colours[1] for number in range(3))
    assert not np.array_equal(first, last)
    assert made(observe=("pose",)).render() is None


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"robots": 0}, ValueError, "robots is 0"),
        ({"robots": 1.5}, ValueError, r"robots is 1\.5"),
        ({"max_steps": 0}, ValueError, "max_steps is 0"),
        ({"render_mode": "ansi"}, ValueError, "render_mode = 'ansi', expected None or one of rgb_array"),
        ({"observe": ("sonar",)}, ValueError, "observe is 'sonar'"),
        ({"sonar": True}, TypeError, "sonar"),
    ],
)
def test_parallel_env_rejects_unknown_settings(options, error, message, monkeypatch):
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)  # it would be first to complain
    with pytest.raises(error, match=message):
        made(**{"observe": ("pose",), **options})


def test_reset_and_step_reject_what_they_do_not_know():
    """Options, actions of a part of the agents, and more robots than there is room for."""
    env = made(observe=("pose",))
    with pytest.raises(RuntimeError, match="Call reset first"):
        env.step({})
    with pytest.raises(ValueError, match="Unknown reset options"):
        env.reset(options={"goal": 1})
    env.reset(seed=1)
    with pytest.raises(ValueError, match="expected one of each of"):
        env.step({"robot1": FORWARD})
    with pytest.raises(ValueError, match=r"actions are of \['2', 'robot1'\]"):
        env.step({"robot1": FORWARD, 2: FORWARD})
    with pytest.raises(MapError, match="there is room for"):
        made(room(1.5, 1.5), ("pose",), robots=9).reset(seed=1)


@pytest.mark.parametrize(
    ("actions", "action"),
    [
        *(("discrete", action) for action in (-1, 4, 1.5, None, "left", np.nan, np.zeros(2))),
        *(("velocity", action) for action in (0.5, [0.5], None, "left", np.zeros((2, 2)), [np.nan, 0.0])),
        *(("velocity", action) for action in (["1", "0"], [True, False])),
    ],
)
def test_step_rejects_what_is_no_action_before_a_robot_moves(actions, action):
    env = made(observe=("pose",), actions=actions)
    env.reset(seed=1)
    good = env.action_space("robot1").sample()
    with pytest.raises(ValueError, match=r"an action is .*, expected"):
        env.step({"robot1": good, "robot2": action})
    poses = [search.robot.pose for search in env._searches.robots.values()]
    assert np.array_equal(poses, env._trails[0])


def test_people_walk_among_robots_by_the_seed():
    """Depth, in which they are seen, is that of another environment with the same seed, and of no other seed."""
    walked = SimulatorConfig(physics="kinematic", camera="plan", movers=MoversConfig(people=3))
    seen = []
    for seed in (1, 1, 2):
        env = made(observe=("depth",), config=walked)
        env.reset(seed=seed)
        for _ in range(5):
            observed = env.step(dict.fromkeys(env.agents, 3))[0]  # all wait
        seen.append(np.stack([observed[name]["depth"] for name in env.possible_agents]))
        env.close()
    assert np.array_equal(seen[0], seen[1]) and not np.array_equal(seen[0], seen[2])


def test_parallel_env_names_the_extra_that_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "pettingzoo", None)
    monkeypatch.delitem(sys.modules, "robosim.environments.target_search_team")
    with pytest.raises(ImportError) as raised:
        parallel_env("flat")
    assert str(raised.value) == (
        "An environment of several robots needs pettingzoo, which is not installed: "
        + install_command("team")
    )
