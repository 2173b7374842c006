"""Link-state classification in buildings that were not used for training.

Shipped classifiers are scored on data sets of `robosim dataset`. Runs of `robosim train link-state` are scored on the
buildings of their folds, each classified by a network that was trained without it; these are means over buildings.
Intervals are of 95 %, by bootstrap over buildings.
"""

from pathlib import Path

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from robosim.support.installation import shipped_weights
from robosim.support.text_in import read_json
from tests.benchmarks.harness import DEFAULT, Options, ratio_interval
from tests.benchmarks.results import Results
from wireless.linkstate.classifier import load_classifier
from wireless.linkstate.data import is_data_set, read_links

#: Shipped classifiers by the inputs that they do without.
SHIPPED = {
    "all inputs": "generated",
    "without angles of departure": "generated-no-aod",
    "without delays too": "generated-no-sync",
}


def main(folders: Positional[tuple[Path, ...]], *, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Link states: share that classifiers get right in buildings that were not used for training.

    Args:
        folders: Data sets of homes that were not used for training, and outputs of `robosim train link-state`.
        options: Of every benchmark.
    """
    results = Results()
    for folder in folders:
        if is_data_set(folder):
            links = read_links(folder)
            of = np.bincount(links.building)
            for row, name in SHIPPED.items():
                probability = load_classifier(shipped_weights()[name]).predict_tokens(links.tokens)
                right = np.bincount(links.building, probability.argmax(axis=1) == links.state)
                _add(results, "shipped", row, folder.name, right, of)
        else:
            card = read_json(folder / "result.json", "result of a training", keys=("validation",))
            folds = [fold for name, fold in card["validation"].items() if name.startswith("fold")]
            right = np.array([value for fold in folds for value in fold["accuracy_by_building"].values()])
            _add(results, "trained", folder.name, "right", right, np.ones(len(right)))
    return options.finish("link_states", results)


def _add(results: Results, table: str, row: str, name: str, right: np.ndarray, of: np.ndarray) -> None:
    share, spread = ratio_interval(100 * right, of)
    results.add(table, row, name, share, "%", digits=1, spread=spread, cases=len(of))
