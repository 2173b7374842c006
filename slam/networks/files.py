"""Networks of the learned mapper and the learned pose in files, each with its card."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from robosim.support.weights import load_network, network_files
from slam.networks.map_network import MapNetwork, NetworkConfig
from slam.networks.pose_network import PoseNetwork, PoseNetworkConfig


def files_of(network: MapNetwork | PoseNetwork, card: dict[str, Any], name: str) -> dict[str, bytes]:
    """The contents of NAME.safetensors and of its card, NAME.json."""
    return network_files(name, network.weights, asdict(network.config), card)


def load_mapper(path: Path) -> tuple[MapNetwork, dict[str, Any]]:
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


def load_pose(path: Path) -> tuple[PoseNetwork, dict[str, Any]]:
    """A network of the pose from its weights, and its card; errors as of `load_mapper`."""
    return load_network(
        path,
        "weights of a pose",
        "a pose",
        "Train it again with `robosim train pose`.",
        lambda weights, card: PoseNetwork(
            weights, PoseNetworkConfig(widths=tuple(card["widths"]), hidden=card["hidden"])
        ),
    )
