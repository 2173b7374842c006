"""Train the learned local policy by imitation of the deterministic controller.

In the first round the deterministic controller drives through generated homes to targets that the planner knows; in
later rounds the network drives an increasing share, so that it also learns from its own positions (DAgger). After each
round it is trained from scratch on all data. At the end both drive to the same targets in held-out homes. An
interrupted run continues with its round.

Reference: Ross, Gordon and Bagnell, A reduction of imitation learning to no-regret online learning, AISTATS 2011.
"""

import time
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from rich.console import Console

from robosim.building.reach import reach
from robosim.datasets.collect import CollectConfig, home_building
from robosim.episode import drive
from robosim.episode_log import EpisodeLog
from robosim.navigation import make_navigator
from robosim.policies.estimates import Estimates
from robosim.policies.goals import Oracle
from robosim.robot.odometry import NoiseModel
from robosim.simulator import Observation, Simulator, SimulatorConfig
from robosim.step import Truth
from robosim.support.arrays_in import FAR, Array, read_npz
from robosim.support.checks import SEED, STEPS, Range, checked
from robosim.support.files import npz_bytes, write_whole
from robosim.support.progress import tracked
from robosim.support.reading import reading
from robosim.support.run_folder import run_folder
from robosim.support.workers import Workers
from robosim.task.tasks import make_task
from robosim.training.policy_weights import as_arrays, as_tensors, count_parameters, write_policy
from slam.actions import PUBLISHED, Action
from slam.control.controller import ControlConfig, Controller
from slam.control.learned import HIDDEN, INPUTS, LearnedController, initial_weights
from slam.planning.planner import Plan
from slam.support.weights import Weights

#: Number of the first home of the comparison; training homes begin at 0.
_TEST = 100_000


@dataclass(frozen=True, kw_only=True)
@checked
class SteeringRecipe:
    """Recipe of the local policy."""

    rounds: Annotated[int, Range(1, 1000)] = 5
    """Rounds of driving and learning."""
    homes: Annotated[int, Range(1, _TEST)] = 60
    """Homes of a round, a drive to one target in each."""
    epochs: Annotated[int, Range(1, 10_000)] = 30
    """Passes over all data, after each round."""
    held_out: Annotated[int, Range(1, 100_000, "homes")] = 60
    """Homes of the comparison."""
    max_steps: Annotated[int, STEPS] = 300
    """Actions of a drive."""
    rate: Annotated[float, Range(1e-8, 1)] = 2e-3
    """Highest learning rate."""
    batch: Annotated[int, Range(1, 1_000_000, "decisions")] = 256
    """Decisions of a step of learning."""
    noise: NoiseModel = field(default_factory=NoiseModel)
    """Noise of motion and odometry."""
    seed: Annotated[int, SEED] = 0
    """Seed of homes, targets, noise and weights."""

    def __post_init__(self) -> None:
        if self.rounds * self.homes > _TEST:
            raise ValueError(
                f"rounds is {self.rounds} and homes {self.homes}, expected at most {_TEST} homes in all: "
                "others are held out."
            )


class SupervisedController(LearnedController):
    """Records the action of the deterministic controller at each decision, and follows it or the network."""

    def __init__(self, weights: Weights, own: float, rng: np.random.Generator, config: ControlConfig) -> None:
        """Follow the network with probability `own`, drawn by `rng`."""
        super().__init__(weights, config)
        self._own, self._rng = own, rng
        self.records: list[tuple[Float32[np.ndarray, " n"], Action]] = []

    def _best(self, pose: Float[np.ndarray, "3"], plan: Plan) -> Action:
        advised = Controller._best(self, pose, plan)
        senses = self.senses(pose, plan)
        self.records.append((senses, advised))
        return Action(int(np.argmax(self.scores(senses)))) if self._rng.random() < self._own else advised


def drive_home(home: int, recipe: SteeringRecipe, controller: Controller) -> dict[str, float]:
    """Drive to a target in a generated home; returns arrival, decisions and collisions."""
    building = home_building(CollectConfig(seed=recipe.seed), home)
    config = SimulatorConfig(physics="kinematic", noise=recipe.noise)
    rng = np.random.default_rng([recipe.seed, home, 6])
    task = make_task(reach(building, *config.robot.hull_m), rng, min_path_m=2.0)
    navigator = make_navigator(config)._replace(controller=controller)
    log = EpisodeLog(task)

    def judge(sensed: Observation, estimated: Estimates, true: Truth) -> bool:
        log.add_pose(true.motion, true.pose, estimated.pose, 0.0)
        # A drive that starts at its target has one step.
        return log.steps < recipe.max_steps and not (log.arrived and log.steps)

    controller.reset()
    with closing(Simulator(building, config)) as simulator:
        drive(simulator, navigator, Oracle(task.target), task, rng, judge)
    bumps = sum(motion.collided for motion in log.motions)
    return {"arrived": float(log.arrived), "steps": float(log.steps), "bumps": float(bumps)}


