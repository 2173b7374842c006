"""Scores of link-state classification: accuracy, confusion, calibration, per building."""

import math
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from wireless.linkstate.calibration import cross_entropy, fit_temperature, reliability, scaled


def confusion(
    probability: Float[np.ndarray, "n 4"], state: Shaped[np.ndarray, " n"]
) -> Int[np.ndarray, "4 4"]:
    """Number of links by true state (rows) and predicted state (columns)."""
    return np.bincount(4 * state.astype(int) + probability.argmax(1), minlength=16).reshape(4, 4)


def scores(
    probability: Float[np.ndarray, "n 4"],
    state: Shaped[np.ndarray, " n"],
    reached: Bool[np.ndarray, " n"],
    building: Int[np.ndarray, " n"],
    names: tuple[str, ...],
) -> dict[str, Any]:
    """Scores of calibrated probabilities over all links, those with paths (`*_with_paths`), and by building."""
    right = probability.argmax(1) == state
    return {
        "links": len(state),
        "accuracy": float(right.mean()),
        "accuracy_with_paths": float(right[reached].mean()) if reached.any() else math.nan,
        "cross_entropy_with_paths": cross_entropy(probability[reached], state[reached].astype(int)),
        "calibration_error": reliability(probability, state.astype(int)).expected_calibration_error,
        "calibration_error_with_paths": reliability(
            probability[reached], state[reached].astype(int)
        ).expected_calibration_error,
        "confusion": confusion(probability, state).tolist(),
        "accuracy_by_building": {names[i]: float(right[building == i].mean()) for i in np.unique(building)},
    }


def calibrated_across(
    probability: Float[np.ndarray, "n 4"],
    state: Shaped[np.ndarray, " n"],
    reached: Bool[np.ndarray, " n"],
    building: Int[np.ndarray, " n"],
) -> Float[np.ndarray, "n 4"]:
    """Probabilities of each half of the buildings at the temperature that fits the other half.

    So that a temperature is never judged by the buildings that it was fitted to. One building alone stays as it is.
    """
    result = probability.copy()
    present = np.unique(building)
    first = np.isin(building, present[::2])
    for judged, fitted in ((first, ~first & reached), (~first, first & reached)):
        temperature = fit_temperature(probability[fitted], state[fitted].astype(int))
        result[judged] = scaled(probability[judged], temperature)
    return result
