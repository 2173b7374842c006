"""Link states of one robot on its way: a classifier with a memory of the last places.

follower = Follower(classifier)
while driving:
probability = follower.update(aoa_rad, snr_db, moved_m=0.25, aod_rad=aod_rad, peak=peak)
"""

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32

from wireless.linkstate.classifier import LinkStateClassifier
from wireless.linkstate.networks import N_STATES
from wireless.linkstate.tokens import reached
from wireless.linkstate.way_network import place_features
from wireless.paths import LinkState


class Follower:
    """Remembers the way so far; make a new one for a new way."""

    def __init__(self, classifier: LinkStateClassifier) -> None:
        """Start a way.

        Raises:
            ValueError: If the classifier has no network for ways.
        """
        if classifier.way is None:
            raise ValueError(
                "this classifier has no network for ways; train one with at least two folds, or ask it for "
                "each place alone."
            )
        self.classifier, self.network = classifier, classifier.way
        self._memory: torch.Tensor | None = None
        self._before: tuple[torch.Tensor, torch.Tensor] | None = None

    def update(
        self,
        aoa_rad: Float[np.ndarray, " paths"],
        snr_db: Float[np.ndarray, "*snr"],
        *,
        moved_m: float,
        aod_rad: Float[np.ndarray, "*aod"] | None = None,
        peak: Float[np.ndarray, "*peak"] | None = None,
        delay_s: Float[np.ndarray, "*delay"] | None = None,
    ) -> Float[np.ndarray, "4"]:
        """Probability of each `LinkState` after a measurement.

        Args:
            aoa_rad: As for `LinkStateClassifier.predict`, of one link, and so on.
            snr_db: Signal-to-noise ratios.
            moved_m: How far the robot has moved since the last measurement [m].
            aod_rad: Azimuths of departure.
            peak: Heights of peaks.
            delay_s: Delays.

        Raises:
            ValueError: If an input is missing, or the distance is negative or no number.
        """
        if not 0 <= moved_m < np.inf:
            raise ValueError(f"moved_m is {moved_m}, expected a distance of 0 m or more.")
        tokens = self.classifier.tokens(
            aoa_rad[None],
            snr_db[None],
            aod_rad=None if aod_rad is None else aod_rad[None],
            peak=None if peak is None else peak[None],
            delay_s=None if delay_s is None else delay_s[None],
        )
        return self.update_tokens(tokens[0], moved_m)

    @torch.inference_mode()
    def update_tokens(self, tokens: Float32[np.ndarray, "5 5"], moved_m: float) -> Float[np.ndarray, "4"]:
        """The same from `make_tokens`."""
        alone = torch.from_numpy(self.classifier.predict_tokens(tokens[None])).float()[None]
        here = torch.from_numpy(tokens)[None, None]
        probability, both = alone, here
        moves = torch.tensor([[0.0]])
        if self._before is not None:
            probability = torch.cat([self._before[0], alone], 1)
            both = torch.cat([self._before[1], here], 1)
            moves = torch.tensor([[0.0, moved_m]])
        features = place_features(probability, both, moves, self.classifier.inputs)
        logits, self._memory = self.network(features[:, -1:], self._memory)
        self._before = alone, here
        return fused_probability(logits[0].double().numpy(), reached(tokens[None]), self.classifier.states)[0]


def fused_probability(
    logits: Float[np.ndarray, "n 4"], there: Bool[np.ndarray, " n"], states: tuple[int, ...]
) -> Float[np.ndarray, "n 4"]:
    """Probabilities of the states that links with paths can be in; outage for sure where there are none."""
    probability = np.zeros((len(logits), N_STATES))
    allowed = list(states)
    power = np.exp(logits[:, allowed] - logits[:, allowed].max(1, keepdims=True))
    probability[:, allowed] = power / power.sum(1, keepdims=True)
    probability[~there] = np.eye(N_STATES)[LinkState.OUTAGE]
    return probability
