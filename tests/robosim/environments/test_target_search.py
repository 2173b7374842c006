"""TargetSearch-v1: the contract of Gymnasium, what is observed, rewarded and drawn."""

from dataclasses import replace

import gymnasium
import jaxtyping
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_sb3

from robosim.environments.config import SearchConfig
from robosim.environments.search import Curriculum, longest_drive_m
from robosim.environments.sources import GeneratedHomes
from robosim.environments.target_search import TargetSearch
from robosim.generator.generate import GeneratorConfig
from robosim.movers.movers import MoversConfig
from robosim.plans.files import write_ros
from robosim.radio.link import RadioLinkConfig
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from tests.plans import room, two_rooms

ALL = ("rgb", "depth", "lidar", "odometry", "radio", "map", "pose")
PLAN = two_rooms(0.8)


def made(plan=PLAN, **options) -> TargetSearch:
    return TargetSearch(plan, targets=2, **options)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"observe": ("lidar", "radio", "pose")},
        {"observe": ALL, "actions": "velocity"},
        {"observe": ("radio", "map")},
    ],
)
def test_gymnasium_and_stable_baselines_accept_it(options):
    """Without a warning, which would fail this test."""
    env = gymnasium.make("robosim/TargetSearch-v1", plan=PLAN, targets=2, render_mode="rgb_array", **options)
    check_env(env.unwrapped)
    check_env_sb3(env.unwrapped)
    env.close()


def test_velocity_actions_are_fractions_of_what_the_robot_can_do():
    """Speed and turn rate of a step of 0.5 s, exactly."""
    v, w = 1.2, 0.8
    robot = RobotConfig(max_speed_mps=v, max_turn_rate_radps=w)
    config = SimulatorConfig(physics="kinematic", camera="plan", robot=robot)
    env = made(config=config, observe=("depth",), actions="velocity")
    env.reset(seed=1, options={"start": (1.5, 1.5, 0.0), "target": (4.5, 1.5)})
    info = env.step(np.array([0.5, 0.0], np.float32))[4]
    np.testing.assert_allclose(info["pose"], [1.5 + 0.25 * v, 1.5, 0.0], atol=1e-9)
    info = env.step(np.array([0.0, 0.5], np.float32))[4]
    assert info["pose"][2] == pytest.approx(0.25 * w)
    env.close()


def test_robots_among_people_can_wait():
    """Accepted by the checker, and the same for the same seed."""
    config = SimulatorConfig(physics="kinematic", camera="plan", movers=MoversConfig(people=2))
    env, again = (TargetSearch(PLAN, config=config, targets=2, observe=("depth",)) for _ in range(2))
    check_env(env, skip_render_check=True)
    assert env.action_space.n == 4
    for one in (env, again):
        one.reset(seed=1)
    for action in (3, 3, 0, 1, 3):
        ours, theirs = env.step(action), again.step(action)
        np.testing.assert_array_equal(ours[0]["depth"], theirs[0]["depth"])
    for one in (env, again):
        one.close()


def rollout(env, seed: int, steps: int = 25) -> list:
    actions = np.random.default_rng(seed).integers(3, size=steps)
    seen = [(*env.reset(seed=seed), 0.0)]
    for action in actions:
        observation, reward, terminated, _, info = env.step(int(action))
        seen.append((observation, info, reward))
        if terminated:
            break
    return seen


def test_same_seed_same_rollout():
    """Bit-identical, in a new environment too; another seed starts in another place."""
    env, other = made(observe=ALL), made(observe=ALL)
    first, again, second = rollout(env, 5), rollout(env, 5), rollout(other, 5)
    for twin in (again, second):
        for (a, info_a, reward_a), (b, info_b, reward_b) in zip(first, twin, strict=True):
            assert all(np.array_equal(a[key], b[key]) for key in a)
            assert reward_a == reward_b
            assert np.array_equal(info_a["pose"], info_b["pose"])
    assert not np.array_equal(rollout(env, 6)[0][1]["pose"], first[0][1]["pose"])
    env.close()
    other.close()


