"""Train the learned choice among frontiers on walks through generated homes.

Each round walks through new homes with the present weights, drawing choices by their probabilities; then proximal
policy optimisation improves the weights. Every few rounds the most likely choices are evaluated on the same held-out
homes; the best weights are used. At the end they are compared with the hand-made ratings in further homes. Homes,
starts and choices depend only on the seed and their number, so that the number of workers does not change the weights.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from jaxtyping import Float, Float32
from rich.console import Console

from robosim.building.reach import reach
from robosim.datasets.collect import CollectConfig, home_building
from robosim.simulator import SimulatorConfig
from robosim.support.checks import SEED, Range, checked
from robosim.support.files import write_json
from robosim.support.progress import tracked
from robosim.support.run_folder import run_folder
from robosim.support.torch_training import check_weights, restore_optimiser
from robosim.support.weights import Weights, trained_numbers
from robosim.support.workers import Workers
from robosim.training.grid_walk import GridAgent, GridWorld
from robosim.training.policy_weights import (
    Checkpoint,
    as_arrays,
    as_tensors,
    restore_weights,
    write_policy,
)
from robosim.training.training_plots import plot_coverage
from slam.exploration.choosing import FEATURES, Chooser, evaluate, initial_weights
from slam.exploration.explorer import LEARNED, ExplorerConfig, ExplorerName, FrontierExplorer
from slam.learning.ppo import PpoConfig, Walk, improve

#: Numbers of the first homes for the choice of weights, for the comparison, and for training.
_HELD_OUT, _TEST, _LEARN = 0, 10_000, 20_000


@dataclass(frozen=True, kw_only=True)
@checked
class ExplorerRecipe:
    """Recipe of the learned choice among frontiers."""

    rounds: Annotated[int, Range(1, 100_000)] = 60
    """Rounds of walks and improvement."""
    homes: Annotated[int, Range(1, 100_000)] = 24
    """Homes of a round."""
    decisions: Annotated[int, Range(1, 100_000)] = 300
    """Decisions of a walk."""
    held_out: Annotated[int, Range(1, _TEST - _HELD_OUT, "homes")] = 40
    """Homes for the choice of weights, and for the comparison."""
    every: Annotated[int, Range(1, 100_000, "rounds")] = 5
    """Rounds between validations."""
    seed: Annotated[int, SEED] = 0
    """Seed of homes, starts, weights and choices."""
    ppo: PpoConfig = field(default_factory=PpoConfig)
    """Proximal policy optimisation."""


def walk_home(
    home: int,
    recipe: ExplorerRecipe,
    rating: ExplorerName,
    choose: Callable[[Float32[np.ndarray, "n k"]], int] | None = None,
    coverage: list[float] | None = None,
) -> tuple[Float[np.ndarray, " m"], bool]:
    """Explore a generated home; returns the coverage before each decision and after the last, and whether it ended.

    A walk ends early if no frontier is left. A given list of `coverage` grows during the walk.
    """
    building = home_building(CollectConfig(seed=recipe.seed), home)
    robot = SimulatorConfig().robot
    world = GridWorld(
        building,
        reach(building, *robot.hull_m),
        np.random.default_rng([recipe.seed, home, 2]),
        np.radians(SimulatorConfig().image.hfov_deg),
    )
    settings = LEARNED if rating == "learned" else {}
    config = ExplorerConfig(rating=rating, **settings)
    agent = GridAgent(FrontierExplorer(robot, config, choose))
    coverage = [] if coverage is None else coverage
    coverage.append(world.coverage)
    while len(coverage) <= recipe.decisions:
        pose = agent.act(world.estimate())
        if pose is None:
            return np.array(coverage), True
        world.step(pose)
        coverage.append(world.coverage)
    return np.array(coverage), False


def random_walk(weights: Weights, home: int, recipe: ExplorerRecipe) -> Walk:
    """A walk whose choices are drawn by their probabilities, for training."""
    rng = np.random.default_rng([recipe.seed, home, 3])
    choices: list[tuple[Float32[np.ndarray, "n k"], int, float, float, int]] = []
    growing: list[float] = []

    def choose(features: Float32[np.ndarray, "n k"]) -> int:
        logits, value = evaluate(weights, features, np.ones((len(features), 1), np.float32))
        odds = np.exp(logits - logits.max(), dtype=np.float64)
        odds /= odds.sum()
        taken = int(rng.choice(len(odds), p=odds))
        choices.append((features, taken, float(np.log(odds[taken])), float(value), len(growing) - 1))
        return taken

    coverage, ended = walk_home(home, recipe, "learned", choose, growing)
    features, taken, log_odds, value, at = zip(*choices, strict=True) if choices else ((), (), (), (), ())
    return Walk(
        features=list(features),
        taken=np.array(taken, int),
        log_odds=np.array(log_odds, float),
        value=np.array(value, float),
        at=np.array(at, int),
        coverage=coverage,
        ended=ended,
    )


def mean_coverage(
    home: int, recipe: ExplorerRecipe, rating: ExplorerName, weights: Weights | None = None
) -> float:
    """Mean coverage over the decisions of a walk; the last value continues to the end."""
    coverage, _ = walk_home(home, recipe, rating, Chooser(weights) if weights is not None else None)
    return _mean_over(coverage, recipe.decisions)


def _mean_over(coverage: Float[np.ndarray, " m"], decisions: int) -> float:
    """Mean coverage over a number of decisions; the last value continues to the end."""
    return float(np.append(coverage, np.full(decisions, coverage[-1]))[:decisions].mean())


def train_explorer(
    out: Path,
    recipe: ExplorerRecipe,
    *,
    workers: int,
    cluster: str | None = None,
    console: Console,
    about: str = "",
) -> dict[str, Any]:
    """Train, compare and write explorer.safetensors with its card, result.json and the curve; returns the card.

    `out` may hold an unfinished run. The result does not depend on the number of workers; `cluster` is the address of
    a dask scheduler, `about` the command for the card.

    Raises:
        FolderError: If the folder holds a run of another recipe.
        WorkerLost: If a process was killed; finished rounds are stored.
    """
    start = time.perf_counter()
    with run_folder(out, "train explorer", asdict(recipe)), Workers(workers, cluster, what="walks") as pool:
        best, curve = _learn(Checkpoint(out / "checkpoint.pt"), recipe, pool, console)
        homes = range(_TEST, _TEST + recipe.held_out)
        ratings: tuple[ExplorerName, ...] = ("nearest", "cheapest", "gain", "learned")
        scores: dict[str, list[float]] = {}
        with tracked(ratings, "comparing", console) as shown:
            for rating in shown:
                weights = best if rating == "learned" else None
                calls = [(home, recipe, rating, weights) for home in homes]
                scores[rating] = pool.in_order(mean_coverage, calls)
        card: dict[str, Any] = {
            "data": f"{recipe.rounds * recipe.homes} generated homes, one walk each",
            "command": about,
            "recipe": asdict(recipe),
            "features": FEATURES,
            "parameters": trained_numbers(best),
            "test_homes": recipe.held_out,
            "mean_coverage": {rating: round(float(np.mean(values)), 4) for rating, values in scores.items()},
            "better_than_gain": _interval(np.array(scores["learned"]) - scores["gain"]),
            "seconds": round(time.perf_counter() - start, 1),
        }
        write_policy(out, "explorer", best, card)
        write_json(out / "result.json", {**card, "curve": curve, "scores": scores})
        plot_coverage(curve, out / "curves.png")
    return card


def _learn(
    checkpoint: Checkpoint, recipe: ExplorerRecipe, pool: Workers, console: Console
) -> tuple[Weights, list[dict[str, float]]]:
    """The best weights, and one row of the curve for each round."""
    torch.manual_seed(recipe.seed)
    weights = as_tensors(initial_weights(np.random.default_rng([recipe.seed, 4])))
    optimiser = torch.optim.Adam(weights.values(), lr=recipe.ppo.rate)
    state: dict[str, Any] = {"round": 0, "curve": [], "best": None, "score": -np.inf}
    state |= resume(checkpoint, recipe, weights, optimiser)
    with tracked(range(state["round"], recipe.rounds), "rounds", console) as rounds:
        for n in rounds:
            if n % recipe.every == 0:
                _validate(state, as_arrays(weights), recipe, pool)
            homes = range(_LEARN + n * recipe.homes, _LEARN + (n + 1) * recipe.homes)
            walks = pool.in_order(random_walk, [(as_arrays(weights), home, recipe) for home in homes])
            rng = np.random.default_rng([recipe.seed, n, 5])
            losses = improve(weights, optimiser, [walk for walk in walks if len(walk.taken)], recipe.ppo, rng)
            seen = [_mean_over(walk.coverage, recipe.decisions) for walk in walks]
            state["round"] = n + 1
            state["curve"].append({"round": n + 1, "coverage": float(np.mean(seen)), **losses})
            detached = {name: value.detach() for name, value in weights.items()}
            checkpoint.save({"weights": detached, "optimiser": optimiser.state_dict(), "state": state})
    _validate(state, as_arrays(weights), recipe, pool)
    return {name: value.numpy() for name, value in state["best"].items()}, state["curve"]


def resume(
    checkpoint: Checkpoint,
    recipe: ExplorerRecipe,
    weights: dict[str, torch.Tensor],
    optimiser: torch.optim.Optimizer,
) -> dict[str, Any]:
    """Restore weights and optimiser from a checkpoint, and return the progress of the training; empty without one.

    Raises:
        FileError: If the checkpoint is damaged.
    """
    progress: dict[str, Any] = {}

    def restore(stored: dict[str, Any]) -> None:
        restore_weights(weights, stored["weights"])
        restore_optimiser(optimiser, stored["optimiser"])
        state = stored["state"]
        best, curve, rounds = state["best"], state["curve"], state["round"]
        is_valid = isinstance(rounds, int) and 0 <= rounds <= recipe.rounds
        is_valid &= isinstance(state["score"], float) and isinstance(curve, list)
        is_valid &= all(isinstance(row.get("round"), int) for row in curve)
        check_weights(best or {})
        shapes = {name: value.shape for name, value in weights.items()}
        if not is_valid or (best is not None and {k: v.shape for k, v in best.items()} != shapes):
            raise ValueError("it does not contain the progress of a training")
        progress.update(state)

    checkpoint.restore(restore)
    return progress


def _validate(state: dict[str, Any], weights: Weights, recipe: ExplorerRecipe, pool: Workers) -> None:
    """Score weights on the held-out homes, and store them if they are the best so far."""
    homes = range(_HELD_OUT, _HELD_OUT + recipe.held_out)
    scores = pool.in_order(mean_coverage, [(home, recipe, "learned", weights) for home in homes])
    score = float(np.mean(scores))
    if not state["curve"]:
        state["curve"].append({"round": 0})
    state["curve"][-1]["held_out"] = score
    if score > state["score"]:
        state["score"], state["best"] = score, {k: torch.from_numpy(v) for k, v in weights.items()}


def _interval(difference: Float[np.ndarray, " n"]) -> dict[str, float]:
    """Mean of differences over homes, with the 95 % interval of a bootstrap over homes."""
    rng = np.random.default_rng(0)
    means = difference[rng.integers(len(difference), size=(2000, len(difference)))].mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    values = {"mean": difference.mean(), "low": low, "high": high}
    return {name: round(float(value), 4) for name, value in values.items()}
