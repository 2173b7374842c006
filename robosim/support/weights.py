"""Trained networks in files: weights as safetensors, and a card that says what they are and what they reached."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from safetensors.numpy import load, save

from robosim.support.reading import expanded, reading

T = TypeVar("T")
#: Trained numbers by their names.
Weights = Mapping[str, np.ndarray]
#: Largest magnitude of a weight. Trained weights are of order one; damaged ones overflow float32.
LARGEST = 1e6
#: Numbers that batch normalisation counts by itself.
_COUNTED = ("running_mean", "running_var", "num_batches_tracked")
#: A card is a page of text [bytes].
_MOST_CARD = 5_000_000


def check_weights(weights: Weights, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Check that weights fit a network.

    Raises:
        ValueError: If names, shapes or types differ, a value is NaN, infinite or above `LARGEST`, or a variance is
            negative.
    """
    kinds = {name: np.int64 if name.endswith("num_batches_tracked") else np.float32 for name in shapes}
    if {k: (w.shape, w.dtype) for k, w in weights.items()} != {
        k: (shape, np.dtype(kinds[k])) for k, shape in shapes.items()
    }:
        raise ValueError("other names, shapes or kinds of numbers")
    for name, values in weights.items():
        if values.dtype.kind == "f" and not (np.abs(values) <= LARGEST).all():
            raise ValueError(f"{name} has values that are NaN, infinite or above {LARGEST:,.0f}")
        if name.endswith("running_var") and (values < 0).any():
            raise ValueError(f"{name} has negative variances")


def trained_numbers(weights: Weights) -> int:
    """Count of trained numbers: all but what batch normalisation counts by itself."""
    return sum(int(np.size(array)) for name, array in weights.items() if not name.endswith(_COUNTED))


def network_files(
    name: str, weights: Weights, head: Mapping[str, Any], card: Mapping[str, Any]
) -> dict[str, bytes]:
    """The contents of NAME.safetensors and of its card, NAME.json, which begins with `head`."""
    text = json.dumps({**head, **{key: value for key, value in card.items() if key not in head}}, indent=2)
    return {f"{name}.safetensors": save(dict(weights)), f"{name}.json": f"{text}\n".encode()}


def load_network(
    path: str | Path, what: str, of: str, remedy: str, make: Callable[[Weights, dict[str, Any]], T]
) -> tuple[T, dict[str, Any]]:
    """Return the network that `make` builds from the weights in a file and the card next to it, and the card.

    `what` and `of` name file and card in messages, such as "weights of a mapper" and "a mapper".

    Raises:
        FileError: If a file is missing or damaged, or they do not fit each other.
    """
    path = expanded(path)
    card_path = path.with_suffix(".json")
    with reading(path, f"{what} that {card_path.name} describes", remedy) as file:
        with reading(card_path, f"the card of {of}", remedy, most_bytes=_MOST_CARD) as card_file:
            card: dict[str, Any] = json.loads(card_file.read())
        return make(load(file.read()), card), card


def read_weights(path: Path, like: Weights, what: str) -> Weights:
    """Weights from a .safetensors file; FileError if the file is missing, damaged, or of something else."""
    with reading(path, f"weights of {what}", f"Train them again with `robosim train {what}`.") as file:
        weights: Weights = load(file.read())
        check_weights(weights, {name: array.shape for name, array in like.items()})
        return weights