def test_radio_is_observed_in_the_robots_frame():
    """2 m from the target in an open room the strongest path comes from there, turned by the robot's heading."""
    env = made(observe=("radio",))
    observation, _ = env.reset(seed=0, options={"start": [0.7, 1.5, 0.6], "target": [2.3, 1.9]})
    expected = np.arctan2(0.4, 1.6) - 0.6
    assert observation["path_found"][0] == 1
    assert abs(observation["path_direction"][0] - expected) < np.radians(3)
    assert observation["path_delay"][0] == 0
    assert observation["link_state"].argmax() == 1
    snr = observation["path_snr"][observation["path_found"] == 1]
    assert (np.diff(snr) <= 0).all()


def test_map_shows_floor_ahead_and_the_wall_behind_it():
    """From 1 m before a wall, heading for it: floor from the robot up to the wall, 10 cells of 0.1 m on, then wall."""
    env = made(observe=("map", "lidar"))
    observation, _ = env.reset(seed=0, options={"start": [1.0, 1.0, -np.pi / 2], "target": [2.5, 2.5]})
    column = observation["map"][:, 31:33, 0]
    assert (column[23:31] == 128).all()
    assert (column[:20] != 128).all()


def test_walls_lie_on_the_map_where_they_are():
    """Ahead of a robot that looks along +x, the wall between the rooms is seen at its distance."""
    env = made(observe=("map", "depth"))
    observation, _ = env.reset(seed=0, options={"start": [2.0, 0.7, 0.0], "target": [0.7, 2.5]})
    ahead = observation["map"][:, 31:33, 0]  # row 31.5 is the robot's place
    wall = 31.5 - 1.05 / 0.1  # 3.0 m is where the wall begins, cells of it are 0.05 m wide
    found = np.flatnonzero((ahead == 255).any(axis=1))
    assert len(found)
    assert abs(found.max() - wall) <= 1


def test_pose_is_what_was_driven_since_the_start():
    """Without noise: a step of 0.25 m and a turn of 10 degrees, whatever the heading at the start."""
    config = SimulatorConfig(
        physics="kinematic", camera="none", robot=RobotConfig(lidar="ring-64", noise=NoiseModel(level=0))
    )
    env = made(observe=("pose",), config=config)
    first, _ = env.reset(seed=0, options={"start": [1.0, 1.5, 2.0], "target": [5.0, 1.5]})
    assert np.array_equal(first["pose"], np.zeros(3, np.float32))
    env.step(0)
    second = env.step(1)[0]["pose"]
    assert second == pytest.approx([0.25, 0.0, np.radians(10)], abs=1e-6)


def test_rewards_are_the_weighted_sum_of_their_terms():
    """Driving at a wall: a collision and a step cost; progress is what `distance_m` says; all by their weights."""
    weights = {
        "progress": 2.0,
        "step": -0.5,
        "collision": -3.0,
        "coverage": 1.0,
        "link_state": 4.0,
        "snr": 0.1,
    }
    env = made(observe=("depth",), rewards=weights)
    _, info = env.reset(seed=1, options={"start": [1.0, 0.4, -np.pi / 2], "target": [5.0, 2.5]})
    before, collided = info["distance_m"], 0
    for action in (0, 0, 1, 1, 1):
        _, reward, _, _, info = env.step(action)
        terms = info["rewards"]
        assert set(terms) == set(weights)
        assert reward == sum(terms.values())
        assert terms["step"] == -0.5
        assert terms["progress"] == pytest.approx(2 * (before - info["distance_m"]))
        assert terms["collision"] == -3 * info["collided"]
        before, collided = info["distance_m"], collided + info["collided"]
    assert collided > 0


def test_terms_of_ones_own_have_names():
    """They see observation and `info` of the step; weighted like the others, they add up to the reward."""

    def facing(observation, info):
        return np.float32(0.5) * (observation["pose"][2] > 0)

    env = made(
        observe=("pose",), rewards={"step": -0.25, "facing": facing, "near": lambda o, i: i["distance_m"] < 9}
    )
    env.reset(seed=1)
    for action, faces in ((0, 0.0), (1, 0.5), (1, 0.5)):
        _, reward, _, _, info = env.step(action)
        assert info["rewards"] == {"step": -0.25, "facing": faces, "near": 1.0}
        assert reward == 0.75 + faces


def test_a_term_of_ones_own_that_is_no_number_is_named():
    env = made(observe=("pose",), rewards={"broken": lambda observation, info: np.nan})
    env.reset(seed=1)
    with pytest.raises(ValueError, match="reward term broken is nan"):
        env.step(0)


