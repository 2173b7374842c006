"""Small example of learning to find a transmitter: PPO of Stable-Baselines3, radio and lidar, generated homes.

    python learn_with_sb3.py --steps 300000

The policy has no memory, so it can follow the strongest path and avoid walls, but not more. Targets are near at first
and farther away as the success rate grows. At the end the script compares the policy with random actions, and with
agents that map and plan, in unseen homes.
"""

import argparse

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

import robosim
from robosim import GeneratedHomes, GeneratorConfig
from robosim.environments.baseline import Baseline

SEARCH = {
    "observe": ("lidar", "radio"),
    "targets": 2,
    "difficulty": 0.0,
    "rewards": {"arrival": 10.0, "progress": 1.0, "collision": -0.1, "step": -0.01},
    "max_episode_steps": 300,
}


def scores(env: gymnasium.Env, act, searches: int) -> tuple[float, float]:
    """Share of searches that end with success, and their success weighted by path length (SPL)."""
    arrived, spl = 0, 0.0
    for seed in range(searches):
        observation, info = env.reset(seed=seed)
        shortest_m, driven_m, done = info["distance_m"], 0.0, False
        while not done:
            before = info["pose"]
            observation, _, terminated, truncated, info = env.step(act(observation))
            driven_m += float(np.hypot(*(info["pose"] - before)[:2]))
            done = terminated or truncated
        arrived += terminated
        spl += terminated * shortest_m / max(shortest_m, driven_m)
    return arrived / searches, spl / searches


def main(steps: int, robots: int = 8, searches: int = 20, homes: int = 10) -> dict[str, tuple[float, float]]:
    """Train, then compare."""
    small = GeneratorConfig(rooms=3, area_m2=35.0)
    seen, unseen = (GeneratedHomes(count=homes, seed=seed, config=small) for seed in (0, 10_000))
    train = robosim.sb3_vec_env(robots, seen, curriculum=True, **SEARCH)
    train = VecNormalize(train, norm_obs_keys=["lidar", "path_delay", "path_snr"])
    policy = PPO("MultiInputPolicy", train, n_steps=256, batch_size=512, gamma=0.98, seed=0)
    policy.learn(steps)
    train.training = False
    test = gymnasium.make("robosim/TargetSearch-v1", plan=unseen, **SEARCH)
    rng = np.random.default_rng(0)
    snr, oracle = Baseline(test, "snr"), Baseline(test, "oracle")
    return {
        "learned": scores(test, lambda o: int(policy.predict(train.normalize_obs(o))[0]), searches),
        "at random": scores(test, lambda o: int(rng.choice([0, 0, 0, 1, 2])), searches),
        "snr": scores(test, lambda o: snr.act(), searches),
        "oracle": scores(test, lambda o: oracle.act(), searches),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=300_000)
    for name, (share, spl) in main(parser.parse_args().steps).items():
        print(f"{name}: {100 * share:.0f} % arrived, SPL {spl:.2f}")
