"""Train classifiers of link states on public measurements: on folds with held-out buildings, then on all buildings.

Each network of each fold is a job, and so is each network of the final classifier, which is trained on all buildings.
Jobs run in processes of one thread. Jobs run again in their folder continue after their last finished epoch, and give
the same weights for any number of processes. Held-out buildings give the scores and the temperature; the temperature
for the scores of a building comes from other buildings.
"""

import time
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.text import Text

from robosim.support.files import plain, write_files, write_json
from robosim.support.installation import package_version
from robosim.support.progress import unit_progress
from robosim.support.run_folder import run_folder
from robosim.support.torch_training import weights_of
from robosim.support.workers import Workers
from robosim.training.generated_links import generate_homes, read_homes
from robosim.training.policy_weights import Checkpoint, median_call_ms
from robosim.training.training_plots import plot_epochs, plot_scores
from wireless.linkstate.calibration import fit_temperature
from wireless.linkstate.classifier import LinkStateClassifier
from wireless.linkstate.data import Links, carrier_hz, read_links
from wireless.linkstate.epoch import Epoch
from wireless.linkstate.learning.training import Recipe, train
from wireless.linkstate.scores import calibrated_across, scores
from wireless.linkstate.tokens import reached
from wireless.support.counting import counted

#: Folds by default.
FOLDS = 3
_NAMES = ("outage", "LOS", "first-order", "higher-order")


@dataclass(frozen=True, kw_only=True)
class Job:
    """Job of training a network."""

    name: str
    data: Path
    """Folder of measurements."""
    held_out: tuple[int, ...]
    """Numbers of buildings outside its training."""
    homes: int
    """Number of generated homes in its training, from OUT/homes."""
    recipe: Recipe
    out: Path
    """Folder of the run, in which processes of a cluster store checkpoints."""


@dataclass(frozen=True, kw_only=True)
class LinkStateTraining:
    """Training of link-state networks: model, data and scores."""

    data: Path
    """Folder of measurements, or a data set."""
    test: Path | None
    """Folder of measurements, or a data set, to score the final classifier on."""
    recipe: Recipe
    """Inputs that were not measured are left out; the seed is increased by the number of the member."""
    n_folds: int | None
    """Folds that the buildings are divided into; None for `FOLDS`, or the number of buildings if fewer."""
    folds: int | None
    """Folds that are held out, one after the other; None for all."""
    members: int
    """Networks whose probabilities are averaged."""
    homes: int
    """Additional generated homes in each training."""


