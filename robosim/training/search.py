"""Train the learned search: a recurrent network that drives from depth, radio and odometry alone, in invented homes.

First a guide that knows the way says at each step what it would do, and drives less and less of the steps itself, so
that the network learns from where it gets to by itself (DAgger). Then the network improves on its own arrivals by
proximal policy optimisation, the guide's advice weighing less and less. Targets are near at first and farther away as
more searches arrive. The weights kept are those that arrive most often in homes held out; on further ones they are
compared in the end with the guide and with driving at random.

An epoch begins with new searches in some of the homes, and is the unit that an interrupted run goes on with: a run that
was interrupted gives the same weights as one that was not.

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
from safetensors.numpy import save
from torch import Tensor

from robosim.policies.search_network import HIDDEN, SearchNetwork, empty_memory, initial_weights
from robosim.support.checkpoint import Checkpoint
from robosim.support.checks import SEED, STEPS, Range, checked
from robosim.support.files import write_json, write_whole
from robosim.support.progress import tracked
from robosim.support.run_folder import run_folder
from robosim.training.search_learning import as_tensors, learn
from robosim.training.search_walks import Robots, Walks, judge, walk
from slam.learning.ppo import PpoConfig
from slam.learning.restoring import check_weights, restore_optimiser
from slam.learning.threads import torch_threads

#: Numbers of the first homes to choose the best weights by, and to compare in; homes to learn from begin at the seed.
_CHOICE, _TEST = 10_000_000, 20_000_000
#: How segments are learnt from; a batch counts robots.
_PPO = PpoConfig(trace=0.95, passes=3, batch=16, rate=4e-4, entropy=0.003)
#: Shares of arrivals that make searches harder and easier, and by how much.
_HARDER, _EASIER, _STEP = 0.6, 0.2, 0.1


@dataclass(frozen=True, kw_only=True)
@checked
class SearchRecipe:
    """How the learned search is trained."""

    epochs: Annotated[int, Range(1, 1_000_000)] = 400
    """Epochs in all."""
    imitation: Annotated[int, Range(0, 1_000_000, "epochs")] = 30
    """Of which in so many the guide's advice is all that is learnt."""
    robots: Annotated[int, Range(1, 65536, "robots")] = 32
    """Robots side by side."""
    segments: Annotated[int, Range(1, 100_000)] = 8
    """Segments of an epoch."""
    segment: Annotated[int, Range(1, 100_000, "steps")] = 128
    """Steps of a segment."""
    homes: Annotated[int, Range(1, _CHOICE)] = 144
    """Different homes."""
    at_once: Annotated[int, Range(1, 100, "homes")] = 12
    """Homes of an epoch."""
    targets: Annotated[int, Range(1, 10_000, "places in each home")] = 3
    """Places of targets in each home."""
    search_steps: Annotated[int, STEPS] = 500
    """Steps after which a search is given up."""
    difficulty: Annotated[float, Range(0, 1)] = 0.3
    """How far targets are away at first, 0 to 1."""
    advice: Annotated[float, Range(0, 1000)] = 0.3
    """Weight of the guide's advice after imitation."""
    half_life: Annotated[float, Range(1e-3, 1e6, "epochs")] = 30.0
    """Epochs in which it falls to one half."""
    every: Annotated[int, Range(1, 1_000_000, "epochs")] = 10
    """Epochs after which weights are judged."""
    held_out: Annotated[int, Range(1, 100_000, "searches")] = 32
    """Searches to judge weights by, and twice as many to compare in the end, in as many homes."""
    ppo: PpoConfig = _PPO
    """How segments are learnt from; a batch counts robots."""
    reward_scale: Annotated[float, Range(1e-6, 1e6)] = 0.1
    """Factor of rewards, for values of about 1."""
    seed: Annotated[int, SEED] = 0
    """Seed of homes, searches, noise, weights and choices."""


