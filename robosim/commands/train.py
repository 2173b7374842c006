"""`robosim train`: networks that are trained on data, and policies that are trained in simulation."""

from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Annotated, Any

from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import ALL_CORES, THREADS, Work, training
from robosim.support.checks import Range


def link_state(
    *,
    data: Path,
    test: Path | None = None,
    aod: bool = True,
    peak: bool = True,
    delay: bool = True,
    epochs: int | None = None,
    members: Annotated[int, Range(1, 100, "networks")] = 1,
    homes: Annotated[int | None, Range(0, 100_000)] = None,
    folds: Annotated[int | None, Range(0, 1000)] = None,
    n_folds: Annotated[int | None, Range(1, 1000, "folds")] = None,
    seed: int = 0,
    work: Work = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Train a classifier of link states on public measurements (mmwRobotNav) or a data set, and score it.

    It is trained on some of the buildings and scored on those held out, then trained on all of them. Writes
    link-state.safetensors with its card, result.json, curves and pictures. The same command resumes an interrupted
    run; the result does not depend on the number of workers. The last line is the accuracy on the test buildings, or
    without --test on the held-out ones, over all links.

    Example: robosim train link-state --data mmwrobotnav --out out/link-state

    Args:
        data: Folder of measurements with a folder for each building, or the output of `robosim dataset`.
        test: Such a folder to score the final classifier on.
        aod: Whether angles of departure are used; they need a transmitter whose beams are known.
        peak: Whether heights of peaks are used, where they were measured.
        delay: Whether delays are used, where they were measured; between beams they need a synchronised transmitter.
        epochs: Passes over the links; by default 10 with generated homes, otherwise 7.
        members: Networks whose probabilities are averaged.
        homes: Additional generated homes, made first, two seconds each on two cores; by default 600 on public
            measurements, otherwise none.
        folds: Folds that are held out, one after the other; by default all, 0 trains on all buildings only.
        n_folds: Folds that the buildings are divided into; by default 3, or the number of buildings if fewer.
        seed: Seed of the first network.
        work: Worker processes.
        out: Output folder, also of a run to resume; by default a new one under runs/.
    """
    if folds is not None and n_folds is not None and folds > n_folds:
        raise ValueError(f"folds is {folds}, expected at most n_folds = {n_folds}.")
    if test is not None and not test.is_dir():
        raise ValueError(f"test is {str(test)!r}, which is not a folder. Give one like --data.")
    from robosim.training.link_state import LinkStateTraining, train_link_state
    from wireless.linkstate.data import is_data_set
    from wireless.linkstate.learning.training import Recipe

    if homes is None:
        homes = 0 if is_data_set(data) else 600
    if epochs is None:
        epochs = 10 if homes else Recipe.epochs
    used = {"aoa": True, "aod": aod, "snr": True, "peak": peak, "delay": delay}
    inputs = tuple(name for name, is_used in used.items() if is_used)
    options = {"data": data.name, "aod": aod, "peak": peak, "delay": delay, "epochs": epochs}
    options |= {"members": members, "homes": homes, "folds": folds, "n_folds": n_folds, "seed": seed}
    with training(out, "link-state", **options) as (folder, command):
        run = LinkStateTraining(
            data=data,
            test=test,
            recipe=Recipe(inputs=inputs, seed=seed, epochs=epochs),
            n_folds=n_folds,
            folds=folds,
            members=members,
            homes=homes,
        )
        card = train_link_state(
            run, folder, workers=work.count, cluster=work.cluster, command=command, console=console
        )
    emit_result(card, folder)
    console.print(f"Wrote the classifier, its card and pictures in {folder}")
    if test is not None:
        score = f"test accuracy {card['test']['accuracy']:.4f} ({card['test']['links']} links)"
    else:
        score = f"validation accuracy {card['validation']['mean_accuracy']:.4f} (held-out buildings)"
    console.print(score, highlight=False)


def mapper(
    *,
    data: Path | None = None,
    steps: int = 3000,
    batch: int = 32,
    widths: tuple[int, ...] = (16, 32, 64, 96),
    seed: int = 0,
    threads: Annotated[int, THREADS] = 2,
    smoke: bool = False,
    out: Path | None = None,
) -> None:
    """Train the neural mapper on collected frames, supervised by the ground truth in them.

    Writes mapper.safetensors with its card, result.json and the curves. Every tenth home is held out to choose the best
    weights and to score them. The same command resumes an interrupted run.

    Example: robosim train mapper --data out/frames --out out/mapper

    Args:
        data: Folder of frames (`robosim collect`); with --smoke a few are collected.
        steps: Batches.
        batch: Frames of a batch.
        widths: Channels of the network at each scale, finest first.
        seed: Seed of the first weights and of the order of frames.
        threads: Threads of the network.
        smoke: Whether to try everything in a minute or two, with few frames and steps.
        out: Output folder, also of a run to resume; by default a new one under runs/.
    """
    if data is None and not smoke:
        raise ValueError("data is missing: give a folder of frames (`robosim collect`), or --smoke to try.")
    if data is not None and not data.is_dir():
        raise ValueError(f"data is {str(data)!r}, which is not a folder. Make one with `robosim collect`.")
    from robosim.training.mapper import smoke_frames, train_mapper
    from slam.learning.mapper import Recipe
    from slam.networks.map_network import NetworkConfig

    steps = min(steps, 60) if smoke else steps
    recipe = Recipe(
        network=NetworkConfig(widths=widths), steps=steps, batch=batch, seed=seed, every=20 if smoke else 250
    )
    name = "frames" if data is None else data.name
    with training(out, "mapper", data=name, steps=steps, batch=batch, seed=seed) as (folder, about):
        frames = data or smoke_frames(folder / "frames", console)
        card = train_mapper(frames, folder, recipe, threads=threads, console=console, about=about)
    emit_result(card, folder)
    for name, score in (("learned", card["validation"]), ("classical map", card["validation_classical"])):
        console.print(
            f"{name:>14}: IoU of obstacles seen {score['iou_seen']:.3f}, hidden {score['iou_hidden']:.3f}, of hidden "
            f"floor {score['iou_hidden_floor']:.3f}; calibration error {score['calibration_error_seen']:.3f} seen, "
            f"{score['calibration_error_hidden']:.3f} hidden",
            highlight=False,
        )
    console.print(f"Wrote the mapper, its card and curves in {folder}")
    console.print(
        f"Next: robosim episode flat --goal explore --mapper {quote(str(folder / 'mapper.safetensors'))}"
    )


def explorer(
    *,
    rounds: int = 60,
    homes: int = 24,
    decisions: int = 300,
    held_out: int = 40,
    seed: int = 0,
    work: Work = ALL_CORES,
    smoke: bool = False,
    out: Path | None = None,
) -> None:
    """Train the choice among frontiers by reinforcement learning (PPO), on walks through generated homes.

    Writes explorer.safetensors with its card, result.json and the curve. Training starts from the rating "gain". The
    best weights are chosen on held-out homes, and compared with the hand-made ratings on others. The same command
    resumes an interrupted run; the result does not depend on the number of workers.

    Example: robosim train explorer --out out/explorer

    Args:
        rounds: Rounds of walks and improvement.
        homes: Homes of a round, with one walk in each.
        decisions: Decisions of a walk.
        held_out: Homes that choose the best weights, and as many for the final comparison.
        seed: Seed of homes, starts, weights and choices.
        work: Worker processes.
        smoke: Whether to try everything in a minute, with two rounds of few, short walks.
        out: Output folder, also of a run to resume; by default a new one under runs/.
    """
    from robosim.training.explorer import ExplorerRecipe, train_explorer

    if smoke:
        rounds, homes = min(rounds, 2), min(homes, 3)
        decisions, held_out = min(decisions, 40), min(held_out, 2)
    recipe = ExplorerRecipe(
        rounds=rounds, homes=homes, decisions=decisions, held_out=held_out, every=1 if smoke else 5, seed=seed
    )
    with training(
        out, "explorer", rounds=rounds, homes=homes, decisions=decisions, held_out=held_out, seed=seed
    ) as (folder, about):
        card = train_explorer(
            folder, recipe, workers=work.count, cluster=work.cluster, console=console, about=about
        )
    emit_result(card, folder)
    for rating, mean in card["mean_coverage"].items():
        console.print(f"{rating:>10}: {mean:.4f} of the floor seen on average over a walk", highlight=False)
    console.print(f"Wrote the explorer, its card and curve in {folder}")


def search(
    *,
    epochs: int = 400,
    imitation: int = 30,
    homes: int = 144,
    offices: float = 0.0,
    search_steps: int = 500,
    start: Path | None = None,
    difficulty: float = 0.3,
    advice: float = 0.3,
    held_out: int = 32,
    seed: int = 0,
    smoke: bool = False,
    out: Path | None = None,
) -> None:
    """Train a search end to end: a recurrent network that drives by depth, radio and odometry alone.

    Training is in generated homes, first by imitation of a guide that knows the route (DAgger), then by reinforcement
    learning (PPO). Writes search.safetensors with its card, and curve.json after each epoch of 32768 steps, about a
    minute of one core. Radio is traced once for each target and stored in the folder. The same command resumes an
    interrupted run, and continues a finished one if more epochs are given. One process, one thread.

    Example: robosim train search --out out/search

    The network drives in robosim episode office --goal out/search/search.safetensors

    Args:
        epochs: Number of epochs.
        imitation: Number of epochs by imitation, the first ones.
        homes: Homes that searches take place in.
        offices: Share of these that are offices of up to 2000 m2 instead, 0 to 1.
        search_steps: Steps after which a search is given up.
        start: File of weights to start from, also of the shipped network; by default random ones.
        difficulty: Difficulty at first, by the distance of targets, 0 to 1.
        advice: Weight of the guide's actions after imitation, which halves in 30 epochs.
        held_out: Searches that choose the best weights, and twice as many for the final comparison.
        seed: Seed of homes, searches, noise, weights and choices.
        smoke: Whether to try everything in a minute or two, with two epochs of few, short searches.
        out: Output folder, also of a run to resume; by default a new one under runs/.
    """
    from robosim.training.search import SearchRecipe, train_search

    options: dict[str, Any] = {
        "epochs": epochs, "imitation": imitation, "homes": homes, "offices": offices, "search_steps": search_steps,
        "difficulty": difficulty, "advice": advice, "held_out": held_out, "seed": seed,
    }  # fmt: skip
    if start is not None:
        options["start"] = str(start)
    recipe = SearchRecipe(**options)
    if smoke:
        recipe = replace(
            recipe,
            epochs=min(epochs, 2),
            imitation=1,
            robots=4,
            segments=2,
            segment=16,
            homes=min(homes, 2),
            at_once=2,
            targets=1,
            search_steps=20,
            held_out=min(held_out, 2),
            every=1,
        )
    with training(out, "search", **options) as (folder, about):
        card = train_search(folder, recipe, console=console, about=about)
    emit_result(card, folder)
    for name, score in card["scores"].items():
        console.print(
            f"{name:>28}: {100 * score['arrived']:.1f} % arrived, success weighted by path length {score['spl']:.2f}",
            highlight=False,
        )
    console.print(f"Wrote the search, its card and curve in {folder}")
