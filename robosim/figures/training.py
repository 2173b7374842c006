"""What training runs of link-state classifiers left behind, as pictures: loss, accuracy, confusion.

A run is a folder of `robosim train link-state`: `result.json`, and a table of epochs for each network under
`jobs`. A card is the JSON beside a classifier's weights, with the same scores but no epochs.
"""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from robosim.drawing.gallery import Picture
from robosim.support.assets import shipped_weights
from robosim.support.reading import reading
from robosim.support.text_in import MOST_JSON, check_object, parse_json
from robosim.training.link_state_plots import plot_confusions, plot_curves
from wireless.linkstate.epoch import Epoch
from wireless.support.counting import counted

#: Row-normalised diagonal published for outage, LOS, first and higher order. Reference: arXiv 2110.14789.
PUBLISHED_RIGHT = {
    "with angles of departure": (1.0, 0.96, 0.80, 0.83),
    "without angles of departure": (1.0, 0.88, 0.74, 0.81),
}
#: Bytes of a table of epochs, and their number.
_MOST_BYTES, _MOST_EPOCHS = 10_000_000, 1_000_000


def draw_training(runs: Sequence[Path], out: Path) -> tuple[list[Picture], list[str]]:
    """Draw curves of runs, and confusion matrices of runs or else of the shipped classifiers.

    Args:
        runs: Folders of training runs.
        out: Folder for the pictures.

    Returns:
        The pictures, and notes on what is missing.

    Raises:
        ValueError: If a folder holds no finished run.
    """
    pictures, notes = [], []
    cards = {run.name: read_card(run / "result.json") for run in runs}
    if len(cards) < len(runs):
        raise ValueError("Training runs have folders of the same name, which tells them apart. Rename one.")
    curves = {f"{run.name} {name}": epochs for run in runs for name, epochs in read_epochs(run).items()}
    if curves:
        plot_curves(curves, out / "training.png")
        pictures.append(
            Picture(
                name="training.png",
                title="Training loss and accuracy",
                caption="Cross entropy of the links trained on (drawn through, with the augmentation and smoothed "
                "labels of the recipe) and of buildings held out (dashed), and accuracy on these, by epoch. A network "
                "named all holds out none. Published: 88 % on unseen buildings after 300 epochs.",
            )
        )
    else:
        notes.append(
            "No curves of training: give a folder of `robosim train link-state` by --training for them."
        )
    cards = cards or {name: read_card(path.with_suffix(".json")) for name, path in shipped_weights().items()}
    matrices = {}
    for name, card in cards.items():
        found = confusion_of(card)
        if found is not None:
            matrices[f"{name}, {_departures(card)}\n{found[0]}"] = found[1]
    if matrices:
        plot_confusions(matrices, out / "confusion.png")
        pictures.append(Picture(name="confusion.png", title="Confusion of link states", caption=_caption()))
    missing = set(PUBLISHED_RIGHT) - {_departures(card) for card in cards.values()}
    notes += [f"No confusion matrix {kind}: no such classifier was given." for kind in sorted(missing)]
    return pictures, notes


def read_card(path: Path) -> dict[str, Any]:
    """Scores of a training run or a classifier.

    Raises:
        FileError: If the file is missing or none of them.
    """
    remedy = "Give one that `robosim train link-state` wrote when it had finished."
    with reading(path, "a result of training a classifier", remedy, most_bytes=MOST_JSON) as file:
        card = check_object(parse_json(file.read()), ("recipe", "validation"))
        _departures(card)
        confusion_of(card)
        return card


def read_epochs(run: Path) -> dict[str, list[Epoch]]:
    """Epochs of each network of a run, by its name.

    Raises:
        FileError: If a table is damaged.
    """
    found = {path.stem: _epochs(path) for path in sorted((run / "jobs").glob("*.csv"))}
    return {name: epochs for name, epochs in found.items() if epochs}


def _epochs(path: Path) -> list[Epoch]:
    with reading(path, "a table of epochs", "Train the network again.", most_bytes=_MOST_BYTES) as file:
        rows = csv.DictReader(file.read().decode("utf-8").splitlines())
        return [_epoch(row) for row in rows]


def _epoch(row: dict[str, str]) -> Epoch:
    """A row of a table of epochs; scores are empty where nothing is held out."""
    number = int(row["epoch"])
    loss, accuracy, watched_loss = (float(row[key] or "nan") for key in ("loss", "accuracy", "watched_loss"))
    if not (0 < number < _MOST_EPOCHS and np.isfinite(loss)) or np.isinf([accuracy, watched_loss]).any():
        raise ValueError(f"epoch {number} has a loss of {loss:g}")
    return Epoch(
        epoch=number,
        loss=loss,
        accuracy=None if np.isnan(accuracy) else accuracy,
        watched_loss=None if np.isnan(watched_loss) else watched_loss,
    )


def confusion_of(card: dict[str, Any]) -> tuple[str, Int[np.ndarray, "4 4"]] | None:
    """Links by true and told state, and which they are: test buildings, or else all that were held out."""
    if "test" in card:
        return "test buildings", _counts(card["test"]["confusion"])
    folds = [
        _counts(scores["confusion"]) for name, scores in card["validation"].items() if name.startswith("fold")
    ]
    return (f"held-out buildings of {counted(len(folds), 'fold')}", np.sum(folds, axis=0)) if folds else None


def _counts(confusion: Any) -> Int[np.ndarray, "4 4"]:
    counts = np.array(confusion)
    if counts.shape != (4, 4) or counts.dtype.kind not in "iu" or counts.min() < 0:
        raise ValueError(f"a confusion of link states has shape {counts.shape}, expected 4 x 4 counts")
    return counts


def _departures(card: dict[str, Any]) -> str:
    return f"with{'' if 'aod' in card['recipe']['inputs'] else 'out'} angles of departure"


def _caption() -> str:
    published = "; ".join(
        f"{kind} {', '.join(f'{share:.2f}' for share in shares)}" for kind, shares in PUBLISHED_RIGHT.items()
    )
    return (
        "Share of the links of each true state (rows) that were told to be in each state (columns), on buildings not "
        f"trained on. Published diagonals for outage, LOS, first and higher order: {published}."
    )
