"""Trained networks in files: weights as safetensors, and a card that says what they are and what they reached."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from safetensors.torch import load, save
from torch import nn

from slam.mapper.network import MapNetwork, NetworkConfig
from slam.mapper.pose_network import PoseNetwork, PoseNetworkConfig
from slam.reading import reading

Network = TypeVar("Network", bound=nn.Module)
#: A card is a page of text [bytes].
_MOST_CARD = 5_000_000


def save_mapper(network: MapNetwork, card: dict[str, Any], path: Path) -> None:
    """Write PATH (.safetensors) and the card beside it (.json)."""
    _save(network, {"widths": list(network.config.widths), "inputs": network.config.inputs}, card, path)


def save_pose(network: PoseNetwork, card: dict[str, Any], path: Path) -> None:
    """Write PATH (.safetensors) and the card beside it (.json)."""
    _save(network, {"widths": list(network.config.widths), "hidden": network.config.hidden}, card, path)


def _save(network: nn.Module, head: dict[str, Any], card: dict[str, Any], path: Path) -> None:
    text = json.dumps({**head, **{key: value for key, value in card.items() if key not in head}}, indent=2)
    weights = {name: value.detach().contiguous() for name, value in network.state_dict().items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    for target, content in ((path, save(weights)), (path.with_suffix(".json"), f"{text}\n".encode())):
        partial = target.with_name(f".{target.name}.partial-{os.getpid()}")
        partial.write_bytes(content)
        os.replace(partial, target)


def load_mapper(path: Path) -> tuple[MapNetwork, dict[str, Any]]:
    """A network from its weights, ready for use, and its card, which lies beside them.

    Raises:
        FileError: If a file is missing or damaged, or they do not fit each other.
    """
    return _load(
        path,
        "mapper",
        lambda card: MapNetwork(NetworkConfig(widths=tuple(card["widths"]), inputs=card["inputs"])),
    )


def load_pose(path: Path) -> tuple[PoseNetwork, dict[str, Any]]:
    """A network of the pose from its weights; see `load_mapper`.

    Raises:
        FileError: If a file is missing or damaged, or they do not fit each other.
    """
    return _load(
        path,
        "pose",
        lambda card: PoseNetwork(PoseNetworkConfig(widths=tuple(card["widths"]), hidden=card["hidden"])),
    )


def _load(
    path: Path, what: str, network_of: Callable[[dict[str, Any]], Network]
) -> tuple[Network, dict[str, Any]]:
    remedy = f"Train it anew with `robosim train {what}`."
    card_path = path.with_suffix(".json")
    with reading(path, f"weights of a {what} that {card_path.name} describes", remedy) as file:
        with reading(card_path, f"the card of a {what}", remedy, most_bytes=_MOST_CARD) as card_file:
            card: dict[str, Any] = json.loads(card_file.read())
            network = network_of(card)
        weights = load(file.read())
        expected = network.state_dict()
        if {k: (w.shape, w.dtype) for k, w in weights.items()} != {
            k: (w.shape, w.dtype) for k, w in expected.items()
        }:
            raise ValueError("other names, shapes or kinds of numbers")
        if wrong := [name for name, values in weights.items() if not values.isfinite().all()]:
            raise ValueError(f"{wrong[0]} has values that are no numbers")
        network.load_state_dict(weights)
    return network.eval(), card
