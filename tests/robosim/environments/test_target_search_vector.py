"""Many robots in one process: step for step what lone environments do, also for Stable-Baselines3."""

import sys
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

from robosim import parallel_env, sb3_vec_env
from robosim.environments.sources import shared_place
from robosim.environments.target_search_vector import TargetSearchVector
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.world import ROBOT
from tests.plans import two_rooms

PLAN = two_rooms(0.8)
OPTIONS = {"plan": PLAN, "observe": ("depth", "lidar", "odometry", "radio", "pose"), "targets": 2}
ID = "robosim/TargetSearch-v1"


def assert_same(first, second, what: str = "") -> None:
    """See that observations, or infos, are the same, key by key."""
    if isinstance(first, dict):
        assert first.keys() == second.keys(), what
        for key in first:
            assert_same(first[key], second[key], f"{what} {key}")
    else:
        assert np.asarray(first).dtype == np.asarray(second).dtype, what
        assert np.array_equal(first, second), what


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_it_does_step_for_step_what_lone_environments_do(mode):
    """Observations, rewards, ends and infos, over searches that end and start again after 12 steps."""
    ours = gymnasium.make_vec(ID, 3, vectorization_mode="vector_entry_point", max_episode_steps=12, **OPTIONS)
    # A spec of its own: `make_vec` cannot otherwise end searches of lone environments early.
    spec = gymnasium.spec(ID)
    before, spec.max_episode_steps = spec.max_episode_steps, 12
    # Processes of their own begin afresh: a fork would copy locks of threads that are not there any more.
    how = {"context": "spawn"} if mode == "async" else {}
    try:
        theirs = gymnasium.make_vec(ID, 3, vectorization_mode=mode, vector_kwargs=how, **OPTIONS)
    finally:
        spec.max_episode_steps = before
    rng = np.random.default_rng(0)
    for a, b in zip(ours.reset(seed=4), theirs.reset(seed=4), strict=True):
        assert_same(a, b)
    ended = 0
    for _ in range(30):
        actions = rng.choice([0, 0, 1, 2], 3)
        first, second = ours.step(actions), theirs.step(actions)
        for name, a, b in zip(
            ("observation", "reward", "arrived", "late", "info"), first, second, strict=True
        ):
            assert_same(a, b, name)
        ended += int(first[3].sum())
    assert ended >= 6
    ours.close()
    theirs.close()


def test_a_robot_does_not_depend_on_how_many_there_are():
    """The first of one, two and four does the same, bit for bit."""
    runs = []
    for count in (1, 2, 4):
        env = TargetSearchVector(count, **OPTIONS)
        seen = [env.reset(seed=9)[0]]
        seen += [env.step(np.full(count, action))[0] for action in (0, 1, 0, 2, 0, 0)]
        runs.append(np.concatenate([np.ravel(one[key][0]) for one in seen for key in sorted(one)]))
        env.close()
    assert np.array_equal(runs[0], runs[1])
    assert np.array_equal(runs[0], runs[2])


@pytest.mark.parametrize("count", [1, 3])
def test_step_takes_an_action_of_each_robot(count):
    env = TargetSearchVector(2, PLAN, observe=("pose",))
    with pytest.raises(ValueError, match=f"there are {count} actions, expected one of each of 2 robots"):
        env.step(np.zeros(count, int))


def test_no_robot_moves_if_an_action_of_another_is_none():
    env = TargetSearchVector(3, PLAN, observe=("pose",))
    before, _ = env.reset(seed=0)
    before = {key: values.copy() for key, values in before.items()}
    with pytest.raises(ValueError, match="an action is 9, expected a number of 0 to 2"):
        env.step(np.array([1, 0, 9]))
    seen, *_ = env.step(np.array([1, 1, 1]))
    env.reset(seed=0)
    assert_same(seen, env.step(np.array([1, 1, 1]))[0])
    assert not np.array_equal(seen["pose"], before["pose"])


