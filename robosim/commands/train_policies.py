"""`robosim train` for policies that are trained in simulation: explorer, steering, search."""

from dataclasses import replace
from pathlib import Path

from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import ALL_CORES, Work, training


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


def steering(
    *,
    rounds: int = 5,
    homes: int = 60,
    held_out: int = 60,
    seed: int = 0,
    work: Work = ALL_CORES,
    smoke: bool = False,
    out: Path | None = None,
) -> None:
    """Train the learned local policy by imitation of the deterministic one (DAgger), on drives in generated homes.

    Writes steering.safetensors with its card, which compares both policies in held-out homes. The same command resumes
    an interrupted run; the result does not depend on the number of workers.

    Example: robosim train steering --out out/steering

    Args:
        rounds: Rounds of driving and learning.
        homes: Homes of a round, with a drive to one target in each.
        held_out: Homes of the final comparison.
        seed: Seed of homes, targets, noise and weights.
        work: Worker processes.
        smoke: Whether to try everything in a minute, with two rounds of a few short drives.
        out: Output folder, also of a run to resume; by default a new one under runs/.
    """
    from robosim.training.steering import SteeringRecipe, train_steering

    if smoke:
        rounds, homes, held_out = min(rounds, 2), min(homes, 2), min(held_out, 2)
    recipe = SteeringRecipe(rounds=rounds, homes=homes, held_out=held_out, seed=seed)
    if smoke:
        recipe = replace(recipe, epochs=2, max_steps=15)
    options = {"rounds": rounds, "homes": homes, "held_out": held_out, "seed": seed}
    with training(out, "steering", **options) as (folder, about):
        card = train_steering(
            folder, recipe, workers=work.count, cluster=work.cluster, console=console, about=about
        )
    emit_result(card, folder)
    for name, mean in card["mean_of_drives"].items():
        console.print(
            f"{name:>10}: {100 * mean['arrived']:.1f} % arrived, {mean['steps']:.1f} decisions and {mean['bumps']:.2f} "
            "bumps per drive",
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
        held_out: Searches that choose the best weights, and twice as many for the final comparison.
        seed: Seed of homes, searches, noise, weights and choices.
        smoke: Whether to try everything in a minute or two, with two epochs of few, short searches.
        out: Output folder, also of a run to resume; by default a new one under runs/.
    """
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
    with training(
        out, "search", epochs=epochs, imitation=imitation, homes=homes, held_out=held_out, seed=seed
    ) as (folder, about):
        card = train_search(folder, recipe, console=console, about=about)
    emit_result(card, folder)
    for name, score in card["scores"].items():
        console.print(
            f"{name:>28}: {100 * score['arrived']:.1f} % arrived, success weighted by path length {score['spl']:.2f}",
            highlight=False,
        )
    console.print(f"Wrote the search, its card and curve in {folder}")