def lesson(
    home: int, recipe: SteeringRecipe, weights: Weights, own: float
) -> tuple[Float32[np.ndarray, "n k"], Int[np.ndarray, " n"]]:
    """Inputs of the network on a drive, and actions of the deterministic controller."""
    robot = SimulatorConfig().robot
    rng = np.random.default_rng([recipe.seed, home, 7])
    pupil = SupervisedController(weights, own, rng, ControlConfig(radius_m=robot.radius_m, reverses=False))
    drive_home(home, recipe, pupil)
    senses = np.array([senses for senses, _ in pupil.records], np.float32).reshape(-1, INPUTS)
    return senses, np.array([int(advised) for _, advised in pupil.records], np.int64)


def learn(
    senses: Float32[np.ndarray, "n k"], advised: Int[np.ndarray, " n"], recipe: SteeringRecipe, round_: int
) -> dict[str, Float32[np.ndarray, "..."]]:
    """Weights that imitate the advised actions: cross entropy, AdamW, a cosine from the highest rate to zero."""
    rng = np.random.default_rng([recipe.seed, round_, 8])
    torch.manual_seed(recipe.seed)
    weights = as_tensors(initial_weights(rng))
    steps = max(1, round(len(senses) / recipe.batch)) * recipe.epochs
    optimiser = torch.optim.AdamW(weights.values(), lr=recipe.rate, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for _ in range(steps):
        part = rng.integers(len(senses), size=recipe.batch)
        x, y = torch.from_numpy(senses[part]), torch.from_numpy(advised[part])
        h = x
        for k in range(2):
            h = torch.relu(h @ weights[f"{k}.weight"] + weights[f"{k}.bias"])
        loss = torch.nn.functional.cross_entropy(h @ weights["2.weight"] + weights["2.bias"], y)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    return as_arrays(weights)


def read_round(path: Path) -> tuple[Float32[np.ndarray, "n k"], Int[np.ndarray, " n"]]:
    """What was sensed in the drives of a round, and the actions advised.

    Raises:
        FileError: If the file is damaged.
    """
    with reading(path, "decisions of a round", "Delete it to drive again.") as file:
        arrays = read_npz(file, _ROUND)
        if not np.isin(arrays["advised"], PUBLISHED).all():
            raise ValueError("an advice is no action")
        return arrays["senses"], arrays["advised"]


_ROUND = {"senses": Array("f4", f"n {INPUTS}", FAR), "advised": Array("i", "n")}


def train_steering(
    out: Path,
    recipe: SteeringRecipe,
    *,
    workers: int,
    cluster: str | None = None,
    console: Console,
    about: str = "",
) -> dict[str, Any]:
    """Train, compare and write steering.safetensors with its card; arguments as of `train_explorer`.

    Raises:
        FolderError: If the folder holds a run of another recipe.
        WorkerLost: If a process was killed; finished rounds are stored.
    """
    start = time.perf_counter()
    with run_folder(out, "train steering", asdict(recipe)), Workers(workers, cluster, what="drives") as pool:
        weights: Weights = initial_weights(np.random.default_rng(recipe.seed))
        senses, advised, curve = np.zeros((0, INPUTS), np.float32), np.zeros(0, np.int64), []
        with tracked(range(recipe.rounds), "rounds", console) as rounds:
            for n in rounds:
                new_senses, new_advised = _round(out / f"round-{n + 1}.npz", n, recipe, weights, pool)
                if n:
                    pupil = LearnedController(weights, ControlConfig())
                    agreed = float(np.mean(np.argmax(pupil.scores(new_senses), axis=1) == new_advised))
                    curve.append({"round": n + 1, "decisions": len(new_senses), "agreed": round(agreed, 4)})
                senses, advised = np.vstack([senses, new_senses]), np.append(advised, new_advised)
                weights = learn(senses, advised, recipe, n)
        config = ControlConfig(radius_m=SimulatorConfig().robot.radius_m)
        controllers = {"planned": Controller(config), "learned": LearnedController(weights, config)}
        scores = {}
        for name, controller in controllers.items():
            homes = range(_TEST, _TEST + recipe.held_out)
            drives = pool.in_order(drive_home, [(home, recipe, controller) for home in homes])
            scores[name] = {key: round(float(np.mean([row[key] for row in drives])), 4) for key in drives[0]}
        card: dict[str, Any] = {
            "data": f"{len(senses)} decisions in {recipe.rounds * recipe.homes} generated homes",
            "command": about,
            "recipe": asdict(recipe),
            "hidden": HIDDEN,
            "parameters": count_parameters(weights),
            "agreement": curve,
            "test_homes": recipe.held_out,
            "mean_of_drives": scores,
            "seconds": round(time.perf_counter() - start, 1),
        }
        write_policy(out, "steering", weights, card)
    return card


def _round(
    path: Path, n: int, recipe: SteeringRecipe, weights: Weights, pool: Workers
) -> tuple[Float32[np.ndarray, "n k"], Int[np.ndarray, " n"]]:
    """Inputs and advised actions of a round, from its file if it exists."""
    if not path.exists():
        homes = range(n * recipe.homes, (n + 1) * recipe.homes)
        own = n / max(1, recipe.rounds - 1)
        seen = pool.in_order(lesson, [(home, recipe, weights, own) for home in homes])
        senses, advised = (np.concatenate(part) for part in zip(*seen, strict=True))
        write_whole(path, npz_bytes({"senses": senses, "advised": advised}))
    return read_round(path)
