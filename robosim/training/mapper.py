"""Train the learned mapper on collected frames, with held-out homes.

Every tenth home is held out for the scores on the card and for the choice of the best weights; the card also has the
scores of the classical map on the same frames.
"""

import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from rich.console import Console
from rich.progress import Progress

from robosim.datasets.collect import MOST_SHARD_BYTES, CollectConfig, collect, read_shard
from robosim.datasets.true_patch import MATTERS, OBSTACLE, SEEN
from robosim.support.files import plain, write_files, write_json
from robosim.support.interrupt import noted_interrupt
from robosim.support.reading import read_bytes
from robosim.support.run_folder import run_folder
from robosim.support.torch_training import torch_threads
from robosim.training.policy_weights import Checkpoint
from robosim.training.training_plots import plot_mapper
from slam.learning.mapper import Frames, Recipe, classical_scores, coded, train
from slam.networks.features import Features
from slam.networks.files import files_of

#: Every so many homes, one is held out.
HOLD_OUT = 10


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
    settings = {
        "recipe": asdict(recipe),
        "homes": {
            path.name: crc32(read_bytes(path, "frames", most_bytes=MOST_SHARD_BYTES))
            for group in homes
            for path in group
        },
    }
    with (
        run_folder(out, "train mapper", settings),
        torch_threads(threads),
        Progress(console=console, transient=True) as progress,
    ):
        reading = progress.add_task("reading", total=sum(map(len, homes)))
        frames, held_out = (read_frames(group, lambda: progress.advance(reading)) for group in homes)
        learning = progress.add_task("learning", total=recipe.steps)
        with noted_interrupt("this batch", (signal.SIGINT, signal.SIGTERM)) as interrupt:

            def on_step(step: int) -> None:
                progress.update(learning, completed=step)
                interrupt.stop()

            network, curve = train(frames, held_out, recipe, Checkpoint(out / "checkpoint.pt"), on_step)
        classical = classical_scores(held_out)
        card: dict[str, Any] = {
            "data": f"{len(homes[0])} homes, {len(frames)} frames; "
            f"held out {len(homes[1])}, {len(held_out)} frames",
            "command": about,
            "recipe": asdict(recipe),
            "parameters": network.parameters,
            "validation": min(curve, key=lambda row: row["loss"]),
            "validation_classical": classical,
            "seconds": round(time.perf_counter() - start, 1),
        }
        write_files(out, files_of(network, plain(card), "mapper"))
        write_json(out / "result.json", {**card, "curve": curve})
        plot_mapper(curve, classical, out / "curves.png")
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


def smoke_frames(folder: Path, console: Console) -> Path:
    """A folder of few frames, collected unless it exists, to check that training works."""
    collect(CollectConfig(homes=4, steps=30), folder, workers=1, console=console)
    return folder