def test_coming_into_sight_is_rewarded():
    """From behind the wall to where the target is in line of sight the link's worth rises to 1 in all."""
    config = SimulatorConfig(
        physics="kinematic",
        camera="none",
        radio=RadioLinkConfig(engine="table"),
        robot=RobotConfig(lidar="ring-64", noise=NoiseModel(level=0)),
    )
    env = made(observe=("lidar",), rewards={"link_state": 1.0}, config=config)
    env.reset(seed=0, options={"start": [2.0, 0.4, np.pi / 2], "target": [5.5, 1.5]})
    total = sum(env.step(0)[1] for _ in range(4))
    assert 0 < total <= 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"observe": ("sonar",)}, "observe is 'sonar'"),
        ({"observe": ()}, "observe is empty"),
        ({"rewards": {"arival": 1.0}}, "rewards has 'arival': float. Known terms"),
        ({"rewards": {"step": len}}, "rewards has 'step': builtin_function_or_method. Known terms"),
        ({"difficulty": 1.5}, r"difficulty is 1\.5"),
        ({"rewards": ["step"]}, r"rewards is \['step'\], expected a dictionary"),
        ({"render_mode": "human"}, "render_mode = 'human'"),
        ({"observe": ("lidar",), "config": SimulatorConfig()}, "the simulator's lidar is 'none'"),
    ],
)
def test_senseless_settings_are_rejected(options, message, monkeypatch):
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)  # it would be first to complain
    with pytest.raises(ValueError, match=message):
        TargetSearch(PLAN, **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"goal": 1}, "goal"),
        ({"plan": 3}, "plan is 3, expected a whole number from 0 to 0"),
        ({"plan": np.array([0, 0])}, r"plan is \[0 0\], expected a whole number from 0 to 0"),
        ({"plan": False}, "plan is False, expected a whole number"),
        ({"difficulty": -1}, r"difficulty is -1, expected 0 to 1"),
        ({"difficulty": "hard"}, r"difficulty is 'hard', expected 0 to 1"),
        ({"difficulty": np.nan}, "difficulty is nan"),
    ],
)
def test_senseless_options_of_a_reset_are_rejected(options, message):
    with pytest.raises(ValueError, match=message):
        made(observe=("pose",)).reset(options=options)


def test_step_and_render_need_a_reset():
    env = made(observe=("pose",), render_mode="rgb_array")
    for call in (lambda: env.step(0), env.render):
        with pytest.raises(RuntimeError, match="Call reset first"):
            call()


def test_arrival_is_rewarded_once():
    env = made(observe=("pose",))
    env.reset(seed=0, options={"start": (1.0, 1.0, 0.0), "target": (1.5, 1.0)})
    assert env.step(0)[2]
    with pytest.raises(RuntimeError, match=r"it has ended\. Call reset first"):
        env.step(0)


def test_a_failed_reset_ends_the_search():
    """Its failure counts once in the curriculum, and no step mixes the old task with another plan."""
    env = made(observe=("pose",), curriculum=True, difficulty=0.5)
    env.reset(seed=0)
    for _ in range(10):
        with pytest.raises(ValueError, match="Reset option plan"):
            env.reset(options={"plan": 7})
    assert env.reset()[1]["difficulty"] == 0.5


def test_plans_of_a_folder_are_drawn_or_chosen(tmp_path):
    """All plans come up; `plan` chooses one."""
    for name, door in (("narrow", 0.7), ("wide", 1.2)):
        write_ros(replace(two_rooms(door), name=name), tmp_path / f"{name}.yaml")
    env = made(tmp_path, observe=("pose",))
    drawn = {env.reset(seed=seed)[1]["plan"] for seed in range(12)}
    assert drawn == {"narrow", "wide"}
    assert {env.reset(options={"plan": 1})[1]["plan"] for _ in range(4)} == {"wide"}


