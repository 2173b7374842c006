"""Whether probabilities mean what they say: temperature scaling, expected calibration error, reliability.

A network's confidence is its largest probability. Of links classified with confidence c, a calibrated network has a
share c right. The expected calibration error is the mean gap over bins of confidence, weighted by how many links
fall into each; a perfect network still shows about sqrt(2 c (1 - c) / (pi n)) in a bin of n. A temperature T,
p -> p^(1/T) normalised, is fitted by likelihood on links that were not trained on; it changes no decision.

Reference: Guo et al., "On calibration of modern neural networks", ICML 2017.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Integer
from scipy.optimize import minimize_scalar

#: Probabilities below this count as this in likelihoods.
_LEAST = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class Reliability:
    """Links by confidence."""

    confidence: Float[np.ndarray, " bins"]
    """Mean confidence of the links in each bin; NaN in empty ones."""
    accuracy: Float[np.ndarray, " bins"]
    """Share of them classified correctly; NaN in empty ones."""
    count: Int[np.ndarray, " bins"]
    """How many they are."""

    @property
    def expected_calibration_error(self) -> float:
        """Mean gap between confidence and accuracy over all links."""
        gap = np.abs(np.nan_to_num(self.confidence - self.accuracy))
        return float((gap * self.count).sum() / max(self.count.sum(), 1))


def reliability(
    probability: Float[np.ndarray, "n k"], state: Integer[np.ndarray, " n"], *, bins: int = 15
) -> Reliability:
    """Confidence against accuracy in bins of equal width from 0 to 1."""
    confidence = probability.max(1)
    right = probability.argmax(1) == state
    place = np.minimum((confidence * bins).astype(int), bins - 1)
    count = np.bincount(place, minlength=bins)
    with np.errstate(invalid="ignore"):
        return Reliability(
            confidence=np.bincount(place, confidence, bins) / count,
            accuracy=np.bincount(place, right, bins) / count,
            count=count,
        )


def fit_temperature(probability: Float[np.ndarray, "n k"], state: Integer[np.ndarray, " n"]) -> float:
    """The temperature between 1/10 and 10 of the greatest likelihood; 1 if there are no links."""
    if not len(state):
        return 1.0
    optimum = minimize_scalar(
        lambda log_t: cross_entropy(scaled(probability, math.exp(log_t)), state),
        bounds=(-math.log(10), math.log(10)),
        method="bounded",
    )
    return float(math.exp(optimum.x))


def scaled(probability: Float[np.ndarray, "n k"], temperature: float) -> Float[np.ndarray, "n k"]:
    """Probabilities at a temperature: above 1 less sure, below 1 surer. Zeros stay zero."""
    power = (probability / probability.max(1, keepdims=True)) ** (1 / temperature)
    return power / power.sum(1, keepdims=True)


def cross_entropy(probability: Float[np.ndarray, "n k"], state: Integer[np.ndarray, " n"]) -> float:
    """Mean negative log likelihood of the true states [nat]; NaN if there are no links."""
    if not len(state):
        return math.nan
    return float(-np.log(np.maximum(probability[np.arange(len(state)), state], _LEAST)).mean())
