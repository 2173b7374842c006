"""Train the learned search: a recurrent network that drives by depth, radio and odometry, in generated homes.

First the network imitates a guide that knows the route and drives a decreasing share of the steps, so that the network
also learns from its own positions (DAgger). Then proximal policy optimisation improves it on its own arrivals, with a
decreasing weight of the guide's advice. Targets are near at first, and farther as more searches arrive. The weights
with the most arrivals in held-out homes are used; in further homes they are compared with the guide and with random
actions.

An epoch begins new searches in some of the homes. An interrupted run continues with its epoch, and gives the same
weights as an uninterrupted one.

Reference: Ross, Gordon and Bagnell, A reduction of imitation learning to no-regret online learning, AISTATS 2011;
Schulman et al., arXiv:1707.06347.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import process_time
from typing import Annotated, Any

import numpy as np
import torch
from rich.console import Console
from torch import Tensor

from robosim.policies.search_network import (
    HIDDEN,
    SearchNetwork,
    empty_memory,
    initial_weights,
    load_search,
)
from robosim.support.checks import SEED, STEPS, Range, checked
from robosim.support.files import write_json
from robosim.support.progress import tracked
from robosim.support.run_folder import run_folder
from robosim.support.torch_training import restore_optimiser, torch_threads
from robosim.support.weights import trained_numbers
from robosim.training.policy_weights import (
    Checkpoint,
    as_tensors,
    restore_weights,
    write_policy,
)
from robosim.training.search_learning import learn
from robosim.training.search_walks import Robots, Walks, evaluate_driver, walk
from slam.learning.ppo import PpoConfig

#: Numbers of the first homes for the choice of weights and for the comparison; training homes begin at the seed.
_CHOICE, _TEST = 10_000_000, 20_000_000
_PPO = PpoConfig(trace=0.95, passes=3, batch=16, rate=4e-4, entropy=0.003)
#: Shares of arrivals that raise and lower the difficulty, and its step.
_HARDER, _EASIER, _STEP = 0.6, 0.2, 0.1


@dataclass(frozen=True, kw_only=True)
@checked
class SearchRecipe:
    """Recipe of the learned search."""

    epochs: Annotated[int, Range(1, 1_000_000)] = 400
    """Number of epochs."""
    imitation: Annotated[int, Range(0, 1_000_000, "epochs")] = 30
    """Epochs of imitation at the beginning."""
    robots: Annotated[int, Range(1, 65536, "robots")] = 32
    """Robots side by side."""
    segments: Annotated[int, Range(1, 100_000)] = 8
    """Segments of an epoch."""
    segment: Annotated[int, Range(1, 100_000, "steps")] = 128
    """Steps of a segment."""
    homes: Annotated[int, Range(1, _CHOICE)] = 144
    """Number of homes."""
    at_once: Annotated[int, Range(1, 100, "homes")] = 12
    """Homes of an epoch."""
    offices: Annotated[float, Range(0, 1)] = 0.0
    """Share of these that are offices of up to 2000 m2 instead."""
    targets: Annotated[int, Range(1, 10_000, "places in each home")] = 3
    """Target positions in each home."""
    search_steps: Annotated[int, STEPS] = 500
    """Largest number of steps of a search."""
    difficulty: Annotated[float, Range(0, 1)] = 0.3
    """Difficulty at first, by the distance of targets, 0 to 1."""
    advice: Annotated[float, Range(0, 1000)] = 0.3
    """Weight of the guide's advice after imitation."""
    half_life: Annotated[float, Range(1e-3, 1e6, "epochs")] = 30.0
    """Epochs in which this weight halves."""
    every: Annotated[int, Range(1, 1_000_000, "epochs")] = 10
    """Epochs between evaluations of the weights."""
    held_out: Annotated[int, Range(1, 100_000, "searches")] = 32
    """Searches of an evaluation, and half of those of the comparison at the end, each in its own home."""
    ppo: PpoConfig = _PPO
    """Proximal policy optimisation; a batch counts robots."""
    reward_scale: Annotated[float, Range(1e-6, 1e6)] = 0.1
    """Factor of rewards, for values of about 1."""
    start: str = ""
    """File of weights to start from; random ones if empty."""
    seed: Annotated[int, SEED] = 0
    """Seed of homes, searches, noise, weights and choices."""


