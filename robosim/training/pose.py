"""Train the learned pose on collected frames, and score it on homes that were held out.

The map before a frame is what the classical mapper believed after the frame before, as it was collected; where a frame
begins a walk there is none. Homes are held out as for the mapper (`robosim.training.mapper`).
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from robosim.datasets.collect import read_shard
from robosim.support.files import write_files, write_json
from robosim.support.run_folder import run_folder
from robosim.training.mapper import split_homes
from slam.learning.mapper import coded
from slam.learning.pose import Pairs, PoseRecipe, pose_scores, train_pose
from slam.learning.threads import torch_threads
from slam.networks.features import Features
from slam.networks.files import pose_files
from slam.networks.pose_network import INPUTS, SIDE, PoseNetwork
from slam.poses import between


def train_pose_network(
    data: Path, out: Path, recipe: PoseRecipe, *, threads: int, console: Console, about: str = ""
) -> dict[str, Any]:
    """Train, score and write a network of the pose.

    Args:
        data: Folder of shards (`robosim.datasets.collect`).
        out: Folder for `pose.safetensors`, its card and `result.json`.
        recipe: How to train.
        threads: Threads of the network.
        console: Where to print.
        about: The command that does it again, for the card.

    Returns:
        The card.

    Raises:
        ValueError: If there are too few homes.
    """
    start = time.perf_counter()
    learnt, held_out = split_homes(data)
    with run_folder(out, "train pose"):
        with torch_threads(threads):
            with Progress(console=console, transient=True) as progress:
                reading = progress.add_task("reading", total=len(learnt) + len(held_out))
                pairs, held = (
                    read_pairs(part, lambda: progress.advance(reading)) for part in (learnt, held_out)
                )
                learning = progress.add_task("learning", total=recipe.steps)
                network, curve = train_pose(
                    pairs, recipe, lambda step: progress.update(learning, completed=step)
                )
            scores = pose_scores(network, held)
            used = network.network()
            call_ms = _call_ms(used)
        card: dict[str, Any] = {
            "data": f"{len(learnt)} homes, {len(pairs)} pairs; held out {len(held_out)}, {len(held)} pairs",
            "command": about,
            "recipe": asdict(recipe),
            "parameters": used.parameters,
            "validation": scores,
            "single_call_ms": round(call_ms, 3),
            "seconds": round(time.perf_counter() - start, 1),
        }
        write_files(out, pose_files(used, card, "pose"))
        write_json(out / "result.json", {**card, "curve": curve})
    return card


def read_pairs(shards: Sequence[Path], on_shard: Callable[[], Any] = lambda: None) -> Pairs:
    """Frames of shards, each with the map before it.

    Args:
        shards: Files of `robosim.datasets.collect`.
        on_shard: Called after each.

    Raises:
        ValueError: If a file is not such a shard.
    """
    features_of = Features()
    scans, beliefs, displacements = [], [], []
    for path in shards:
        depth, belief, pose, action = read_shard(path, ("depth", "belief", "pose", "action"))
        known = coded(2 * (belief.astype(np.float32) / 255) - 1)
        known[np.abs(known) <= 1] = 0  # 0.5 is between two of the numbers that were kept
        nothing = np.full(belief.shape[1:], 0.5, np.float32)
        for k in np.flatnonzero(action[1:] >= 0) + 1:
            features = features_of.of(depth[k].astype(np.float32) / 1000, nothing)
            scans.append(coded(features[: INPUTS - 1]))
            beliefs.append(known[k - 1])
            displacements.append(between(pose[k - 1], pose[k]))
        on_shard()
    return Pairs(
        scan=np.array(scans).reshape(-1, INPUTS - 1, 64, 64).astype(np.int8),
        belief=np.array(beliefs).reshape(-1, 64, 64).astype(np.int8),
        displacement=np.array(displacements, float).reshape(-1, 3),
    )


def _call_ms(network: PoseNetwork, rounds: int = 30) -> float:
    """Median time of one answer."""
    patches = np.zeros((1, INPUTS, SIDE, SIDE), np.float32)
    seconds = []
    for _ in range(rounds):
        begin = time.perf_counter()
        network(patches)
        seconds.append(time.perf_counter() - begin)
    return 1000 * float(np.median(seconds))