def train_link_state(
    training: LinkStateTraining,
    out: Path,
    *,
    workers: int,
    cluster: str | None = None,
    command: str,
    console: Console,
) -> dict[str, Any]:
    """Train, score and write a classifier on public measurements; returns its card.

    A run in `out` can continue with more folds, members or tests. Processes of the dask scheduler `cluster` must see
    the folders.

    Raises:
        ValueError: If there are too few buildings, or neither held-out nor test buildings.
        FolderError: If the folder holds networks of another recipe or of other data.
        WorkerLost: If a process was killed, after the other jobs have ended.
    """
    start = time.perf_counter()
    links, frequency_hz = links_of(training.data), carrier_hz(training.data)
    inputs = tuple(name for name in training.recipe.inputs if name in links.measured)
    training = replace(
        training,
        recipe=replace(training.recipe, inputs=inputs),
        n_folds=training.n_folds or min(FOLDS, len(links.names)),
    )
    parts = _parts(training, links)
    console.print(
        Text(
            f"{counted(len(links.state), 'link')} of {counted(len(links.names), 'building')} in {training.data}"
        )
    )
    # These networks may be used with more folds, members and tests.
    trained_on = {
        "data": f"{training.data.name}: {', '.join(links.names)}",
        "links": len(links.state),
        "homes": training.homes,
        "recipe": asdict(training.recipe),
    }
    with run_folder(out, "train link-state", {**trained_on, "of": training.n_folds}):
        jobs = _jobs(training, parts, out)
        is_new = not any(out.glob("jobs/*"))
        generate_homes(training.homes, out / "homes", workers=workers, cluster=cluster, console=console)
        every = [job for group in jobs.values() for job in group]
        trained = run_jobs(every, workers=workers, cluster=cluster, console=console)
        plot_epochs({name: epochs for name, (_, epochs) in trained.items()}, out / "curves.png")
        # Generated homes have links of all states.
        classifiers = {
            name: _classifier(
                training.recipe,
                [trained[job.name][0] for job in group],
                links if training.homes else links[~links.within(group[0].held_out)],
            )
            for name, group in jobs.items()
        }
        final = classifiers["all"]
        # Probabilities of each held-out link by the fold without its building; NaN for other links.
        held_out = np.full((len(links.state), 4), np.nan)
        for i, fold in enumerate(parts):
            rows = links.within(fold)
            held_out[rows] = classifiers[f"fold{i}"].predict_tokens(links.tokens[rows])
        validation = _validate(held_out, parts, links, out, console)
        known = ~np.isnan(held_out[:, 0]) & reached(links.tokens)
        final.temperature = fit_temperature(held_out[known], links.state[known].astype(int))
        link = links.tokens[np.flatnonzero(reached(links.tokens))[:1]]
        card: dict[str, Any] = {
            "command": command,
            **trained_on,
            "frequency_ghz": frequency_hz and frequency_hz / 1e9,
            "members": training.members,
            "parameters": final.parameters,
            "validation": validation,
            "single_call_ms": median_call_ms(lambda: final.predict_tokens(link), 200),
            # The duration of a continued run is unknown.
            "seconds": round(time.perf_counter() - start, 1) if is_new else None,
            "versions": {name: package_version(name) for name in ("robosim", "torch", "numpy")},
        }
        if training.test is not None:
            card["test"] = _test(final, training.test, out, console)
        final.card = plain(card)
        write_files(out, final.files("link-state"))
        write_json(out / "result.json", card)
    return card


def _parts(training: LinkStateTraining, links: Links) -> list[tuple[int, ...]]:
    """Buildings of each fold that is held out."""
    folds = deal(len(links.names), training.n_folds or FOLDS)
    if training.folds is not None and training.folds > len(folds):
        raise ValueError(f"folds is {training.folds}, expected at most n_folds = {len(folds)}.")
    parts = folds[: training.folds]
    if not parts and training.test is None:
        raise ValueError(
            "folds is 0 and there are no test buildings: nothing would be scored. Give one of them."
        )
    if any(len(fold) == len(links.names) for fold in parts):
        raise ValueError(
            f"{training.data} has {len(links.names)} building; holding it out leaves none to train on."
        )
    return parts


def _jobs(training: LinkStateTraining, parts: list[tuple[int, ...]], out: Path) -> dict[str, list[Job]]:
    """Networks of each fold, and of the final classifier."""
    return {
        name: [
            Job(
                name=f"{name}-{i}",
                data=training.data,
                held_out=fold,
                homes=training.homes,
                recipe=replace(training.recipe, seed=training.recipe.seed + i),
                out=out,
            )
            for i in range(training.members)
        ]
        for name, fold in [*((f"fold{i}", fold) for i, fold in enumerate(parts)), ("all", ())]
    }


def _classifier(recipe: Recipe, networks: list[Any], links: Links) -> LinkStateClassifier:
    """Return the classifier of trained networks, for the states in their data."""
    return LinkStateClassifier(
        [weights_of(network) for network in networks],
        inputs=recipe.inputs,
        options=recipe.options,
        states=tuple(int(s) for s in np.unique(links.state[reached(links.tokens)])),
    )


def _test(final: LinkStateClassifier, test: Path, out: Path, console: Console) -> dict[str, Any]:
    """Scores in test buildings."""
    links = read_links(test)
    score = _score(final.predict_tokens(links.tokens), links, out / "test.png")
    _print(score, f"test buildings: {', '.join(links.names)}", console)
    return score


