"""How good predicted patches are: overlap with the truth where it is seen and where it is hidden, and calibration.

Overlap is intersection over union of predicted and true cells, summed over all frames before division, so that frames
weigh by their contents. The hidden part is scored for obstacles and for floor, over the cells that matter (see
`robosim.datasets.true_patch`). Calibration is the expected calibration error: the mean gap between the
predicted probability and the observed share of obstacles, over bins of the probability.
"""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

#: Bins of probability for calibration.
BINS = 20


class PatchScores:
    """Adds up patches."""

    def __init__(self) -> None:
        self._overlap = {part: np.zeros(2, np.int64) for part in ("seen", "hidden", "hidden_floor")}
        self._bins = {part: np.zeros((3, BINS)) for part in ("seen", "hidden")}
        self._squares = {part: 0.0 for part in ("seen", "hidden")}

    def add(
        self,
        probability: Float[np.ndarray, "*batch ny nx"],
        obstacle: Bool[np.ndarray, "*batch ny nx"],
        seen: Bool[np.ndarray, "*batch ny nx"],
        matters: Bool[np.ndarray, "*batch ny nx"],
    ) -> None:
        """Add patches."""
        predicted = probability > 0.5
        hidden = matters & ~seen
        for part, mask, what, true in (
            ("seen", seen, predicted, obstacle),
            ("hidden", hidden, predicted, obstacle),
            ("hidden_floor", hidden, probability < 0.5, ~obstacle),
        ):
            both, either = np.count_nonzero(what & true & mask), np.count_nonzero((what | true) & mask)
            self._overlap[part] += (both, either)
        for part, mask in (("seen", seen), ("hidden", ~seen)):
            p, came = probability[mask].astype(float), obstacle[mask]
            index = np.minimum((p * BINS).astype(int), BINS - 1)
            for row, weights in enumerate((None, p, came)):
                self._bins[part][row] += np.bincount(index, weights, minlength=BINS)
            self._squares[part] += float(((p - came) ** 2).sum())

    def add_counts(self, counts: dict[str, Any]) -> None:
        """Add stored sums, as of `counts`."""
        for part, overlap in counts["overlap"].items():
            self._overlap[part] += overlap
        for part, bins in counts["bins"].items():
            self._bins[part] += bins
            self._squares[part] += counts["squares"][part]

    def counts(self) -> dict[str, Any]:
        """All sums, for storage in a file."""
        return {
            "overlap": {part: counts.tolist() for part, counts in self._overlap.items()},
            "bins": {part: bins.tolist() for part, bins in self._bins.items()},
            "squares": dict(self._squares),
        }

    def result(self) -> dict[str, float]:
        """IoU of each part, and calibration error and Brier score of the seen and of the other cells."""
        out = {
            f"iou_{part}": _ratio(float(counts[0]), float(counts[1]))
            for part, counts in self._overlap.items()
        }
        for part, (count, predicted, came) in self._bins.items():
            out[f"calibration_error_{part}"] = _ratio(
                float(np.abs(predicted - came).sum()), float(count.sum())
            )
            out[f"brier_{part}"] = _ratio(self._squares[part], float(count.sum()))
        return out


def _ratio(a: float, b: float) -> float:
    return a / b if b else float("nan")
