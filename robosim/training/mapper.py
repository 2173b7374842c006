"""Train the learned mapper and the learned pose on collected frames, with held-out homes.

Every tenth home is held out for the scores on the card and, for the mapper, for the choice of the best weights; the
card also has the scores of the classical map on the same frames. The pose network compares a frame with the map before
it, which is the stored belief of the classical mapper after the previous frame; the first frame of a walk has none.
"""

import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import Progress

from robosim.datasets.collect import CollectConfig, collect, read_shard
from robosim.datasets.true_patch import MATTERS, OBSTACLE, SEEN
from robosim.support.files import write_files, write_json
from robosim.support.interrupt import noted_interrupt
from robosim.support.run_folder import run_folder
from robosim.support.torch_training import torch_threads
from robosim.training.policy_weights import Checkpoint, median_call_ms
from robosim.training.training_plots import plot_mapper
from slam.learning.mapper import Frames, Recipe, classical_scores, coded, train
from slam.learning.pose import Pairs, PoseRecipe, pose_scores, train_pose
from slam.networks.features import Features
from slam.networks.files import files_of
from slam.networks.pose_network import INPUTS, SIDE
from slam.poses import between

#: Every so many homes, one is held out.
HOLD_OUT = 10
T = TypeVar("T")


def train_mapper(
    data: Path, out: Path, recipe: Recipe, *, threads: int, console: Console, about: str = ""
) -> dict[str, Any]:
    """Train, score and write a mapper from a folder of shards (`robosim.datasets.collect`); returns its card.

    `out` may hold an unfinished run; `about` is the command for the card.

    Raises:
        ValueError: If there are too few homes.
        FolderError: If the folder holds a run of another recipe or of other homes.
    """
    start = time.perf_counter()
    homes = split_homes(data)
    settings = {"recipe": asdict(recipe), "homes": [path.name for group in homes for path in group]}
    with (
        run_folder(out, "train mapper", settings),
        torch_threads(threads),
        Progress(console=console, transient=True) as progress,
    ):
        frames, held_out = _read_homes(homes, read_frames, progress)
        learning = progress.add_task("learning", total=recipe.steps)
        with noted_interrupt("this batch", (signal.SIGINT, signal.SIGTERM)) as interrupt:

            def on_step(step: int) -> None:
                progress.update(learning, completed=step)
                interrupt.stop()

            network, curve = train(frames, held_out, recipe, Checkpoint(out / "checkpoint.pt"), on_step)
        classical = classical_scores(held_out)
        card: dict[str, Any] = {
            "data": _describe(homes, frames, held_out, "frames"),
            "command": about,
            "recipe": asdict(recipe),
            "parameters": network.parameters,
            "validation": min(curve, key=lambda row: row["loss"]),
            "validation_classical": classical,
            "seconds": round(time.perf_counter() - start, 1),
        }
        write_files(out, files_of(network, card, "mapper"))
        write_json(out / "result.json", {**card, "curve": curve})
        plot_mapper(curve, classical, out / "curves.png")
    return card


def train_pose_network(
    data: Path, out: Path, recipe: PoseRecipe, *, threads: int, console: Console, about: str = ""
) -> dict[str, Any]:
    """Train, score and write a pose network; arguments and errors as of `train_mapper`; returns the card."""
    start = time.perf_counter()
    homes = split_homes(data)
    with run_folder(out, "train pose"):
        with torch_threads(threads):
            with Progress(console=console, transient=True) as progress:
                pairs, held_out = _read_homes(homes, read_pairs, progress)
                learning = progress.add_task("learning", total=recipe.steps)
                module, curve = train_pose(
                    pairs, recipe, lambda step: progress.update(learning, completed=step)
                )
            scores, network = pose_scores(module, held_out), module.network()
            patches = np.zeros((1, INPUTS, SIDE, SIDE), np.float32)
            call_ms = median_call_ms(lambda: network(patches), 30)
        card: dict[str, Any] = {
            "data": _describe(homes, pairs, held_out, "pairs"),
            "command": about,
            "recipe": asdict(recipe),
            "parameters": network.parameters,
            "validation": scores,
            "single_call_ms": call_ms,
            "seconds": round(time.perf_counter() - start, 1),
        }
        write_files(out, files_of(network, card, "pose"))
        write_json(out / "result.json", {**card, "curve": curve})
    return card


