"""Link states of one robot along its route: a classifier with a memory of the last places.

follower = Follower(classifier)
while driving:
probability = follower.update(aoa_rad, snr_db, moved_m=0.25, aod_rad=aod_rad, peak=peak)
"""

import numpy as np
from jaxtyping import Bool, Float, Float32

from wireless.linkstate.classifier import LinkStateClassifier
from wireless.linkstate.features import place_features
from wireless.linkstate.forward import N_STATES, route_step
from wireless.linkstate.tokens import reached
from wireless.paths import LinkState


class Follower:
    """Remembers the route so far; make a new one for a new route."""

    def __init__(self, classifier: LinkStateClassifier) -> None:
        """Start a route.

        Raises:
            ValueError: If the classifier has no network for routes.
        """
        if classifier.route is None:
            raise ValueError(
                "this classifier has no network for routes; train one with at least two folds, or classify "
                "each place alone."
            )
        self.classifier, self._weights = classifier, classifier.route
        self._memory: np.ndarray | None = None
        self._before: tuple[np.ndarray, np.ndarray] | None = None

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

    def update_tokens(self, tokens: Float32[np.ndarray, "5 5"], moved_m: float) -> Float[np.ndarray, "4"]:
        """Update by the array of `make_tokens`."""
        alone = self.classifier.predict_tokens(tokens[None]).astype(np.float32)
        probability, both, moves = alone, tokens[None], np.zeros(1, np.float32)
        if self._before is not None:
            probability = np.concatenate([self._before[0], alone])
            both = np.concatenate([self._before[1], tokens[None]])
            moves = np.array([0, moved_m], np.float32)
        features = place_features(probability[None], both[None], moves[None], self.classifier.inputs)[0, -1]
        logits, self._memory = route_step(self._weights, features, self._memory)
        self._before = alone, tokens[None]
        return fused_probability(logits[None].astype(float), reached(tokens[None]), self.classifier.states)[0]


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
