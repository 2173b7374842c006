"""Trained networks in files: weights as safetensors, and a card that says what they are and what they reached."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import nn

from slam.mapper.network import MapNetwork, NetworkConfig
from slam.mapper.pose_network import PoseNetwork, PoseNetworkConfig

Network = TypeVar("Network", bound=nn.Module)


def mapper_files(network: MapNetwork, card: dict[str, Any], name: str) -> dict[str, bytes]:
    """The contents of NAME.safetensors and of the card beside it, NAME.json."""
    return _files(
        network, {"widths": list(network.config.widths), "inputs": network.config.inputs}, card, name
    )


def pose_files(network: PoseNetwork, card: dict[str, Any], name: str) -> dict[str, bytes]:
    """The contents of NAME.safetensors and of the card beside it, NAME.json."""
    return _files(
        network, {"widths": list(network.config.widths), "hidden": network.config.hidden}, card, name
    )


def _files(network: nn.Module, head: dict[str, Any], card: dict[str, Any], name: str) -> dict[str, bytes]:
    text = json.dumps({**head, **{key: value for key, value in card.items() if key not in head}}, indent=2)
    weights = {key: value.detach().contiguous() for key, value in network.state_dict().items()}
    return {f"{name}.safetensors": save(weights), f"{name}.json": f"{text}\n".encode()}


def load_mapper(path: Path) -> tuple[MapNetwork, dict[str, Any]]:
    """A network from its weights, ready for use, and its card, which lies beside them.

    Raises:
        ValueError: If a file is missing or damaged, or they do not fit each other.
    """
    return _load(
        path,
        "mapper",
        lambda card: MapNetwork(NetworkConfig(widths=tuple(card["widths"]), inputs=card["inputs"])),
    )


def load_pose(path: Path) -> tuple[PoseNetwork, dict[str, Any]]:
    """A network of the pose from its weights; see `load_mapper`.

    Raises:
        ValueError: If a file is missing or damaged, or they do not fit each other.
    """
    return _load(
        path,
        "pose",
        lambda card: PoseNetwork(PoseNetworkConfig(widths=tuple(card["widths"]), hidden=card["hidden"])),
    )


def _load(
    path: Path, what: str, network_of: Callable[[dict[str, Any]], Network]
) -> tuple[Network, dict[str, Any]]:
    try:
        card = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        network = network_of(card)
        network.load_state_dict(load_file(path))
    except (OSError, KeyError, TypeError, RuntimeError, SafetensorError, json.JSONDecodeError) as error:
        raise ValueError(
            f"{path} and its card {path.with_suffix('.json').name} are no weights of a {what} ({error}). "
            f"Train them anew with `robosim train {what}`."
        ) from error
    return network.eval(), card