def test_teams_do_step_for_step_what_lone_teams_do():
    """Two teams of two, over searches that end and start again after 6 steps."""
    ours = gymnasium.make_vec(ID, 4, robots=2, max_episode_steps=6, **OPTIONS)
    lone = [parallel_env(robots=2, max_steps=6, **OPTIONS) for _ in range(2)]
    names, rng, ended = lone[0].possible_agents, np.random.default_rng(0), 0
    seen, _ = ours.reset(seed=3)
    begun = [env.reset(seed=3 + i)[0] for i, env in enumerate(lone)]
    assert_same(seen, batch(begun, names))
    for _ in range(15):
        actions = rng.choice([0, 0, 1, 2, 3], 4)
        seen, reward, arrived, late, _ = ours.step(actions)
        results = []
        for env, pair in zip(lone, actions.reshape(2, 2), strict=True):
            if env.agents:
                results.append(env.step(dict(zip(names, pair, strict=True))))
            else:
                results.append(
                    (env.reset()[0], *(dict.fromkeys(names, over) for over in (0.0, False, False)))
                )
        assert_same(seen, batch([result[0] for result in results], names))
        for values, column in ((reward, 1), (arrived, 2), (late, 3)):
            assert_same(values, np.array([result[column][name] for result in results for name in names]))
        ended += int(late.sum())
    assert ended == 8
    ours.close()


def batch(observations, names):
    """Observations of the agents of all teams, one after the other."""
    return {
        key: np.stack([seen[name][key] for seen in observations for name in names])
        for key in observations[0][names[0]]
    }


def test_teams_are_whole():
    """Numbers of robots and masks that cut a team are rejected; a team starts again together."""
    with pytest.raises(ValueError, match="multiple of the 2 robots"):
        TargetSearchVector(3, plan=PLAN, robots=2)
    env = TargetSearchVector(4, plan=PLAN, robots=2, observe=("pose",))
    env.reset(seed=0)
    before = env.step(np.zeros(4, int))[0]
    with pytest.raises(ValueError, match="all robots of a team"):
        env.reset(options={"reset_mask": np.array([True, False, False, False])})
    after, _ = env.reset(options={"reset_mask": np.array([False, False, True, True])})
    assert np.array_equal(after["pose"][:2], before["pose"][:2])
    assert not after["pose"][2:].any()


def test_few_buildings_with_a_radio_are_cached(monkeypatch):
    """Their tables take much memory; those without one stay."""
    monkeypatch.setattr("robosim.environments.sources._WITH_RADIO", 2)
    config = SimulatorConfig(physics="kinematic", camera="none", robot=RobotConfig(lidar="ring-64"))
    plain = shared_place(PLAN, config, uses_radio=False)
    plans = [replace(PLAN) for _ in range(3)]
    first, *others = [shared_place(plan, config, uses_radio=True) for plan in plans]
    assert [shared_place(plan, config, uses_radio=True) for plan in plans[1:]] == others
    assert shared_place(plans[0], config, uses_radio=True) is not first
    assert shared_place(PLAN, config, uses_radio=False) is plain


def test_robots_share_a_building_and_not_their_poses():
    config = SimulatorConfig(physics="dynamic", camera="none", robot=RobotConfig(lidar="ring-64"))
    place = shared_place(PLAN, config, uses_radio=False)
    assert shared_place(PLAN, config, uses_radio=False) is place
    first, second = (place.world().robots[ROBOT] for _ in range(2))
    first.world.reset(np.array([1.0, 1.0, 0.0]))
    second.world.reset(np.array([2.0, 2.0, 1.0]))
    first.world.move(np.array([0.25, 0.0, 0.0]))
    assert first.world.model is second.world.model
    assert second.world.pose == pytest.approx([2.0, 2.0, 1.0], abs=1e-6)
    assert first.world.pose[0] == pytest.approx(1.25, abs=2e-3)


def test_seeds_of_numpy_are_seeds():
    """An integer of NumPy starts the same searches as one of Python."""
    env = TargetSearchVector(2, plan=PLAN, observe=("pose",))
    first, second = (env.reset(seed=seed)[1]["target"] for seed in (3, np.int64(3)))
    np.testing.assert_array_equal(first, second)


def test_robots_rest_without_autoreset():
    """After the end of its search a robot keeps its observation, and has no reward."""
    env = TargetSearchVector(2, plan=PLAN, observe=("pose",), max_episode_steps=2, autoreset=False)
    env.reset(seed=0)
    for _ in range(2):
        last, *_ = env.step(np.zeros(2, int))
    after, reward, arrived, late, infos = env.step(np.zeros(2, int))
    np.testing.assert_array_equal(after["pose"], last["pose"])
    assert not reward.any() and not arrived.any() and not late.any() and infos == {}


