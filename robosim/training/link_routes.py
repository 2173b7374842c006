"""Link states along routes through held-out buildings: of single places, and fused over the route.

The fusing network is trained on probabilities for buildings outside the training of the networks that gave them,
since it would trust them too much otherwise; so it needs two folds at least. Its scores of a fold come from a network
trained on the others. Routes between random places cross more borders of link states than those of a search, which
end at the transmitter; the two kinds are scored in test buildings.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from wireless.linkstate.classifier import LinkStateClassifier
from wireless.linkstate.data import Links
from wireless.linkstate.follower import fused_probability
from wireless.linkstate.learning.networks import weights_of
from wireless.linkstate.learning.route_network import (
    RouteBatch,
    RouteNetwork,
    pack_routes,
    route_network_of,
    train_route_network,
)
from wireless.linkstate.routes import make_routes, step_lengths
from wireless.linkstate.scores import scores
from wireless.linkstate.tokens import reached

#: Number of routes of each transmitter.
ROUTES = 16


class Routes(NamedTuple):
    """Routes through measured buildings."""

    rows: list[Int[np.ndarray, " _"]]
    """Links along each route."""
    steps_m: list[Float[np.ndarray, " _"]]
    """Distances from the previous places."""
    building: Int[np.ndarray, " routes"]

    def within(self, buildings: Sequence[int]) -> "Routes":
        """Return the routes through buildings."""
        selected = np.flatnonzero(np.isin(self.building, buildings))
        return Routes(
            [self.rows[i] for i in selected], [self.steps_m[i] for i in selected], self.building[selected]
        )


def routes_of(links: Links, *, to_transmitter: bool = False) -> Routes:
    """Reproducible routes between random places, or to the transmitter."""
    rng = np.random.default_rng(0)
    rows: list[np.ndarray] = []
    building: list[int] = []
    for number in np.unique(links.transmitter):
        members = np.flatnonzero(links.transmitter == number)
        position = links.position[members].astype(float)
        goal = links.tx_position[members[0]].astype(float) if to_transmitter else None
        routes = make_routes(position, _grid_step_m(position), ROUTES, rng, goal=goal)
        rows += [members[route] for route in routes]
        building += [int(links.building[members[0]])] * len(routes)
    steps_m = [step_lengths(links.position.astype(float), row) for row in rows]
    return Routes(rows, steps_m, np.array(building))


def _grid_step_m(position: Float[np.ndarray, "n 2"]) -> float:
    """Median distance of neighbours."""
    if len(position) < 2:
        return 1.0
    nearest, _ = cKDTree(position).query(position, k=2)
    return float(np.median(nearest[:, 1]))


def add_route_network(
    classifier: LinkStateClassifier,
    links: Links,
    probability: Float[np.ndarray, "n 4"],
    parts: Sequence[Sequence[int]],
    seed: int,
) -> dict[str, Any]:
    """Train a fusing network on all folds, and add it to a classifier if it is better fold by fold; returns scores.

    `probability` holds calibrated probabilities of each link by a network trained without its building; the rows of
    links outside the folds (`parts`) are not used.
    """
    routes, inputs = routes_of(links), classifier.inputs

    def train(buildings: Sequence[int]) -> RouteNetwork:
        return train_route_network(
            _batch(routes.within(buildings), links, probability, inputs), inputs, seed=seed
        )

    rows, fused = [], []
    for fold in parts:
        network = train([building for other in parts if other is not fold for building in other])
        held_out = routes.within(fold)
        row = np.concatenate(held_out.rows)
        batch = _batch(held_out, links, probability, inputs)
        rows.append(row)
        fused.append(_fuse(network, batch, reached(links.tokens[row]), classifier.states))
    row = np.concatenate(rows)
    result: dict[str, Any] = {
        "places": len(row),
        "alone": _scores(probability[row], links, row),
        "fused": _scores(np.concatenate(fused), links, row),
    }
    if result["fused"]["accuracy"] > result["alone"]["accuracy"]:
        classifier.route = dict(weights_of(train([building for fold in parts for building in fold])))
    return result


def score_routes(classifier: LinkStateClassifier, links: Links) -> dict[str, dict[str, Any]]:
    """Scores along routes through test buildings, of single places and, with a fusing network, of routes."""
    probability = classifier.predict_tokens(links.tokens)
    result = {}
    for name, to_transmitter in (("between places", False), ("to the transmitter", True)):
        routes = routes_of(links, to_transmitter=to_transmitter)
        row = np.concatenate(routes.rows)
        result[name] = {"places": len(row), "alone": _scores(probability[row], links, row)}
        if classifier.route is not None:
            network = route_network_of(classifier.route, classifier.inputs)
            batch = _batch(routes, links, probability, classifier.inputs)
            fused = _fuse(network, batch, reached(links.tokens[row]), classifier.states)
            result[name]["fused"] = _scores(fused, links, row)
    return result


def _scores(
    probability: Float[np.ndarray, "n 4"], links: Links, row: Int[np.ndarray, " n"]
) -> dict[str, Any]:
    return scores(probability, links.state[row], reached(links.tokens[row]), links.building[row], links.names)


def _fuse(
    network: RouteNetwork, batch: RouteBatch, has_paths: Bool[np.ndarray, " n"], states: tuple[int, ...]
) -> Float[np.ndarray, "n 4"]:
    """Probabilities at all places of routes."""
    with torch.inference_mode():
        logits = network(batch.features)[0][batch.there].double().numpy()
    return fused_probability(logits, has_paths, states)


def _batch(routes: Routes, links: Links, probability: np.ndarray, inputs: Sequence[str]) -> RouteBatch:
    state = links.state.astype(int)
    return pack_routes(routes.rows, routes.steps_m, probability, links.tokens, state, inputs)