class Training:
    """State of a training."""

    def __init__(self, recipe: SearchRecipe, tables: Path) -> None:
        """Begin a training; `tables` is the folder of radio tables."""
        self.recipe, self._tables = recipe, tables
        random = initial_weights(np.random.default_rng(recipe.seed))
        self.weights = as_tensors(load_search(Path(recipe.start)).weights if recipe.start else random)
        self._optimiser = torch.optim.Adam(self.weights.values(), lr=recipe.ppo.rate, eps=1e-5)
        self.epoch, self.difficulty, self.seconds = 0, recipe.difficulty, 0.0
        self.curve: list[dict[str, float]] = []
        self.best: dict[str, Tensor] | None = None

    def run_epoch(self) -> None:
        """Run an epoch of walks and learning, with an evaluation of the weights if it is due."""
        start, recipe, epoch = process_time(), self.recipe, self.epoch
        has_surrogate = epoch >= recipe.imitation
        # The guide drives in the whole first epoch, and not after half of the imitation.
        guided = 0.0 if has_surrogate else max(0.0, 1 - epoch / max(1, recipe.imitation / 2))
        advice = (
            recipe.advice * 0.5 ** ((epoch - recipe.imitation) / recipe.half_life) if has_surrogate else 1.0
        )
        rng = np.random.default_rng([recipe.seed, epoch, 1])
        homes = min(recipe.at_once, recipe.homes)
        robots = Robots(
            Walks(
                robots=recipe.robots,
                homes=homes,
                first=recipe.seed + min(epoch * recipe.at_once % recipe.homes, recipe.homes - homes),
                offices=recipe.offices,
                targets=recipe.targets,
                difficulty=self.difficulty,
                steps=recipe.search_steps,
                seed=int(rng.integers(2**31)),
                tables=self._tables,
            )
        )
        memory, means, ends = empty_memory(recipe.robots), [], np.zeros(2)
        for _ in range(recipe.segments):
            segment, memory = walk(robots, self.network, memory, recipe.segment, guided, rng)
            ends += segment.arrived.sum(), segment.late.sum()
            means.append(
                learn(
                    self.weights,
                    self._optimiser,
                    replace(segment, reward=recipe.reward_scale * segment.reward),
                    recipe.ppo,
                    advice=advice,
                    has_surrogate=has_surrogate,
                    rng=rng,
                )
            )
        robots.close()
        share = float(ends[0] / max(1, ends.sum()))
        row = {"epoch": epoch + 1.0, "difficulty": self.difficulty, "guided": guided, "arrived": share}
        row |= {name: float(np.mean([segment_means[name] for segment_means in means])) for name in means[0]}
        if guided < 0.5:
            change = _STEP if share >= _HARDER else -_STEP if share <= _EASIER else 0.0
            self.difficulty = float(min(max(round(self.difficulty + change, 3), 0.0), 1.0))
        self.epoch += 1
        if self.epoch % recipe.every == 0 or self.epoch == recipe.epochs:
            row |= self._evaluate()
        self.seconds += process_time() - start
        self.curve.append({**row, "cpu_s": round(self.seconds, 1)})

    @property
    def network(self) -> SearchNetwork:
        """The policy with the present weights."""
        return network_of(self.weights)

    def state(self) -> dict[str, Any]:
        """State of the training for a checkpoint."""
        return {
            "weights": {name: value.detach() for name, value in self.weights.items()},
            "optimiser": self._optimiser.state_dict(),
            **{name: getattr(self, name) for name in ("epoch", "difficulty", "seconds", "curve", "best")},
        }

    def restore(self, stored: dict[str, Any]) -> None:
        """Continue from a state; ValueError if it is not a state of a training with this recipe."""
        restore_weights(self.weights, stored["weights"])
        restore_optimiser(self._optimiser, stored["optimiser"])
        epoch, difficulty, seconds, curve = (
            stored[name] for name in ("epoch", "difficulty", "seconds", "curve")
        )
        is_valid = isinstance(epoch, int) and isinstance(curve, list) and 0 < epoch == len(curve)
        is_valid = is_valid and isinstance(difficulty, float) and 0 <= difficulty <= 1
        is_valid = is_valid and isinstance(seconds, float)
        if not is_valid or not all(isinstance(row, dict) and "arrived" in row for row in curve):
            raise ValueError("it does not contain the progress of a training")
        if stored["best"] is not None:
            self.best = {name: value.detach().clone() for name, value in self.weights.items()}
            restore_weights(self.best, stored["best"])
        self.epoch, self.difficulty, self.seconds, self.curve = epoch, difficulty, seconds, curve

    def _evaluate(self) -> dict[str, float]:
        """Scores in held-out homes; the weights are stored if they are the best so far."""
        scores = evaluate_driver(
            self.network, held_out(self.recipe, _CHOICE, self.recipe.held_out, self._tables)
        )
        row = {f"held_out_{name}": value for name, value in scores.items()}
        before = [
            (row["held_out_arrived"], row["held_out_spl"]) for row in self.curve if "held_out_spl" in row
        ]
        if (scores["arrived"], scores["spl"]) >= max(before, default=(0.0, 0.0)):
            self.best = {name: value.detach().clone() for name, value in self.weights.items()}
        return row