def split_homes(data: Path) -> tuple[list[Path], list[Path]]:
    """Shards for training, and held-out ones; ValueError if there are too few."""
    shards = sorted(Path(data).glob("home-*.npz"))
    held_out = shards[HOLD_OUT - 1 :: HOLD_OUT] or shards[-1:]
    training = [path for path in shards if path not in held_out]
    if not training:
        raise ValueError(
            f"{data} holds {len(shards)} homes, expected two or more: one is held out. Collect more with "
            "`robosim collect`."
        )
    return training, held_out


def _read_homes(
    homes: tuple[list[Path], list[Path]],
    read: Callable[[Sequence[Path], Callable[[], object]], T],
    progress: Progress,
) -> tuple[T, T]:
    """Data of the homes for training and of the held-out ones."""
    task = progress.add_task("reading", total=sum(map(len, homes)))
    training, held_out = (read(group, lambda: progress.advance(task)) for group in homes)
    return training, held_out


def _describe(homes: tuple[list[Path], list[Path]], data: Any, held_out: Any, unit: str) -> str:
    training, others = homes
    return f"{len(training)} homes, {len(data)} {unit}; held out {len(others)}, {len(held_out)} {unit}"


def read_frames(shards: Sequence[Path], on_shard: Callable[[], object] = lambda: None) -> Frames:
    """Frames of shards for training; `on_shard` is called after each shard.

    Raises:
        ValueError: If a file is not such a shard.
    """
    extractor = Features()
    features, truth = [], []
    for path in shards:
        depth, belief, packed = read_shard(path, ("depth", "belief", "truth"))
        truth.append(np.unpackbits(packed, axis=-1).astype(bool))
        for image, known in zip(depth, belief, strict=True):
            metres = image.astype(np.float32) / 1000
            features.append(coded(extractor.of(metres, known.astype(np.float32) / 255)))
        on_shard()
    true = np.concatenate(truth)
    return Frames(
        features=np.stack(features), obstacle=true[:, OBSTACLE], seen=true[:, SEEN], matters=true[:, MATTERS]
    )


def read_pairs(shards: Sequence[Path], on_shard: Callable[[], object] = lambda: None) -> Pairs:
    """Frames of shards, each with the map before it; `on_shard` is called after each shard.

    Raises:
        ValueError: If a file is not such a shard.
    """
    extractor = Features()
    scans, beliefs, displacements = [], [], []
    for path in shards:
        depth, belief, pose, action = read_shard(path, ("depth", "belief", "pose", "action"))
        known = coded(2 * (belief.astype(np.float32) / 255) - 1)
        known[np.abs(known) <= 1] = 0  # 0.5 is between two of the stored numbers
        empty = np.full(belief.shape[1:], 0.5, np.float32)
        for k in np.flatnonzero(action[1:] >= 0) + 1:
            features = extractor.of(depth[k].astype(np.float32) / 1000, empty)
            scans.append(coded(features[: INPUTS - 1]))
            beliefs.append(known[k - 1])
            displacements.append(between(pose[k - 1], pose[k]))
        on_shard()
    return Pairs(
        scan=np.array(scans).reshape(-1, INPUTS - 1, 64, 64).astype(np.int8),
        belief=np.array(beliefs).reshape(-1, 64, 64).astype(np.int8),
        displacement=np.array(displacements, float).reshape(-1, 3),
    )


def smoke_frames(folder: Path, console: Console) -> Path:
    """A folder of few frames, collected unless it exists, to check that training works."""
    collect(CollectConfig(homes=4, steps=30), folder, workers=1, console=console)
    return folder