def test_some_may_start_again():
    """`reset_mask` does not change the others' observations; senseless masks are rejected."""
    env = TargetSearchVector(3, plan=PLAN, observe=("pose", "lidar"))
    with pytest.raises(ValueError, match=r"reset_mask is .* at first all"):
        env.reset(seed=0, options={"reset_mask": np.array([False, True, False])})
    env.reset(seed=0)
    before = env.step(np.zeros(3, int))[0]
    after, _ = env.reset(seed=[7, 8, 9], options={"reset_mask": np.array([False, True, False])})
    assert np.array_equal(after["pose"][[0, 2]], before["pose"][[0, 2]])
    assert np.array_equal(after["pose"][1], np.zeros(3))
    with pytest.raises(ValueError, match="reset_mask"):
        env.reset(options={"reset_mask": np.zeros(3, bool)})
    with pytest.raises(ValueError, match="seed has 2 numbers"):
        env.reset(seed=[1, 2])


def test_pictures_of_all():
    env = TargetSearchVector(2, plan=PLAN, observe=("pose",), render_mode="ansi")
    env.reset(seed=0)
    assert [text.count("X") for text in env.render()] == [1, 1]


SB3_OPTIONS = {"plan": two_rooms(0.8), "observe": ("lidar", "odometry"), "targets": 2}


@pytest.fixture(autouse=True)
def threads():
    """As many threads of PyTorch after a test as before."""
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def test_ppo_learns_without_an_adapter():
    env = sb3_vec_env(4, max_episode_steps=20, **SB3_OPTIONS)
    policy = PPO("MultiInputPolicy", env, n_steps=32, batch_size=32, seed=0).learn(256)
    assert policy.num_timesteps == 256
    lengths = [episode["l"] for episode in policy.ep_info_buffer]
    assert len(lengths) >= 8 and max(lengths) == 20
    env.close()


def test_sb3_does_step_for_step_what_lone_environments_do():
    """Observations, rewards and infos; of a search that has ended its last observation, and the first of the next."""
    ours = sb3_vec_env(2, seed=4, max_episode_steps=7, **SB3_OPTIONS)
    lone = [gymnasium.make("robosim/TargetSearch-v1", max_episode_steps=7, **SB3_OPTIONS) for _ in range(2)]
    seen = ours.reset()
    for i, env in enumerate(lone):
        first, _ = env.reset(seed=4 + i)
        assert all(np.array_equal(seen[key][i], first[key]) for key in first)
    ended, rng = 0, np.random.default_rng(0)
    for _ in range(20):
        actions = rng.choice([0, 0, 1, 2], 2)
        seen, rewards, dones, infos = ours.step(actions)
        for i, env in enumerate(lone):
            last, reward, arrived, late, info = env.step(actions[i])
            assert rewards[i] == pytest.approx(reward, abs=1e-6)
            assert sum(infos[i]["rewards"].values()) == pytest.approx(reward)
            assert infos[i]["distance_m"] == info["distance_m"]
            assert dones[i] == (arrived or late) and infos[i]["TimeLimit.truncated"] == (late and not arrived)
            if dones[i]:
                final = infos[i]["terminal_observation"]
                assert all(np.array_equal(final[key], last[key]) for key in last)
                assert infos[i]["episode"]["l"] == 7
                last, _ = env.reset()
                ended += 1
            assert all(np.array_equal(seen[key][i], last[key]) for key in last)
    assert ended >= 4
    ours.close()


@pytest.mark.parametrize(("threads", "after"), [(1, 1), (2, 2), (None, 3)])
def test_one_thread_unless_something_else_is_asked_for(threads, after):
    torch.set_num_threads(3)
    sb3_vec_env(1, threads=threads, **SB3_OPTIONS)
    assert torch.get_num_threads() == after


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_envs": 0}, "num_envs is 0"),
        ({"threads": 0}, "threads is 0"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0"),
    ],
)
def test_senseless_settings_are_rejected(options, message):
    with pytest.raises(ValueError, match=message):
        sb3_vec_env(**{**SB3_OPTIONS, **options})


def test_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.monitor", None)
    with pytest.raises(ImportError, match="pip install stable-baselines3"):
        sb3_vec_env()