def run_jobs(
    jobs: list[Job], *, workers: int, cluster: str | None = None, console: Console
) -> dict[str, tuple[Any, list[Epoch]]]:
    """Networks and epochs of all jobs, by name, from worker processes or from those of a dask scheduler.

    Raises:
        KeyboardInterrupt: After Ctrl-C, at once: finished epochs are stored.
        WorkerLost: If a process was killed, after the other networks are trained.
    """
    trained = {}
    with (
        Workers(min(workers, len(jobs)), cluster, what="networks", resumable=True) as pool,
        unit_progress(console, "networks", len(jobs)) as advance,
    ):
        for number, trained_job in pool.run(run_job, [(job,) for job in jobs]):
            trained[jobs[number].name] = trained_job
            advance(jobs[number].name)
    return trained


def run_job(job: Job) -> tuple[Any, list[Epoch]]:
    """Train one network, and score it on its held-out buildings after each epoch."""
    links = links_of(job.data)
    held_out = links.within(job.held_out)
    tokens, state = links.tokens[~held_out], links.state[~held_out]
    if job.homes:
        home_tokens, home_state = read_homes(job.homes, job.out / "homes")
        tokens, state = np.concatenate([tokens, home_tokens]), np.concatenate([state, home_state])
    return train(
        tokens,
        state,
        job.recipe,
        watch=(links.tokens[held_out], links.state[held_out]),
        checkpoint=Checkpoint(job.out / "jobs" / f"{job.name}.pt"),
    )


@cache
def links_of(data: Path) -> Links:
    """Links of a folder, read once per process."""
    return read_links(data)


def deal(buildings: int, of: int) -> list[tuple[int, ...]]:
    """Numbers of buildings in random folds that depend only on their count.

    Raises:
        ValueError: If there are fewer buildings than folds.
    """
    if not 1 <= of <= buildings:
        raise ValueError(f"{of} folds, expected 1 to {buildings}, the number of buildings.")
    order = np.random.default_rng(0).permutation(buildings)
    return [tuple(sorted(int(i) for i in fold)) for fold in np.array_split(order, of)]


def _validate(
    held_out: Float[np.ndarray, "n 4"],
    parts: list[tuple[int, ...]],
    links: Links,
    out: Path,
    console: Console,
) -> dict[str, Any]:
    """Scores of each fold."""
    result: dict[str, Any] = {}
    for i, fold in enumerate(parts):
        rows = links.within(fold)
        held = links[rows]
        judged = calibrated_across(held_out[rows], held.state, reached(held.tokens), held.building)
        result[f"fold{i}"] = _score(judged, held, out / f"fold{i}.png")
        _print(result[f"fold{i}"], f"fold{i}, held out: {', '.join(links.names[i] for i in fold)}", console)
    if result:
        result["mean_accuracy"] = float(np.mean([fold["accuracy"] for fold in result.values()]))
        console.print(
            f"mean validation accuracy of {counted(len(parts), 'fold')}: {result['mean_accuracy']:.4f}"
        )
    return result


def _score(probability: Float[np.ndarray, "n 4"], links: Links, picture: Path) -> dict[str, Any]:
    """Scores of links, with a plot."""
    with_paths = reached(links.tokens)
    plot_scores(probability[with_paths], links.state[with_paths], picture)
    return scores(probability, links.state, with_paths, links.building, links.names)


def _print(score: dict[str, Any], title: str, console: Console) -> None:
    """Print the confusion matrix and a line of scores."""
    matrix = np.array(score["confusion"], float)
    shares = matrix / np.maximum(matrix.sum(1, keepdims=True), 1)
    console.print(title)
    console.print(f"{'true / found':>14}" + "".join(f"{name:>14}" for name in _NAMES) + f"{'links':>10}")
    for name, row, count in zip(_NAMES, shares, matrix.sum(1), strict=True):
        console.print(
            f"{name:>14}" + "".join(f"{share:14.3f}" for share in row) + f"{count:10.0f}", highlight=False
        )
    console.print(
        f"accuracy {score['accuracy']:.4f}, of links with paths {score['accuracy_with_paths']:.4f}; "
        f"calibration error {score['calibration_error']:.4f}, of links with paths "
        f"{score['calibration_error_with_paths']:.4f}",
        highlight=False,
    )