def test_tasks_of_a_suite_are_taken_as_they_are(tmp_path):
    write_ros(PLAN, tmp_path / "rooms.yaml")
    (tmp_path / "suite.yaml").write_text(
        "seed: 0\nplans: {rooms: rooms.yaml}\ntasks:\n- {plan: rooms, start: [1.0, 1.5, 90.0], target: [5.0, 1.0]}\n"
    )
    env = TargetSearch(tmp_path / "suite.yaml", observe=("pose",))
    _, info = env.reset(seed=3)
    assert info["pose"] == pytest.approx([1.0, 1.5, np.pi / 2])
    assert info["target"] == pytest.approx([5.0, 1.0])


def test_homes_are_made_from_their_numbers():
    """Two environments of the same homes agree on which home is number 1; it is another than number 0."""
    homes = GeneratedHomes(count=2, seed=7, config=GeneratorConfig(rooms=2, area_m2=25.0))
    names = [
        TargetSearch(source, observe=("pose",)).reset(seed=0, options={"plan": number})[1]["plan"]
        for source, number in (
            (homes, 1),
            (GeneratedHomes(count=1, seed=8, config=homes.config), 0),
            (homes, 0),
        )
    ]
    assert names[0] == names[1] != names[2]


def test_difficulty_bounds_the_drive():
    """At difficulty 0 the shortest drive is 3 to 5 m, less the arrival radius; at 1 it may be anything."""
    env = TargetSearch("flat", observe=("pose",))
    near = [env.reset(seed=s, options={"difficulty": 0.0})[1]["distance_m"] for s in range(6)]
    far = [env.reset(seed=s)[1]["distance_m"] for s in range(6)]
    assert min(near) > 2.9
    assert max(near) < 5.3
    assert max(far) > 5.3
    assert longest_drive_m(0.5, 3.0) == pytest.approx(3 + 2 + 30 / 4)


def test_curriculum_follows_arrivals():
    """Ten arrivals raise difficulty by a step, ten failures lower it, and it stays within 0 and 1."""
    follows = Curriculum(0.5, moves=True)
    for _ in range(10):
        follows.record(True)
    assert follows.difficulty == pytest.approx(0.55)
    for _ in range(20):
        follows.record(False)
    assert follows.difficulty == pytest.approx(0.45)
    for _ in range(300):
        follows.record(True)
    assert follows.difficulty == 1.0
    stays = Curriculum(0.5, moves=False)
    for _ in range(30):
        stays.record(True)
    assert stays.difficulty == 0.5


def test_plan_in_letters():
    """Walls, floor, target and the robot by its heading, at their places."""
    env = made(observe=("pose",), render_mode="ansi")
    env.reset(seed=0, options={"start": [1.0, 1.5, np.pi / 2], "target": [5.0, 1.5]})
    lines = env.render().splitlines()
    rows = [i for i, line in enumerate(lines) if "^" in line or "X" in line]
    assert len(rows) == 1
    line = lines[rows[0]]
    # 6.2 m in 62 letters of 0.1 m.
    assert line.index("^") == 10
    assert line.index("X") == 50


def test_picture_is_drawn():
    env = made(observe=("depth",), render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    assert picture.dtype == np.uint8
    assert picture.ndim == 3
    assert picture.std() > 10


def test_ids():
    """The environment is made by its id with any of its options."""
    with gymnasium.make("robosim/TargetSearch-v1", plan=PLAN, observe=("pose",)) as env:
        assert env.spec.max_episode_steps == 1000
        assert set(env.observation_space) == {"pose"}
    assert SearchConfig().observe == ("depth", "odometry", "radio")


def test_seeds_of_numpy_are_seeds():
    """An integer of NumPy starts the same search as one of Python."""
    env = made(observe=("pose",))
    first, second = (env.reset(seed=seed)[1]["target"] for seed in (3, np.int64(3)))
    np.testing.assert_array_equal(first, second)


def test_odometry_of_fast_robots_is_not_clipped():
    """8 m/s for half a second are 4 m."""
    robot = RobotConfig(max_speed_mps=8.0, noise=NoiseModel(level=0))
    config = SimulatorConfig(physics="kinematic", camera="plan", robot=robot)
    env = TargetSearch(room(9.0, 3.0), config=config, observe=("odometry",), actions="velocity")
    env.reset(seed=0, options={"start": [1.0, 1.5, 0.0], "target": [8.0, 1.5]})
    observation = env.step(np.array([1.0, 0.0]))[0]
    assert env.observation_space.contains(observation)
    assert observation["odometry"][0] == pytest.approx(4.0)