def network_of(weights: Mapping[str, Tensor]) -> SearchNetwork:
    """The network without PyTorch; it shares the memory of the weights."""
    return SearchNetwork({name: value.detach().numpy() for name, value in weights.items()})


def held_out(recipe: SearchRecipe, first: int, searches: int, tables: Path) -> Walks:
    """Searches of all distances in homes outside the training, of at most 1000 steps."""
    return Walks(
        robots=searches,
        homes=searches,
        first=first,
        offices=recipe.offices,
        targets=1,
        difficulty=1.0,
        steps=min(1000, 2 * recipe.search_steps),
        seed=first,
        tables=tables,
    )


def train_search(out: Path, recipe: SearchRecipe, *, console: Console, about: str = "") -> dict[str, Any]:
    """Train, compare and write search.safetensors with its card; returns the card.

    `out` may hold an unfinished run, or a finished one of fewer epochs; `about` is the command for the card.

    Raises:
        FolderError: If the folder holds a run of another recipe.
        FileError: If its checkpoint is damaged.
    """
    settings = {name: value for name, value in asdict(recipe).items() if name != "epochs"}
    with run_folder(out, "train search", settings), torch_threads():
        training, checkpoint = Training(recipe, out / "tables"), Checkpoint(out / "checkpoint.pt")
        checkpoint.restore(training.restore)
        with tracked(range(training.epoch, recipe.epochs), "epochs", console) as epochs:
            for _ in epochs:
                training.run_epoch()
                checkpoint.save(training.state())
                write_json(out / "curve.json", {"epochs": training.curve})
        best = network_of(training.best or training.weights)
        walks = held_out(recipe, _TEST, 2 * recipe.held_out, out / "tables")
        kind = "homes and offices" if recipe.offices else "homes"
        card = {
            "data": f"{training.epoch * recipe.segments * recipe.segment * recipe.robots} steps in "
            f"{min(recipe.homes, training.epoch * recipe.at_once)} generated {kind}",
            "command": about,
            "method": "imitation of a guide that knows the route (DAgger), then proximal policy optimisation",
            "recipe": asdict(recipe),
            "hidden": HIDDEN,
            "parameters": trained_numbers(best.weights),
            "cpu_hours": round(training.seconds / 3600, 2),
            "curve": [row for row in training.curve if "held_out_arrived" in row],
            "test": f"{walks.robots} searches in as many held-out homes, of at most {walks.steps} steps",
            "scores": {
                "learned": evaluate_driver(best, walks),
                "learned, most likely actions": evaluate_driver(best, walks, most_likely=True),
                "guide": evaluate_driver("guide", walks),
                "random": evaluate_driver("random", walks),
            },
        }
        write_policy(out, "search", best.weights, card)
    return card
