"""Train the learned choice among frontiers: walks through invented homes, improved by what they showed.

Each round walks through new homes with the weights so far, choosing at random by their odds; then the weights are
improved by proximal policy optimisation. Every few rounds the surest choices are walked through homes that were held
out, the same each time; the best weights are kept. In the end they are compared with the hand-made ratings in further
homes that nobody has seen. Homes, starts and choices depend on the seed and their number alone, so any number of
workers gives the same weights.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import matplotlib.pyplot as plt
import numpy as np
import torch
from jaxtyping import Float, Float32
from rich.console import Console
from safetensors.numpy import save

from robosim.building.reach import reach
from robosim.datasets.collect import CollectConfig, home_building
from robosim.simulator import SimulatorConfig
from robosim.support.checkpoint import Checkpoint
from robosim.support.checks import SEED, Range, checked
from robosim.support.figures import save_figure
from robosim.support.files import write_json, write_whole
from robosim.support.progress import tracked
from robosim.support.run_folder import run_folder
from robosim.support.workers import Workers
from robosim.training.grid_walk import GridWalk
from slam.exploration.choosing import FEATURES, Chooser, evaluate, initial_weights
from slam.exploration.explorer import ExplorerConfig, ExplorerName, FrontierExplorer
from slam.learning.ppo import PpoConfig, Walk, improve
from slam.learning.restoring import check_weights, restore_optimiser
from slam.planning.cost_map import CostConfig

Weights = dict[str, Float32[np.ndarray, "..."]]
#: Numbers of the homes to choose the best weights by, and of those to compare in the end; learning begins behind.
_HELD_OUT, _TEST, _LEARN = 0, 10_000, 20_000


@dataclass(frozen=True, kw_only=True)
@checked
class ExplorerRecipe:
    """How the choice is trained."""

    rounds: Annotated[int, Range(1, 100_000)] = 60
    """Rounds of walks and improvement."""
    homes: Annotated[int, Range(1, 100_000)] = 24
    """Homes of a round."""
    decisions: Annotated[int, Range(1, 100_000)] = 300
    """Decisions of a walk."""
    held_out: Annotated[int, Range(1, _TEST - _HELD_OUT, "homes")] = 40
    """Homes that the best weights are chosen by, and as many others for the comparison in the end."""
    every: Annotated[int, Range(1, 100_000, "rounds")] = 5
    """Rounds between validations."""
    seed: Annotated[int, SEED] = 0
    """Seed of homes, starts, weights and choices."""
    ppo: PpoConfig = field(default_factory=PpoConfig)
    """How weights are improved."""


def walk_home(
    home: int,
    recipe: ExplorerRecipe,
    rating: ExplorerName,
    choose: Callable[[Float32[np.ndarray, "n k"]], int] | None = None,
    on_decision: Callable[[int], None] = lambda decisions: None,
) -> tuple[Float[np.ndarray, " m"], bool]:
    """Explore one invented home on the grid.

    Returns:
        The part of the floor seen before each decision and after the last, and whether nothing was left to see.
    """
    building = home_building(CollectConfig(seed=recipe.seed), home)
    robot = SimulatorConfig().robot
    walk = GridWalk(
        building,
        reach(building, robot.radius_m, robot.height_m),
        np.random.default_rng([recipe.seed, home, 2]),
        np.radians(SimulatorConfig().image.hfov_deg),
    )
    config = ExplorerConfig(rating=rating, cost=CostConfig(radius_m=robot.radius_m))
    explorer = FrontierExplorer(config, choose)
    coverage = [walk.coverage]
    while len(coverage) <= recipe.decisions:
        on_decision(len(coverage) - 1)
        if not walk.decide(explorer):
            return np.array(coverage), True
        coverage.append(walk.coverage)
    return np.array(coverage), False


def chance_walk(weights: Weights, home: int, recipe: ExplorerRecipe) -> Walk:
    """A walk whose choices are drawn by their odds, kept to learn from."""
    rng = np.random.default_rng([recipe.seed, home, 3])
    told: list[tuple[Float32[np.ndarray, "n k"], int, float, float, int]] = []
    now = 0

    def count(decisions: int) -> None:
        nonlocal now
        now = decisions

    def choose(features: Float32[np.ndarray, "n k"]) -> int:
        logits, value = evaluate(weights, features, np.ones((len(features), 1), np.float32))
        odds = np.exp(logits - logits.max(), dtype=np.float64)
        odds /= odds.sum()
        taken = int(rng.choice(len(odds), p=odds))
        told.append((features, taken, float(np.log(odds[taken])), float(value), now))
        return taken

    coverage, ended = walk_home(home, recipe, "learned", choose, count)
    features, taken, log_odds, value, at = zip(*told, strict=True) if told else ((), (), (), (), ())
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
    """Mean part of the floor that had been seen over the decisions of a walk; the last value is held."""
    coverage, _ = walk_home(home, recipe, rating, Chooser(weights) if weights is not None else None)
    return _held_mean(coverage, recipe.decisions)


def _held_mean(coverage: Float[np.ndarray, " m"], decisions: int) -> float:
    """Mean of a coverage over so many decisions; its last value is held."""
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
    """Train, compare and write explorer.safetensors with its card, result.json and the curve.

    Args:
        out: Folder for everything, and to go on from.
        recipe: How.
        workers: Processes that walk; the result does not depend on it.
        cluster: Address of a dask scheduler that is used instead.
        console: Where progress is shown.
        about: The command that does it again, for the card.

    Returns:
        The card.

    Raises:
        FolderError: If the folder holds a run of another recipe.
        WorkerLost: If a process was killed; what was learnt until then is kept.
    """
    start = time.perf_counter()
    with (
        run_folder(out, "train explorer", asdict(recipe)),
        Workers(workers, cluster, what="walks") as pool,
    ):
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
            "data": f"{recipe.rounds * recipe.homes} invented homes, one walk each",
            "command": about,
            "recipe": asdict(recipe),
            "features": FEATURES,
            "parameters": sum(int(np.size(value)) for value in best.values()),
            "test_homes": recipe.held_out,
            "mean_coverage": {rating: round(float(np.mean(values)), 4) for rating, values in scores.items()},
            "better_than_gain": _interval(np.array(scores["learned"]) - scores["gain"]),
            "seconds": round(time.perf_counter() - start, 1),
        }
        write_whole(out / "explorer.safetensors", save(best))
        write_json(out / "explorer.json", card)
        write_json(out / "result.json", {**card, "curve": curve, "scores": scores})
        _plot(curve, out / "curves.png")
    return card


def _learn(
    checkpoint: Checkpoint, recipe: ExplorerRecipe, pool: Workers, console: Console
) -> tuple[Weights, list[dict[str, float]]]:
    """The best weights, and one row of the curve for each round."""
    torch.manual_seed(recipe.seed)
    first = initial_weights(np.random.default_rng([recipe.seed, 4]))
    weights = {name: torch.from_numpy(value.copy()).requires_grad_() for name, value in first.items()}
    optimiser = torch.optim.Adam(weights.values(), lr=recipe.ppo.rate)
    state: dict[str, Any] = {"round": 0, "curve": [], "best": None, "score": -np.inf}
    state |= resume(checkpoint, recipe, weights, optimiser)

    def now() -> Weights:
        return {name: value.detach().numpy().copy() for name, value in weights.items()}

    with tracked(range(state["round"], recipe.rounds), "rounds", console) as rounds:
        for n in rounds:
            if n % recipe.every == 0:
                _validate(state, now(), recipe, pool)
            homes = range(_LEARN + n * recipe.homes, _LEARN + (n + 1) * recipe.homes)
            walks = pool.in_order(chance_walk, [(now(), home, recipe) for home in homes])
            rng = np.random.default_rng([recipe.seed, n, 5])
            told = improve(weights, optimiser, [walk for walk in walks if len(walk.taken)], recipe.ppo, rng)
            seen = [_held_mean(walk.coverage, recipe.decisions) for walk in walks]
            state["round"] = n + 1
            state["curve"].append({"round": n + 1, "coverage": float(np.mean(seen)), **told})
            learnt = {name: value.detach() for name, value in weights.items()}
            checkpoint.save({"weights": learnt, "optimiser": optimiser.state_dict(), "state": state})
    _validate(state, now(), recipe, pool)
    return {name: value.numpy() for name, value in state["best"].items()}, state["curve"]


def resume(
    checkpoint: Checkpoint,
    recipe: ExplorerRecipe,
    weights: dict[str, torch.Tensor],
    optimiser: torch.optim.Optimizer,
) -> dict[str, Any]:
    """Put weights and optimiser into the state of a checkpoint; how far the training had come, if it had begun.

    Raises:
        FileError: If it is damaged.
    """
    state: dict[str, Any] = {}

    def put(kept: dict[str, Any]) -> None:
        check_weights(kept["weights"])
        restore_optimiser(optimiser, kept["optimiser"])
        state.update(_checked(kept["state"], recipe, weights))
        with torch.no_grad():
            for name, value in weights.items():
                value.copy_(kept["weights"][name])

    checkpoint.restore(put)
    return state


def _checked(
    state: dict[str, Any], recipe: ExplorerRecipe, weights: dict[str, torch.Tensor]
) -> dict[str, Any]:
    """What a checkpoint says of the training so far, if it is such a thing."""
    best, curve, rounds = state["best"], state["curve"], state["round"]
    good = isinstance(rounds, int) and 0 <= rounds <= recipe.rounds and isinstance(state["score"], float)
    good &= isinstance(curve, list) and all(isinstance(row.get("round"), int) for row in curve)
    check_weights(best or {})
    good &= best is None or {k: v.shape for k, v in best.items()} == {k: v.shape for k, v in weights.items()}
    if not good:
        raise ValueError("its state is none of a training")
    return state


def _validate(state: dict[str, Any], weights: Weights, recipe: ExplorerRecipe, pool: Workers) -> None:
    """Score weights on the homes held out, and keep them if they are the best so far."""
    homes = range(_HELD_OUT, _HELD_OUT + recipe.held_out)
    scores = pool.in_order(mean_coverage, [(home, recipe, "learned", weights) for home in homes])
    score = float(np.mean(scores))
    if not state["curve"]:
        state["curve"].append({"round": 0})
    state["curve"][-1]["held_out"] = score
    if score > state["score"]:
        state["score"], state["best"] = score, {k: torch.from_numpy(v) for k, v in weights.items()}


def _interval(difference: Float[np.ndarray, " n"]) -> dict[str, float]:
    """Mean of differences home by home, with the interval of 95 % from drawing the homes anew."""
    rng = np.random.default_rng(0)
    means = difference[rng.integers(len(difference), size=(2000, len(difference)))].mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return {
        "mean": round(float(difference.mean()), 4),
        "low": round(float(low), 4),
        "high": round(float(high), 4),
    }


def _plot(curve: list[dict[str, float]], path: Path) -> None:
    """Mean coverage over the rounds, as walked to learn and on the homes held out."""
    figure, axes = plt.subplots(figsize=(6, 4))
    for key, style, label in (
        ("coverage", "-", "walks to learn from"),
        ("held_out", "o-", "homes held out, surest choices"),
    ):
        points = [(row["round"], row[key]) for row in curve if key in row]
        axes.plot(*zip(*points, strict=True), style, label=label)
    axes.set_xlabel("round")
    axes.set_ylabel("mean part of the floor seen")
    axes.legend()
    save_figure(figure, path)
