"""What a learned search uses: searches without one kind of inputs, and where it turns in outage and along arrivals.

The network drives in generated buildings outside of its training. A kind of inputs is left out by setting it to zero
in all steps (occlusion); differences are of the same searches. Turns are the probability of left less that of right,
over the bearing of the farthest point in view where nothing is received, and over the azimuth of the strongest path by
link state in other places. Intervals are of 95 %, by bootstrap over searches.
Turns in the table: the mean turn towards that side, for bearings of more than 20 degrees.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tyro.conf import OmitArgPrefixes

from robosim.evaluation.search_scores import bootstrap
from robosim.policies.search_network import (
    COLUMNS,
    SENSES,
    STATES,
    Output,
    SearchNetwork,
    action_probabilities,
    load_search,
)
from robosim.support.installation import shipped_network
from robosim.training.search_walks import Scores, Walks, drive
from slam.actions import Action
from tests.benchmarks.harness import DEFAULT, Options, figure_of, run_units
from tests.benchmarks.results import Results
from tests.benchmarks.search import words_of
from wireless.paths import LinkState

#: Number of the first building; those of training and of its comparisons have smaller ones.
_FIRST = 30_000_000
#: Kinds of buildings by the share of offices.
BUILDINGS = {"homes": 0.0, "offices": 1.0}
_STATE = SENSES["radio paths"].stop - STATES
#: Bearings of bins [deg].
_BEARINGS = np.linspace(-180, 180, 19)


class Search(NamedTuple):
    """Searches of all robots of one kind of building."""

    scores: Scores
    turns: np.ndarray
    """Of each step: link state, bearing of the farthest point in view or azimuth of the strongest path [deg], turn."""


def main(
    *,
    weights: Path | None = None,
    searches: int = 48,
    max_steps: int = 1000,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """What a learned search uses: searches without some of its inputs, and where it turns.

    Goes on after a kill if it is given the same folder.

    Args:
        weights: The network; by default the shipped one.
        searches: Searches in homes, and as many in offices, each in its own building.
        max_steps: Steps after which a search is given up.
        options: Of every benchmark.
    """
    path = weights or shipped_network("search")
    units = {
        f"{kind} {left_out}": (str(path), kind, left_out, searches, max_steps, str(options.folder("senses")))
        for kind in BUILDINGS
        for left_out in ("nothing", *SENSES)
    }
    found = run_units(search, units, options.folder("senses"), workers=options.workers)
    results = Results()
    for kind in BUILDINGS:
        for left_out in ("nothing", *SENSES):
            one = found[f"{kind} {left_out}"]
            row = f"without {left_out}" if left_out != "nothing" else "all inputs"
            results.add(
                "arrivals", row, kind, 100 * float(one.scores.arrived.mean()), "%", digits=0, cases=searches
            )
            value, low, high = bootstrap(one.scores.spl[:, None], None)
            results.add("SPL", row, kind, value, digits=2, spread=(low, high), cases=searches)
    whole = {kind: found[f"{kind} nothing"] for kind in BUILDINGS}
    for kind, one in whole.items():
        for state, (bearing, turn) in _by_state(one).items():
            side = np.abs(bearing) > 20
            value = float(np.mean(np.sign(bearing[side]) * turn[side])) if side.any() else None
            results.add("turns", state, kind, value, digits=2, cases=int(side.sum()))
    results.figures["senses"] = draw(found, whole)
    return options.finish("senses", results)


class Occluded(SearchNetwork):
    """A network that receives zeros for some inputs, and notes where it turns."""

    def __init__(self, network: SearchNetwork, left_out: slice) -> None:
        super().__init__(network.weights)
        self._left_out = left_out
        self.turns: list[np.ndarray] = []

    def __call__(self, inputs: np.ndarray, memory: np.ndarray) -> Output:
        """One step without these inputs."""
        occluded = inputs.copy()
        occluded[..., self._left_out] = 0
        output = super().__call__(occluded, memory)
        self.turns.append(_turns(inputs, output.scores))
        return output


def search(path: str, kind: str, left_out: str, searches: int, max_steps: int, folder: str) -> Search:
    """One search of each robot, with a kind of inputs left out."""
    walks = Walks(
        robots=searches, homes=searches, first=_FIRST, offices=BUILDINGS[kind], targets=1, difficulty=1.0,
        steps=max_steps, seed=_FIRST, tables=Path(folder) / "tables",
    )  # fmt: skip
    network = Occluded(load_search(Path(path)), SENSES.get(left_out, slice(0)))
    scores = drive(network, walks)
    turns = np.stack(network.turns)
    return Search(scores, turns[np.arange(len(turns))[:, None] < scores.steps])


def _turns(inputs: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """State, bearing [deg] and turn of each robot's step."""
    odds = action_probabilities(scores)
    state = inputs[:, _STATE : _STATE + STATES].argmax(axis=1)
    distance = inputs[:, COLUMNS : 2 * COLUMNS]
    # Several columns may be at the largest distance.
    farthest = distance >= distance.max(axis=1, keepdims=True) - 1e-3
    far = (farthest * np.arange(COLUMNS)).sum(axis=1) / farthest.sum(axis=1)
    # Columns go from left to right, over the camera's field of view.
    in_view = np.degrees(np.arctan((0.5 * COLUMNS - 0.5 - far) / (0.5 * COLUMNS)))
    azimuth = np.degrees(np.arctan2(inputs[:, 2 * COLUMNS + 2], inputs[:, 2 * COLUMNS + 1]))
    bearing = np.where(state == LinkState.OUTAGE, in_view, azimuth)
    return np.column_stack([state, bearing, odds[:, Action.LEFT] - odds[:, Action.RIGHT]])


def _by_state(one: Search) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Bearings and turns by link state."""
    return {
        words_of(state): (one.turns[own, 1], one.turns[own, 2])
        for state in LinkState
        for own in [one.turns[:, 0] == state]
    }


def draw(found: dict[str, Search], whole: dict[str, Search]) -> Any:
    """SPL without each kind of inputs, and turns over bearings in homes and in offices."""
    figure, axes = figure_of(3)
    names = ["nothing", *SENSES]
    for shift, kind in zip((-0.2, 0.2), BUILDINGS, strict=True):
        values = [found[f"{kind} {name}"].scores.spl.mean() for name in names]
        axes[0].barh(np.arange(len(names)) + shift, values, height=0.36, label=kind)
    axes[0].set_yticks(np.arange(len(names)), ["all inputs", *(f"without {name}" for name in SENSES)])
    axes[0].invert_yaxis()
    axes[0].set(xlabel="success weighted by path length", xlim=(0, 1))
    axes[0].legend(fontsize=8)
    middle = (_BEARINGS[1:] + _BEARINGS[:-1]) / 2
    for one, (kind, searched) in zip(axes[1:], whole.items(), strict=True):
        for state, (bearing, turn) in _by_state(searched).items():
            place = np.digitize(bearing, _BEARINGS) - 1
            seen = [i for i in range(len(middle)) if np.count_nonzero(place == i) >= 30]
            means = [turn[place == i].mean() for i in seen]
            one.plot(middle[seen], means, marker="o", ms=3, label=state)
        one.axhline(0, color="0.7", lw=1)
        one.set(title=kind, xlabel="bearing, left is positive [deg]", ylabel="P(left) - P(right)")
    axes[1].legend(fontsize=8)
    return figure
