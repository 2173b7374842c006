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
        self._overlap = {region: np.zeros(2, np.int64) for region in ("seen", "hidden", "hidden_floor")}
        self._bins = {region: np.zeros((3, BINS)) for region in ("seen", "hidden")}
        self._squares = {region: 0.0 for region in ("seen", "hidden")}

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
        for region, mask, what, true in (
            ("seen", seen, predicted, obstacle),
            ("hidden", hidden, predicted, obstacle),
            ("hidden_floor", hidden, probability < 0.5, ~obstacle),
        ):
            both, either = np.count_nonzero(what & true & mask), np.count_nonzero((what | true) & mask)
            self._overlap[region] += (both, either)
        for region, mask in (("seen", seen), ("hidden", ~seen)):
            p, came = probability[mask].astype(float), obstacle[mask]
            index = np.minimum((p * BINS).astype(int), BINS - 1)
            for row, weights in enumerate((None, p, came)):
                self._bins[region][row] += np.bincount(index, weights, minlength=BINS)
            self._squares[region] += float(((p - came) ** 2).sum())

    def add_counts(self, counts: dict[str, Any]) -> None:
        """Add stored sums, as of `counts`."""
        for region, overlap in counts["overlap"].items():
            self._overlap[region] += overlap
        for region, bins in counts["bins"].items():
            self._bins[region] += bins
            self._squares[region] += counts["squares"][region]

    def counts(self) -> dict[str, Any]:
        """All sums, for storage in a file."""
        return {
            "overlap": {region: counts.tolist() for region, counts in self._overlap.items()},
            "bins": {region: bins.tolist() for region, bins in self._bins.items()},
            "squares": dict(self._squares),
        }

    def result(self) -> dict[str, float]:
        """IoU of each part, and calibration error and Brier score of the seen and of the other cells."""
        out = {
            f"iou_{region}": _ratio(float(counts[0]), float(counts[1]))
            for region, counts in self._overlap.items()
        }
        for region, (count, predicted, came) in self._bins.items():
            out[f"calibration_error_{region}"] = _ratio(
                float(np.abs(predicted - came).sum()), float(count.sum())
            )
            out[f"brier_{region}"] = _ratio(self._squares[region], float(count.sum()))
        return out


def _ratio(a: float, b: float) -> float:
    return a / b if b else float("nan")
