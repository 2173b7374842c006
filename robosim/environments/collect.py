"""Searches as a data set to learn from: trajectories with all that is observed, in the format of Minari.

Minari is the data set format of Gymnasium's own foundation: what it opens has this environment's spaces, and gives the
environment back from its id. (LeRobot's is made for cameras and joints of real arms.) Arrays are kept as they are, in
Arrow files, one folder an episode. Episode i has seed + i, whatever was collected before; an interrupted run goes on.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import gymnasium
import numpy as np
from rich.console import Console

from robosim.environments.config import Sense
from robosim.environments.guide import way_action
from robosim.environments.target_search import TargetSearch
from robosim.support.checks import SEED, STEPS, check_choice, check_numbers
from robosim.support.installation import DISTRIBUTION, missing_extra, package_version
from robosim.support.progress import tracked
from robosim.support.run_folder import run_folder
from slam.actions import PUBLISHED

Driver = Literal["way", "random"]
#: Folder of the data set within that of the run, as Minari names it.
DATASET = "data"


@dataclass(frozen=True, kw_only=True)
class CollectSearchesConfig:
    """What is collected."""

    plan: str = "homes:100"
    """Where plans come from: a name, file, folder, suite, or homes:500."""
    episodes: int = 100
    """Searches."""
    observe: tuple[Sense, ...] = ("depth", "odometry", "radio", "pose")
    """What is kept of each step."""
    driver: Driver = "way"
    """way: follows the shortest drive on the true map. random: three of five actions forward."""
    stray: float = 0.1
    """Chance that the way's driver does any action instead."""
    targets: int | None = 4
    """Places of each plan that targets are drawn from; None for anywhere."""
    most_steps: int = 1000
    """Steps after which a search is truncated."""
    seed: int = 0
    """Seed of the first search."""

    def __post_init__(self) -> None:
        check_choice("driver", self.driver, get_args(Driver))
        check_numbers(
            self,
            episodes=(1, 10_000_000),
            stray=(0, 1),
            targets=(1, 10_000, "places in each plan"),
            most_steps=STEPS,
            seed=SEED,
        )


def collect_searches(config: CollectSearchesConfig, out: Path, console: Console) -> Path:
    """Write the searches that are not there yet.

    Args:
        config: What to collect.
        out: Folder of the run.
        console: Where progress is shown.

    Returns:
        Folder of the data set, for `minari.MinariDataset`.

    Raises:
        ImportError: If Minari is not installed.
        FolderError: If the folder holds searches that were collected otherwise.
    """
    try:
        from minari.dataset.minari_storage import MinariStorage
    except ImportError as error:
        raise missing_extra("minari", "A data set of searches") from error
    # More searches of the same kind may be added.
    settings = {key: value for key, value in asdict(config).items() if key != "episodes"}
    env = gymnasium.make(
        "robosim/TargetSearch-v1",
        plan=config.plan,
        observe=config.observe,
        targets=config.targets,
        max_episode_steps=config.most_steps,
    )
    with run_folder(out, "collect-searches", settings) as folder:
        data = (folder / DATASET).absolute()  # Minari puts its folder before paths that are not
        if (data / "metadata.json").is_file():
            storage = MinariStorage.read(data)
        else:
            storage = MinariStorage.new(
                data,
                observation_space=env.observation_space,
                action_space=env.action_space,
                env_spec=env.spec,
                data_format="arrow",
                jpeg_encoding=False,  # depth is a measurement, not a photograph
            )
            storage.update_metadata(_told(config))
        with tracked(range(storage.total_episodes, config.episodes), "searches", console) as shown:
            for number in shown:
                storage.update_episodes([_episode(env, config, number)])
    env.close()
    return data


def _episode(env: gymnasium.Env[Any, Any], config: CollectSearchesConfig, number: int) -> Any:
    """One search, as Minari's buffer."""
    from minari.data_collector.episode_buffer import EpisodeBuffer

    search = env.unwrapped
    assert isinstance(search, TargetSearch)
    seed = config.seed + number
    observation, info = env.reset(seed=seed)
    # Of its own: what drives changes nothing of the search.
    rng = np.random.default_rng([seed, 1])
    seen, steps = [observation], list[tuple[int, float, bool, bool]]()
    while not (steps and (steps[-1][2] or steps[-1][3])):
        action = _driven(search, config, info, rng)
        observation, reward, terminated, truncated, info = env.step(action)
        seen.append(observation)
        steps.append((action, float(reward), terminated, truncated))
    actions, rewards, ends, cuts = zip(*steps, strict=True)
    columns = {key: np.stack([one[key] for one in seen]) for key in observation}
    return EpisodeBuffer(
        id=number,
        seed=seed,
        observations=columns,
        actions=np.array(actions),
        rewards=list(rewards),
        terminations=list(ends),
        truncations=list(cuts),
    )


def _driven(
    search: TargetSearch, config: CollectSearchesConfig, info: dict[str, Any], rng: np.random.Generator
) -> int:
    """The next action."""
    strays, any_action, often_forward = (
        rng.random(),
        rng.integers(len(PUBLISHED)),
        rng.choice([0, 0, 0, 1, 2]),
    )
    if config.driver == "random":
        return int(often_forward)
    if strays < config.stray:
        return int(any_action)
    return int(way_action(search.place, info["pose"], info["target"]))


def _told(config: CollectSearchesConfig) -> dict[str, Any]:
    """What Minari wants to know of a data set."""
    return {
        "dataset_id": f"robosim/target-search/{config.driver}-v0",
        "minari_version": package_version("minari"),
        "algorithm_name": config.driver,
        "description": f"Searches for a target in {config.plan}, by robosim {package_version()}.",
        "requirements": [f"{DISTRIBUTION}=={package_version()}"],
    }
