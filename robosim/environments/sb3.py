"""Many searches as a vector environment of Stable-Baselines3, whose interface differs from Gymnasium's."""

from typing import TYPE_CHECKING, Any

from gymnasium.wrappers import TimeLimit

from robosim.environments.target_search import TargetSearch
from robosim.support.checks import check_number

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import DummyVecEnv


def sb3_vec_env(
    num_envs: int = 1,
    plan: object = "flat",
    *,
    seed: int = 0,
    max_episode_steps: int = 1000,
    threads: int | None = 1,
    **search: Any,
) -> "DummyVecEnv":
    """Searches in one process as a vector environment of Stable-Baselines3.

    Use it as in `PPO("MultiInputPolicy", sb3_vec_env(8, "homes:50", targets=2)).learn(100_000)`. Robots share
    buildings, their scenes and tables. After the last step of a search the next one starts within the same call: the
    last observation is `infos[i]["terminal_observation"]`, and `infos[i]["episode"]` has return and length.

    Args:
        num_envs: Number of robots.
        plan: Source of plans: see `robosim.environments.sources`.
        seed: Seed of robot 0; robot i has seed + i.
        max_episode_steps: Steps after which a search is truncated.
        threads: Threads of PyTorch in this process; for such small networks one is several times faster than one per
            core. None does not change them.
        search: Other arguments of `TargetSearch`.

    Raises:
        ImportError: If Stable-Baselines3 is not installed.
        ValueError: If an argument is out of bounds; MapError if there is no such plan.
    """
    check_number("num_envs", num_envs, 1, 65536, "robots", whole=True)
    check_number("max_episode_steps", max_episode_steps, 1, 10**9, "steps", whole=True)
    try:
        import torch
        from stable_baselines3.common.monitor import Monitor
        from stable_baselines3.common.vec_env import DummyVecEnv
    except ImportError as error:
        raise ImportError(
            "sb3_vec_env needs Stable-Baselines3: pip install stable-baselines3.", name=error.name
        ) from error
    if threads is not None:
        check_number("threads", threads, 1, 1024, "threads", whole=True)
        torch.set_num_threads(threads)
    made = DummyVecEnv(
        [lambda: Monitor(TimeLimit(TargetSearch(plan, **search), max_episode_steps))] * num_envs
    )
    made.seed(seed)
    return made
