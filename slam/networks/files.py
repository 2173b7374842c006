"""The network of the learned mapper in a file, with its card."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from robosim.support.weights import load_network, network_files
from slam.networks.map_network import MapNetwork, NetworkConfig


def files_of(network: MapNetwork, card: dict[str, Any], name: str) -> dict[str, bytes]:
    """The contents of NAME.safetensors and of its card, NAME.json."""
    return network_files(name, network.weights, asdict(network.config), card)


def load_mapper(path: str | Path) -> tuple[MapNetwork, dict[str, Any]]:
    """A network from its weights, ready for use, and its card from the same folder.

    Raises:
        FileError: If a file is missing or damaged, or they do not fit each other.
    """
    return load_network(
        path,
        "weights of a mapper",
        "a mapper",
        "Train it again with `robosim train mapper`.",
        lambda weights, card: MapNetwork(
            weights, NetworkConfig(widths=tuple(card["widths"]), inputs=card["inputs"])
        ),
    )
