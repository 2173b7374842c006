"""`robosim train` for what is learnt by acting: where to look next, which action to take."""

from pathlib import Path

from tyro.conf import OmitArgPrefixes

from robosim.commands.speaking import console, tell
from robosim.commands.terminal import (
    ALL_CORES,
    WorkOptions,
    folder_for,
    going_on,
)


def explorer(
    *,
    rounds: int = 60,
    homes: int = 24,
    decisions: int = 300,
    held_out: int = 40,
    seed: int = 0,
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    smoke: bool = False,
    out: Path | None = None,
) -> None:
    """Train the choice among frontiers by reinforcement (PPO), on walks through invented homes.

    Writes explorer.safetensors with its card, result.json and the curve. It begins with the rating "gain". The
    best weights are chosen on homes held out; on further ones they are compared with the hand-made ratings in the end.
    An interrupted run goes on when the same command is given again; the result does not depend on the number of
    workers.

    Example: robosim train explorer --out out/explorer

    Args:
        rounds: Rounds of walks and improvement.
        homes: Homes of a round, a walk through each.
        decisions: Decisions of a walk.
        held_out: Homes to choose the best weights by, and as many to compare in the end.
        seed: Seed of homes, starts, weights and choices.
        work: Who does the work.
        smoke: A run of a minute that shows that all works: two rounds of few, short walks.
        out: Folder for the results, and to go on from; a new one under runs/ if not given.
    """
    from robosim.training.explorer import ExplorerRecipe, train_explorer

    if smoke:
        rounds, homes, decisions, held_out = (
            min(rounds, 2),
            min(homes, 3),
            min(decisions, 40),
            min(held_out, 2),
        )
    recipe = ExplorerRecipe(
        rounds=rounds, homes=homes, decisions=decisions, held_out=held_out, every=1 if smoke else 5, seed=seed
    )
    folder = folder_for(out, "train explorer")
    told = (
        f"robosim train explorer --rounds {rounds} --homes {homes} --decisions {decisions} --held-out {held_out} "
        f"--seed {seed}"
    )
    with going_on(folder):
        card = train_explorer(
            folder, recipe, workers=work.count, cluster=work.cluster, console=console, about=told
        )
    tell(card, folder)
    for rating, mean in card["mean_coverage"].items():
        console.print(f"{rating:>10}: {mean:.4f} of the floor seen on average over a walk", highlight=False)
    console.print(f"Wrote the explorer, its card and curve in {folder}")


def steering(
    *,
    rounds: int = 5,
    homes: int = 60,
    held_out: int = 60,
    seed: int = 0,
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    smoke: bool = False,
    out: Path | None = None,
) -> None:
    """Train the learned local policy by imitation of the deterministic one (DAgger), on drives in made homes.

    Writes steering.safetensors with its card, on which both are compared in homes held out. An interrupted run goes on
    when the same command is given again; the result does not depend on the number of workers.

    Example: robosim train steering --out out/steering

    Args:
        rounds: Rounds of driving and learning.
        homes: Homes of a round, a drive to one target in each.
        held_out: Homes for the comparison in the end.
        seed: Seed of homes, targets, noise and weights.
        work: Who does the work.
        smoke: A run of a minute that shows that all works: two rounds of a few short drives.
        out: Folder for the results, and to go on from; a new one under runs/ if not given.
    """
    from dataclasses import replace

    from robosim.training.steering import SteeringRecipe, train_steering

    if smoke:
        rounds, homes, held_out = min(rounds, 2), min(homes, 2), min(held_out, 2)
    recipe = SteeringRecipe(rounds=rounds, homes=homes, held_out=held_out, seed=seed)
    if smoke:
        recipe = replace(recipe, epochs=2, max_steps=15)
    folder = folder_for(out, "train steering")
    told = f"robosim train steering --rounds {rounds} --homes {homes} --held-out {held_out} --seed {seed}"
    with going_on(folder):
        card = train_steering(
            folder, recipe, workers=work.count, cluster=work.cluster, console=console, about=told
        )
    tell(card, folder)
    for name, mean in card["mean_of_drives"].items():
        console.print(
            f"{name:>10}: {100 * mean['arrived']:.1f} % arrived, {mean['steps']:.1f} decisions and {mean['bumps']:.2f} "
            "bumps a drive",
            highlight=False,
        )
    console.print(f"Wrote the local policy and its card in {folder}")


def search(
    *,
    epochs: int = 400,
    imitation: int = 30,
    homes: int = 144,
    held_out: int = 32,
    seed: int = 0,
    smoke: bool = False,
    out: Path | None = None,
) -> None:
    """Train a search end to end: a recurrent network that drives from depth, radio and odometry alone.

    In invented homes; first by imitation of a guide that knows the way (DAgger), then on its own arrivals (PPO).
    Writes search.safetensors with its card, and curve.json after each epoch of 32768 steps, which takes a minute of one
    core that is shared with other work. Radio is traced once for each target and kept in the folder. An interrupted run
    goes on when the same command is given again, and so does one that has ended, if more epochs are asked for. One
    process, one thread.

    Example: robosim train search --out out/search

    What it learned drives by robosim episode office --goal out/search/search.safetensors

    Args:
        epochs: Epochs in all.
        imitation: Of which so many by imitation.
        homes: Homes to learn in.
        held_out: Searches to choose the best weights by, and twice as many to compare in the end.
        seed: Seed of homes, searches, noise, weights and choices.
        smoke: A run of a minute or two that shows that all works: two epochs of few, short searches.
        out: Folder for the results, and to go on from; a new one under runs/ if not given.
    """
    from dataclasses import replace

    from robosim.training.search import SearchRecipe, train_search

    recipe = SearchRecipe(epochs=epochs, imitation=imitation, homes=homes, held_out=held_out, seed=seed)
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
    folder = folder_for(out, "train search")
    told = (
        f"robosim train search --epochs {epochs} --imitation {imitation} --homes {homes} --held-out {held_out} "
        f"--seed {seed}"
    )
    with going_on(folder):
        card = train_search(folder, recipe, console=console, about=told)
    tell(card, folder)
    for name, score in card["scores"].items():
        console.print(
            f"{name:>28}: {100 * score['arrived']:.1f} % arrived, success weighted by path length {score['spl']:.2f}",
            highlight=False,
        )
    console.print(f"Wrote the search, its card and curve in {folder}")
