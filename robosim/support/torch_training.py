"""Training in PyTorch: its threads, weights, and stored states from which it can continue.

A convolution that is split over threads sums in another order, and the last bits of its result differ. Over a thousand
decisions this changes the trajectory. The networks here are too small to gain from a second thread.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol, runtime_checkable

import numpy as np

try:
    import torch
except ImportError as error:
    raise ImportError(
        "Training needs PyTorch, which is not installed: pip install 'robosim-wireless[train]', or in a checkout "
        "pip install -e '.[train]'",
        name="torch",
    ) from error

#: Larger weights overflow in the next step or the one after.
_LARGEST = 1e6
#: No training has so many steps, nor so large gradients.
_MOST_STEPS = 1e9


@runtime_checkable
class Store(Protocol):
    """Storage of the state of a training."""

    def restore(self, put: Callable[[dict[str, Any]], None]) -> None:
        """Put the state back that was saved last, if there is one."""

    def save(self, state: dict[str, Any]) -> None:
        """Store a state."""


@contextmanager
def torch_threads(count: int = 1) -> Iterator[None]:
    """Compute with so many threads inside the block, and as before after it; half a microsecond."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def weights_of(network: torch.nn.Module) -> dict[str, np.ndarray]:
    """Weights of a network as arrays, copied, by their names."""
    return {name: value.detach().contiguous().numpy().copy() for name, value in network.state_dict().items()}


def restore_network(network: torch.nn.Module, state: Mapping[str, Any]) -> None:
    """Load a stored state into a network.

    Raises:
        ValueError: If a weight is NaN, infinite or too large for any training.
        RuntimeError: If names or shapes differ.
    """
    check_weights(state)
    network.load_state_dict(dict(state))


def check_weights(state: Mapping[str, Any]) -> None:
    """Check that tensors hold plausible weights; ValueError if one does not."""
    for name, value in state.items():
        if not (isinstance(value, torch.Tensor) and bool((value.abs() <= _LARGEST).all())):
            raise ValueError(f"{name} has values that are no weights")


def restore_optimiser(optimiser: torch.optim.Optimizer, state: Mapping[str, Any]) -> None:
    """Load a stored state into an optimiser of Adam's kind.

    Raises:
        ValueError: If the state is of other options or of weights of other shapes, which would show at a step only.
    """
    options = [_options(group) for group in optimiser.param_groups]
    optimiser.load_state_dict(dict(state))
    if [_options(group) for group in optimiser.param_groups] != options:
        raise ValueError("its optimiser has other options")
    for weight in (weight for group in optimiser.param_groups for weight in group["params"]):
        shapes = {"step": torch.Size([]), "exp_avg": weight.shape, "exp_avg_sq": weight.shape}
        weight_state = optimiser.state.get(weight, {})
        if (
            weight_state
            and {name: getattr(value, "shape", None) for name, value in weight_state.items()} != shapes
        ):
            raise ValueError("the state of its optimiser fits no weights")
        if not all(bool((value.abs() < _MOST_STEPS).all()) for value in weight_state.values()):
            raise ValueError("the state of its optimiser has values that no training comes to")
        if weight_state and not (weight_state["step"] >= 0 and bool((weight_state["exp_avg_sq"] >= 0).all())):
            raise ValueError("the state of its optimiser has negative values")


def _options(group: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that do not change in the course of a training."""
    return {name: value for name, value in group.items() if name not in ("params", "lr", "initial_lr")}
