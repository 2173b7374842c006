"""`robosim train`."""

from pathlib import Path
from shlex import quote
from typing import Literal

from tyro.conf import OmitArgPrefixes

from robosim.commands.speaking import console, tell
from robosim.commands.terminal import (
    ALL_CORES,
    WorkOptions,
    check_threads,
    folder_for,
    going_on,
)
from robosim.support.checks import check_number


def link_state(
    *,
    data: Path,
    test: Path | None = None,
    model: Literal["ours", "reference", "huang"] = "ours",
    aod: bool = True,
    peak: bool = True,
    delay: bool = True,
    epochs: int | None = None,
    members: int = 1,
    homes: int | None = None,
    folds: int = 3,
    of: int = 3,
    seed: int = 0,
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Train a classifier of link states on public measurements (mmwRobotNav) or a data set, and score it.

    First on some of the buildings, scored on those held out; then on all of them, which is what is written:
    link-state.safetensors with its card, result.json, curves and pictures. An interrupted run goes on when the
    same command is given again; the result does not depend on the number of workers. The last line is the
    accuracy on the test buildings, or without --test on the held-out ones, over all links.

    Example: robosim train link-state --data mmwrobotnav --out out/link-state

    Args:
        data: Folder of measurements with a folder for each building, or what `robosim dataset` wrote.
        test: Such a folder to score the classifier on in the end.
        model: Ours, the published network, or hand-made features after Huang et al.
        aod: Whether angles of departure are used; they need a transmitter whose beams are known.
        peak: Whether heights of peaks are used, where they were measured.
        delay: Whether delays are used, where they were measured; between beams they need a synchronised transmitter.
        epochs: Passes over the links; if not given 10 with generated homes, else the model's own number.
        members: Networks whose probabilities are averaged.
        homes: Generated homes to learn from besides, made first, two seconds each on two cores; if not given 600
            for ours on public measurements, and none else.
        folds: Folds to hold out, one after the other; 0 trains on all buildings only.
        of: Folds that the buildings are dealt into.
        seed: Seed of the first network.
        work: Who does the work.
        out: Folder for the results, and to go on from; a new one under runs/ if not given.
    """
    check_number("of", of, 1, 1000, "folds", whole=True)
    check_number("folds", folds, 0, of, "of them, the number of --of", whole=True)
    check_number("homes", 0 if homes is None else homes, 0, 100_000, whole=True)
    check_number("members", members, 1, 100, "networks", whole=True)
    if test is not None and not test.is_dir():
        raise ValueError(f"test is {str(test)!r}, which is no folder. Give one like --data.")
    from dataclasses import replace

    from robosim.training.link_state import train_link_state
    from wireless.linkstate.data import is_data_set
    from wireless.linkstate.learning.training import default_recipe

    if homes is None:
        homes = 600 if model == "ours" and not is_data_set(data) else 0
    recipe = default_recipe(model)
    if epochs is None:
        epochs = 10 if homes and model == "ours" else recipe.epochs
    optional = {"aod": aod, "snr": True, "peak": peak, "delay": delay}
    inputs = ("aoa", *(name for name, wanted in optional.items() if wanted))
    flags = " ".join(
        f"--{'' if wanted else 'no-'}{name}" for name, wanted in optional.items() if name != "snr"
    )
    command = (
        f"robosim train link-state --data {data.name} --model {model} {flags} --epochs {epochs} "
        f"--members {members} --homes {homes} --folds {folds} --of {of} --seed {seed}"
    )
    folder = folder_for(out, "train link-state")
    with going_on(folder):
        card = train_link_state(
            data,
            folder,
            replace(recipe, inputs=inputs, seed=seed, epochs=epochs),
            test=test,
            folds=folds,
            of=of,
            members=members,
            homes=homes,
            workers=work.count,
            cluster=work.cluster,
            command=command,
            console=console,
        )
    tell(card, folder)
    console.print(f"Wrote the classifier, its card and pictures in {folder}")
    if test is not None:
        last = f"test accuracy {card['test']['accuracy']:.4f} ({card['test']['links']} links)"
    else:
        last = (
            f"validation accuracy {card['validation']['mean_accuracy']:.4f} (held-out buildings, see above)"
        )
    console.print(last, highlight=False)


def mapper(
    *,
    data: Path | None = None,
    steps: int = 3000,
    batch: int = 32,
    widths: tuple[int, ...] = (16, 32, 64, 96),
    seed: int = 0,
    threads: int = 2,
    smoke: bool = False,
    out: Path | None = None,
) -> None:
    """Train the learned mapper on collected frames, supervised by the truth kept with them.

    Writes mapper.safetensors with its card, result.json and the curves. Every tenth home is held out, for the choice of
    the best weights and the scores. An interrupted run goes on when the same command is given again.

    Example: robosim train mapper --data out/frames --out out/mapper

    Args:
        data: Folder of frames (`robosim collect`); with --smoke a few are collected.
        steps: Batches to learn from.
        batch: Frames of a batch.
        widths: Channels of the network at each scale, finest first.
        seed: Seed of the first weights and of the order of frames.
        threads: Threads of the network.
        smoke: A run of a minute or two that shows that all works: few frames, few steps.
        out: Folder for the results, and to go on from; a new one under runs/ if not given.
    """
    check_threads(threads, "threads")
    from robosim.training.mapper import smoke_frames, train_mapper
    from slam.learning.mapper import Recipe
    from slam.networks.map_network import NetworkConfig

    steps = min(steps, 60) if smoke else steps
    recipe = Recipe(
        network=NetworkConfig(widths=widths), steps=steps, batch=batch, seed=seed, every=20 if smoke else 250
    )
    _check_data(data, smoke)
    folder = folder_for(out, "train mapper")
    data = data or smoke_frames(folder / "frames", console)
    told = f"robosim train mapper --data {data.name} --steps {steps} --batch {batch} --seed {seed}"
    with going_on(folder):
        card = train_mapper(data, folder, recipe, threads=threads, console=console, about=told)
    tell(card, folder)
    for name, score in (("learned", card["validation"]), ("classical map", card["validation_classical"])):
        console.print(
            f"{name:>14}: IoU of obstacles seen {score['iou_seen']:.3f}, hidden {score['iou_hidden']:.3f}, of hidden "
            f"floor {score['iou_hidden_floor']:.3f}; calibration error {score['calibration_error_seen']:.3f} seen, "
            f"{score['calibration_error_hidden']:.3f} elsewhere",
            highlight=False,
        )
    console.print(f"Wrote the mapper, its card and curves in {folder}")
    console.print(
        f"Next: robosim episode flat --goal explore --mapper {quote(str(folder / 'mapper.safetensors'))}"
    )


def pose(
    *,
    data: Path | None = None,
    steps: int = 5000,
    batch: int = 48,
    seed: int = 0,
    threads: int = 2,
    smoke: bool = False,
    out: Path | None = None,
) -> None:
    """Train the learned pose on collected frames: how far off a predicted pose is, from map and frame.

    Writes pose.safetensors with its card, and result.json. Every tenth home is held out for the scores. Takes minutes;
    an interrupted run begins anew.

    Example: robosim train pose --data out/frames --out out/pose

    Args:
        data: Folder of frames (`robosim collect`); with --smoke a few are collected.
        steps: Batches to learn from.
        batch: Pairs of a batch.
        seed: Seed of the first weights, of the order of frames and of predicted poses.
        threads: Threads of the network.
        smoke: A run of less than a minute that shows that all works: few frames, few steps.
        out: Folder for the results; a new one under runs/ if not given.
    """
    check_threads(threads, "threads")
    from robosim.training.mapper import smoke_frames
    from robosim.training.pose import train_pose_network
    from slam.learning.pose import PoseRecipe

    steps = min(steps, 60) if smoke else steps
    recipe = PoseRecipe(steps=steps, batch=batch, seed=seed)
    _check_data(data, smoke)
    folder = folder_for(out, "train pose")
    data = data or smoke_frames(folder / "frames", console)
    told = f"robosim train pose --data {data.name} --steps {steps} --batch {batch} --seed {seed}"
    card = train_pose_network(data, folder, recipe, threads=threads, console=console, about=told)
    tell(card, folder)
    score = card["validation"]
    console.print(
        f"error of the pose, median: {1000 * score['told_m']:.1f} mm and {score['told_deg']:.2f} degrees, from "
        f"predictions {1000 * score['predicted_m']:.1f} mm and {score['predicted_deg']:.2f} degrees off; "
        f"{card['single_call_ms']:.2f} ms a call",
        highlight=False,
    )
    console.print(f"Wrote the network of the pose and its card in {folder}")


def _check_data(data: Path | None, smoke: bool) -> None:
    """See that there are frames to learn from, or that some are to be collected."""
    if data is None and not smoke:
        raise ValueError("data is missing: give a folder of frames (`robosim collect`), or --smoke to try.")
    if data is not None and not data.is_dir():
        raise ValueError(f"data is {str(data)!r}, which is no folder. Make one with `robosim collect`.")
