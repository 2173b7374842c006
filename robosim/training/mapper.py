"""Train the learned mapper on collected frames, and score it on homes that were held out.

Every tenth home is held out, for the choice of the best weights and for the scores on the card. Scores of the classical
map on the same frames stand beside them.
"""

import signal
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from robosim.datasets.collect import CollectConfig, collect, read_shard
from robosim.datasets.true_patch import MATTERS, OBSTACLE, SEEN
from robosim.support.checkpoint import Checkpoint
from robosim.support.files import write_files, write_json
from robosim.support.interrupt import noted_interrupt
from robosim.support.run_folder import run_folder
from robosim.training.mapper_plots import plot_curve
from slam.learning.mapper import Frames, Recipe, classical_scores, coded, train
from slam.learning.threads import torch_threads
from slam.networks.features import Features
from slam.networks.files import mapper_files

#: One home in so many is held out.
HOLD_OUT = 10


def train_mapper(
    data: Path, out: Path, recipe: Recipe, *, threads: int, console: Console, about: str = ""
) -> dict[str, Any]:
    """Train, score and write a mapper.

    Args:
        data: Folder of shards (`robosim.datasets.collect`).
        out: Folder for everything, and to go on from.
        recipe: How to train.
        threads: Threads of the network.
        console: Where to print.
        about: The command that does it again, for the card.

    Returns:
        The card.

    Raises:
        ValueError: If there are too few homes.
        FolderError: If the folder holds a run of another recipe or of other homes.
    """
    start = time.perf_counter()
    learnt, held_out = split_homes(data)
    settings = {"recipe": asdict(recipe), "homes": [path.name for path in (*learnt, *held_out)]}
    with (
        run_folder(out, "train mapper", settings),
        torch_threads(threads),
        Progress(console=console, transient=True) as progress,
    ):
        reading = progress.add_task("reading", total=len(learnt) + len(held_out))
        frames, held = (read_frames(part, lambda: progress.advance(reading)) for part in (learnt, held_out))
        learning = progress.add_task("learning", total=recipe.steps)
        with noted_interrupt("this batch", (signal.SIGINT, signal.SIGTERM)) as interrupt:

            def on_step(step: int) -> None:
                progress.update(learning, completed=step)
                interrupt.stop()

            network, curve = train(frames, held, recipe, Checkpoint(out / "checkpoint.pt"), on_step)
        classical = classical_scores(held)
        best = min(curve, key=lambda row: row["loss"])
        card: dict[str, Any] = {
            "data": f"{len(learnt)} homes, {len(frames)} frames; held out {len(held_out)}, {len(held)} frames",
            "command": about,
            "recipe": asdict(recipe),
            "parameters": network.parameters,
            "validation": best,
            "validation_classical": classical,
            "seconds": round(time.perf_counter() - start, 1),
        }
        write_files(out, mapper_files(network, card, "mapper"))
        write_json(out / "result.json", {**card, "curve": curve})
        plot_curve(curve, classical, out / "curves.png")
    return card


def split_homes(data: Path) -> tuple[list[Path], list[Path]]:
    """Shards to learn from, and those that are held out.

    Raises:
        ValueError: If there are too few.
    """
    shards = sorted(Path(data).glob("home-*.npz"))
    held_out = shards[HOLD_OUT - 1 :: HOLD_OUT] or shards[-1:]
    learnt = [path for path in shards if path not in held_out]
    if not learnt:
        raise ValueError(
            f"{data} holds {len(shards)} homes, expected two or more: one is held out. Collect more with "
            "`robosim collect`."
        )
    return learnt, held_out


def read_frames(shards: Sequence[Path], on_shard: Any = lambda: None) -> Frames:
    """Frames of shards as a network learns from them.

    Args:
        shards: Files of `robosim.datasets.collect`.
        on_shard: Called after each.

    Raises:
        ValueError: If a file is not such a shard.
    """
    features_of = Features()
    features, truth = [], []
    for path in shards:
        depth, belief, packed = read_shard(path, ("depth", "belief", "truth"))
        truth.append(np.unpackbits(packed, axis=-1).astype(bool))
        for image, known in zip(depth, belief, strict=True):
            metres = image.astype(np.float32) / 1000
            features.append(coded(features_of.of(metres, known.astype(np.float32) / 255)))
        on_shard()
    true = np.concatenate(truth)
    return Frames(
        features=np.stack(features), obstacle=true[:, OBSTACLE], seen=true[:, SEEN], matters=true[:, MATTERS]
    )


def smoke_frames(folder: Path, console: Console) -> Path:
    """A folder of few frames, collected if they are not there: to see that training works, not to learn from."""
    collect(CollectConfig(homes=4, steps=30), folder, workers=1, console=console)
    return folder
