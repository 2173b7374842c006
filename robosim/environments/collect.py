"""Searches as a data set to learn from, in Minari's format: all observations, actions and rewards, in Arrow files.

Episode i has seed + i, whatever was collected before; an interrupted run continues. `metadata.json` of a folder that
exists is compared with what this command writes before Minari opens it, since Minari makes the environment that the
file names where the file lacks spaces.
"""

import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium
import numpy as np
from rich.console import Console

from robosim.environments.config import Sense
from robosim.environments.sources import route_action
from robosim.environments.target_search import TargetSearch
from robosim.support.checks import SEED, STEPS, Range, checked
from robosim.support.installation import DISTRIBUTION, missing_extra, package_version
from robosim.support.progress import tracked
from robosim.support.reading import FileError, naming, one_line
from robosim.support.run_folder import run_folder
from robosim.support.text_in import read_json
from slam.actions import PUBLISHED

Driver = Literal["route", "random"]
#: Folder of the data set within that of the run, by the convention of Minari.
DATASET = "data"
#: Content of the folder, and the remedy where it holds something else.
_WHAT, _REMEDY = "searches of this command", "Choose another --out, or remove the folder to collect again."


@dataclass(frozen=True, kw_only=True)
@checked
class CollectSearchesConfig:
    """Which searches are collected."""

    plan: str = "homes:100"
    """Source of plans: a name, file, folder, suite, or homes:500 for that many generated homes."""
    episodes: Annotated[int, Range(1, 10_000_000)] = 100
    """Number of searches."""
    observe: tuple[Sense, ...] = ("depth", "odometry", "radio", "pose")
    """Observations that are stored."""
    driver: Driver = "route"
    """Driver: route follows the shortest drive on the true map, random goes forward in three of five actions."""
    stray: Annotated[float, Range(0, 1)] = 0.1
    """Probability that the driver of routes takes a random action instead."""
    targets: Annotated[int | None, Range(1, 10_000, "places in each plan")] = 4
    """Places of each plan that targets are drawn from, each with a table of radio; None for anywhere."""
    most_steps: Annotated[int, STEPS] = 1000
    """Steps after which a search is truncated."""
    seed: Annotated[int, SEED] = 0
    """Seed of the first search; the next one has the next number."""


def collect_searches(config: CollectSearchesConfig, out: Path, console: Console) -> Path:
    """Write the missing searches; returns the folder of the data set, for `minari.MinariDataset`.

    Raises:
        ImportError: If Minari is not installed.
        FolderError: If the folder holds searches of another configuration.
    """
    try:
        from minari.dataset.minari_storage import MinariStorage
        from minari.serialization import serialize_space
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
        data = (folder / DATASET).absolute()  # Minari resolves relative paths in its own folder
        metadata = data / "metadata.json"
        first, form = 0, {"data_format": "arrow", "jpeg_encoding": False}  # depth is no photograph
        spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
        if os.path.lexists(metadata):
            texts = {name: serialize_space(space) for name, space in spaces.items()}
            _check_metadata(metadata, {**form, **texts}, config.most_steps)
            with naming(metadata, _WHAT, _REMEDY):
                storage = MinariStorage.read(data)
                first = storage.total_episodes
        else:
            storage = MinariStorage.new(data, **spaces, **form, env_spec=env.spec)
            storage.update_metadata(_dataset_metadata(config))
        with tracked(range(first, config.episodes), "searches", console) as shown:
            for number in shown:
                shutil.rmtree(data / str(number), ignore_errors=True)  # of an interrupted run
                storage.update_episodes([_episode(env, config, number)])
    env.close()
    return data


def _check_metadata(path: Path, expected: dict[str, Any], most_steps: int) -> None:
    """Raise FileError where what Minari acts on is not what this command writes."""
    count = len(list(path.parent.glob("[0-9]*/")))  # an interrupted run leaves one that is not counted
    possible: dict[str, Sequence[Any]] = {key: [value] for key, value in expected.items()}
    possible["total_episodes"] = range(max(count - 1, 0), count + 1)
    possible["total_steps"] = range(count * most_steps + 1)
    stored = read_json(path, _WHAT, _REMEDY, keys=tuple(possible))
    for key, values in possible.items():
        if type(stored[key]) is not type(values[0]) or stored[key] not in values:
            value, *bounds = (
                one_line(repr(item), 80) for item in (stored[key], *dict.fromkeys((values[0], values[-1])))
            )
            raise FileError(f"{path}: {key} is {value}, expected {' to '.join(bounds)}. {_REMEDY}")


def _episode(env: gymnasium.Env[Any, Any], config: CollectSearchesConfig, number: int) -> Any:
    """Drive a search, and return it as Minari's buffer."""
    from minari.data_collector.episode_buffer import EpisodeBuffer

    search = env.unwrapped
    assert isinstance(search, TargetSearch)
    seed = config.seed + number
    observation, info = env.reset(seed=seed)
    # A stream of its own, so that the driver does not change the search.
    rng = np.random.default_rng([seed, 1])
    seen, steps = [observation], list[tuple[int, float, bool, bool]]()
    while not (steps and (steps[-1][2] or steps[-1][3])):
        action = _next_action(search, config, info, rng)
        observation, reward, terminated, truncated, info = env.step(action)
        seen.append(observation)
        steps.append((action, float(reward), terminated, truncated))
    actions, rewards, ends, cuts = zip(*steps, strict=True)
    columns = {key: np.stack([observed[key] for observed in seen]) for key in observation}
    return EpisodeBuffer(
        id=number,
        seed=seed,
        observations=columns,
        actions=np.array(actions),
        rewards=list(rewards),
        terminations=list(ends),
        truncations=list(cuts),
    )


def _next_action(
    search: TargetSearch, config: CollectSearchesConfig, info: dict[str, Any], rng: np.random.Generator
) -> int:
    # Always three draws, so that drivers share the stream.
    share, any_action, mostly_forward = (
        rng.random(),
        rng.integers(len(PUBLISHED)),
        rng.choice([0, 0, 0, 1, 2]),
    )
    if config.driver == "random":
        return int(mostly_forward)
    if share < config.stray:
        return int(any_action)
    return int(route_action(search.current.place, info["pose"], info["target"]))


def _dataset_metadata(config: CollectSearchesConfig) -> dict[str, Any]:
    """Metadata of the data set besides its format and spaces."""
    return {
        "dataset_id": f"robosim/target-search/{config.driver}-v0",
        "minari_version": package_version("minari"),
        "algorithm_name": config.driver,
        "description": f"Searches for a target in {config.plan}, by robosim {package_version()}.",
        "requirements": [f"{DISTRIBUTION}=={package_version()}"],
    }
