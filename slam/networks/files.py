"""Trained networks in files: weights as safetensors, and a card that says what they are and what they reached."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from safetensors.numpy import load, save

from robosim.support.reading import reading
from slam.networks.map_network import MapNetwork, NetworkConfig
from slam.networks.pose_network import PoseNetwork, PoseNetworkConfig
from slam.networks.weights import Weights

Network = TypeVar("Network", MapNetwork, PoseNetwork)
#: A card is a page of text [bytes].
_MOST_CARD = 5_000_000


def mapper_files(network: MapNetwork, card: dict[str, Any], name: str) -> dict[str, bytes]:
    """The contents of NAME.safetensors and of its card, NAME.json."""
    return _files(
        network, {"widths": list(network.config.widths), "inputs": network.config.inputs}, card, name
    )


def pose_files(network: PoseNetwork, card: dict[str, Any], name: str) -> dict[str, bytes]:
    """The contents of NAME.safetensors and of its card, NAME.json."""
    return _files(
        network, {"widths": list(network.config.widths), "hidden": network.config.hidden}, card, name
    )


def _files(
    network: MapNetwork | PoseNetwork, head: dict[str, Any], card: dict[str, Any], name: str
) -> dict[str, bytes]:
    text = json.dumps({**head, **{key: value for key, value in card.items() if key not in head}}, indent=2)
    return {f"{name}.safetensors": save(network.weights), f"{name}.json": f"{text}\n".encode()}


def load_mapper(path: Path) -> tuple[MapNetwork, dict[str, Any]]:
    """A network from its weights, ready for use, and its card from the same folder.

    Raises:
        FileError: If a file is missing or damaged, or they do not fit each other.
    """
    return _load(
        path,
        "mapper",
        lambda weights, card: MapNetwork(
            weights, NetworkConfig(widths=tuple(card["widths"]), inputs=card["inputs"])
        ),
    )


def load_pose(path: Path) -> tuple[PoseNetwork, dict[str, Any]]:
    """A network of the pose from its weights; see `load_mapper`.

    Raises:
        FileError: If a file is missing or damaged, or they do not fit each other.
    """
    return _load(
        path,
        "pose",
        lambda weights, card: PoseNetwork(
            weights, PoseNetworkConfig(widths=tuple(card["widths"]), hidden=card["hidden"])
        ),
    )


def _load(
    path: Path, what: str, network_of: Callable[[Weights, dict[str, Any]], Network]
) -> tuple[Network, dict[str, Any]]:
    remedy = f"Train it again with `robosim train {what}`."
    card_path = path.with_suffix(".json")
    with reading(path, f"weights of a {what} that {card_path.name} describes", remedy) as file:
        with reading(card_path, f"the card of a {what}", remedy, most_bytes=_MOST_CARD) as card_file:
            card: dict[str, Any] = json.loads(card_file.read())
        return network_of(load(file.read()), card), card
