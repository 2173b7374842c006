"""Record of an epoch of training."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Epoch:
    """How an epoch went."""

    epoch: int
    """From 1."""
    loss: float
    """Mean loss of the steps, with dropout and smoothed labels [nat]."""
    accuracy: float | None
    """Share of the watched links classified correctly by the averaged weights, if any are watched."""
    watched_loss: float | None
    """Their cross entropy [nat]."""