class Training:
    """A policy that is being trained."""

    def __init__(self, recipe: SearchRecipe, tables: Path) -> None:
        """Begin.

        Args:
            recipe: How.
            tables: Folder where tables of radio are kept.
        """
        self.recipe, self._tables = recipe, tables
        self.weights = as_tensors(initial_weights(np.random.default_rng(recipe.seed)))
        self._optimiser = torch.optim.Adam(self.weights.values(), lr=recipe.ppo.rate, eps=1e-5)
        self.epoch, self.difficulty, self.seconds = 0, recipe.difficulty, 0.0
        self.curve: list[dict[str, float]] = []
        self.best: dict[str, Tensor] | None = None

    def run_epoch(self) -> None:
        """Walk and learn for an epoch; judge the weights if it is time."""
        start, recipe, epoch = process_time(), self.recipe, self.epoch
        own = epoch >= recipe.imitation
        # The guide drives all of the first epoch's steps, and none after half of the imitation.
        guided = 0.0 if own else max(0.0, 1 - epoch / max(1, recipe.imitation / 2))
        weigh = recipe.advice * 0.5 ** ((epoch - recipe.imitation) / recipe.half_life) if own else 1.0
        rng = np.random.default_rng([recipe.seed, epoch, 1])
        first = recipe.seed + epoch * recipe.at_once % recipe.homes
        robots = Robots(self._walks(first, recipe.at_once, int(rng.integers(2**31))))
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
                    advice=weigh,
                    own=own,
                    rng=rng,
                )
            )
        robots.close()
        share = float(ends[0] / max(1, ends.sum()))
        row = {"epoch": epoch + 1.0, "difficulty": self.difficulty, "guided": guided, "arrived": share}
        row |= {name: float(np.mean([one[name] for one in means])) for name in means[0]}
        self.difficulty = _next(self.difficulty, share) if guided < 0.5 else self.difficulty
        self.epoch += 1
        if self.epoch % recipe.every == 0 or self.epoch == recipe.epochs:
            row |= self._judged()
        self.seconds += process_time() - start
        self.curve.append({**row, "cpu_s": round(self.seconds, 1)})

    @property
    def network(self) -> SearchNetwork:
        """The policy as it is now."""
        return network_of(self.weights)

    def state(self) -> dict[str, Any]:
        """All that is to be kept."""
        return {
            "weights": {name: value.detach() for name, value in self.weights.items()},
            "optimiser": self._optimiser.state_dict(),
            "epoch": self.epoch,
            "difficulty": self.difficulty,
            "seconds": self.seconds,
            "curve": self.curve,
            "best": self.best,
        }

    def restore(self, kept: dict[str, Any]) -> None:
        """Go on from what was kept.

        Raises:
            ValueError: If it is none of a training with this recipe.
        """
        self._put(self.weights, kept["weights"])
        restore_optimiser(self._optimiser, kept["optimiser"])
        epoch, difficulty, seconds, curve = (
            kept[name] for name in ("epoch", "difficulty", "seconds", "curve")
        )
        good = isinstance(epoch, int) and isinstance(curve, list) and 0 < epoch == len(curve)
        good = good and isinstance(difficulty, float) and 0 <= difficulty <= 1 and isinstance(seconds, float)
        if not good or not all(isinstance(row, dict) and "arrived" in row for row in curve):
            raise ValueError("it says of no training how far it had come")
        if kept["best"] is not None:
            self.best = {name: value.detach().clone() for name, value in self.weights.items()}
            self._put(self.best, kept["best"])
        self.epoch, self.difficulty, self.seconds, self.curve = epoch, difficulty, seconds, curve

    @staticmethod
    def _put(into: Mapping[str, Tensor], kept: Mapping[str, Tensor]) -> None:
        """Weights in place of others of the same names and shapes."""
        check_weights(kept)
        if {name: value.shape for name, value in into.items()} != {k: v.shape for k, v in kept.items()}:
            raise ValueError("its weights have other names or shapes")
        with torch.no_grad():
            for name, value in into.items():
                value.copy_(kept[name])

    def _judged(self) -> dict[str, float]:
        """Scores in homes held out; the weights are kept if they are the best so far."""
        scores = judge(self.network, held_out(self.recipe, _CHOICE, self.recipe.held_out, self._tables))
        row = {f"held_out_{name}": value for name, value in scores.items()}
        before = [
            (one["held_out_arrived"], one["held_out_spl"]) for one in self.curve if "held_out_spl" in one
        ]
        if (scores["arrived"], scores["spl"]) >= max(before, default=(0.0, 0.0)):
            self.best = {name: value.detach().clone() for name, value in self.weights.items()}
        return row

    def _walks(self, first: int, homes: int, seed: int) -> Walks:
        recipe = self.recipe
        return Walks(
            robots=recipe.robots,
            homes=homes,
            first=first,
            targets=recipe.targets,
            difficulty=self.difficulty,
            steps=recipe.search_steps,
            seed=seed,
            tables=self._tables,
        )


def network_of(weights: Mapping[str, Tensor]) -> SearchNetwork:
    """What runs without PyTorch; it shares the numbers."""
    return SearchNetwork({name: value.detach().numpy() for name, value in weights.items()})


def held_out(recipe: SearchRecipe, first: int, searches: int, tables: Path) -> Walks:
    """Searches anywhere in homes that nobody learns from, of at most 1000 steps."""
    return Walks(
        robots=searches,
        homes=searches,
        first=first,
        targets=1,
        difficulty=1.0,
        steps=min(1000, 2 * recipe.search_steps),
        seed=first,
        tables=tables,
    )


def _next(difficulty: float, share: float) -> float:
    """The next epoch's difficulty."""
    change = _STEP if share >= _HARDER else -_STEP if share <= _EASIER else 0.0
    return float(min(max(round(difficulty + change, 3), 0.0), 1.0))


def train_search(out: Path, recipe: SearchRecipe, *, console: Console, about: str = "") -> dict[str, Any]:
    """Train, compare and write search.safetensors with its card.

    Args:
        out: Folder for everything. A run that has ended goes on when more epochs are asked for.
        recipe: How.
        console: Where progress is shown.
        about: The command that does it again, for the card.

    Returns:
        The card.

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
        card = {
            "data": f"{training.epoch * recipe.segments * recipe.segment * recipe.robots} steps in "
            f"{min(recipe.homes, training.epoch * recipe.at_once)} invented homes",
            "command": about,
            "method": "imitation of a guide that knows the way (DAgger), then proximal policy optimisation",
            "recipe": asdict(recipe),
            "hidden": HIDDEN,
            "parameters": sum(int(value.size) for value in best.weights.values()),
            "cpu_hours": round(training.seconds / 3600, 2),
            "curve": [row for row in training.curve if "held_out_arrived" in row],
            "test": f"{walks.robots} searches anywhere in as many homes held out, of at most {walks.steps} steps",
            "scores": {
                "learned": judge(best, walks),
                "learned, most likely actions": judge(best, walks, most_likely=True),
                "guide": judge("guide", walks),
                "random": judge("random", walks),
            },
        }
        write_whole(out / "search.safetensors", save(dict(best.weights)))
        write_json(out / "search.json", card)
    return card
