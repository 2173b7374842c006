"""How much a robot gains by remembering: link states along ways through held-out buildings, alone and fused.

The network that fuses learns from what networks told of buildings that they had not seen, or it would trust them
too much; so it takes two folds at least. Of each fold it is judged by a network that learnt on the others.

Between random places a way crosses more borders of states than on a search, which ends at the transmitter; so in
test buildings both are scored.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from wireless.linkstate.classifier import LinkStateClassifier
from wireless.linkstate.data import Links
from wireless.linkstate.follower import fused_probability
from wireless.linkstate.learning.way_network import (
    WayBatch,
    WayNetwork,
    pack_ways,
    train_way_network,
    way_network_of,
)
from wireless.linkstate.scores import scores
from wireless.linkstate.tokens import reached
from wireless.linkstate.ways import make_ways, moved

#: Ways of each transmitter.
WAYS = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Ways:
    """Ways through measured buildings."""

    rows: list[Int[np.ndarray, " _"]]
    """Links along each way."""
    moved_m: list[Float[np.ndarray, " _"]]
    """Distance from the place before [m]."""
    building: Int[np.ndarray, " ways"]
    """Building of each."""


def ways_of(links: Links, *, to_transmitter: bool = False) -> Ways:
    """The same ways for everybody, between random places or to the transmitter."""
    rng = np.random.default_rng(0)
    rows: list[np.ndarray] = []
    building: list[int] = []
    for number in np.unique(links.transmitter):
        mine = np.flatnonzero(links.transmitter == number)
        position = links.position[mine].astype(float)
        goal = links.tx_position[mine[0]].astype(float) if to_transmitter else None
        found = make_ways(position, _step_m(position), WAYS, rng, goal=goal)
        rows += [mine[way] for way in found]
        building += [int(links.building[mine[0]])] * len(found)
    moves = [moved(links.position.astype(float), way) for way in rows]
    return Ways(rows=rows, moved_m=moves, building=np.array(building))


def _step_m(position: Float[np.ndarray, "n 2"]) -> float:
    """Step of the grid that most places lie on."""
    if len(position) < 2:
        return 1.0
    nearest, _ = cKDTree(position).query(position, k=2)
    return float(np.median(nearest[:, 1]))


def train_ways(
    links: Links,
    told: Float[np.ndarray, "n 4"],
    parts: Sequence[Sequence[int]],
    inputs: Sequence[str],
    states: tuple[int, ...],
    seed: int,
) -> tuple[WayNetwork, dict[str, Any]]:
    """A network for ways from all folds, and the scores of such networks fold by fold.

    Args:
        links: All links.
        told: Calibrated probabilities of each link by a network that did not see its building; rows of other
            links are not looked at.
        parts: Buildings of each fold.
        inputs: Columns of tokens to use.
        states: States possible of links with paths.
        seed: Of the networks.
    """
    ways = ways_of(links)
    rows, alone, fused = [], [], []
    for held in parts:
        others = [building for part in parts if part is not held for building in part]
        network = train_way_network(_batch(ways, links, told, others, inputs), inputs, seed=seed)
        batch, row = _batch(ways, links, told, held, inputs), _rows(ways, held)
        rows.append(row)
        alone.append(told[row])
        fused.append(_fused(network, batch, reached(links.tokens[row]), states))
    place = np.concatenate(rows)
    there = links.state[place], reached(links.tokens[place]), links.building[place], links.names
    result = {
        "places": len(place),
        "alone": scores(np.concatenate(alone), *there),
        "fused": scores(np.concatenate(fused), *there),
    }
    everywhere = [building for part in parts for building in part]
    final = train_way_network(_batch(ways, links, told, everywhere, inputs), inputs, seed=seed)
    return final, result


def score_ways(classifier: LinkStateClassifier, links: Links) -> dict[str, dict[str, Any]]:
    """Scores along ways through buildings that a classifier has not seen, by where they lead.

    Args:
        classifier: Judged at each place alone and, if it has a network for ways, with it.
        links: Links of these buildings.
    """
    told = classifier.predict_tokens(links.tokens)
    result = {}
    for name, to_transmitter in (("between places", False), ("to the transmitter", True)):
        ways = ways_of(links, to_transmitter=to_transmitter)
        row = np.concatenate(ways.rows)
        there = links.state[row], reached(links.tokens[row]), links.building[row], links.names
        result[name] = {"places": len(row), "alone": scores(told[row], *there)}
        if classifier.way is not None:
            network = way_network_of(classifier.way, classifier.inputs)
            batch = _batch(ways, links, told, range(len(links.names)), classifier.inputs)
            fused = _fused(network, batch, reached(links.tokens[row]), classifier.states)
            result[name]["fused"] = scores(fused, *there)
    return result


def _fused(
    network: WayNetwork, batch: WayBatch, there: Bool[np.ndarray, " n"], states: tuple[int, ...]
) -> Float[np.ndarray, "n 4"]:
    """Probabilities at all places of ways."""
    with torch.inference_mode():
        logits = network(batch.features)[0][batch.there].double().numpy()
    return fused_probability(logits, there, states)


def _batch(
    ways: Ways, links: Links, told: np.ndarray, buildings: Sequence[int], inputs: Sequence[str]
) -> WayBatch:
    some = np.flatnonzero(np.isin(ways.building, buildings))
    return pack_ways(
        [ways.rows[i] for i in some],
        [ways.moved_m[i] for i in some],
        told,
        links.tokens,
        links.state.astype(int),
        inputs,
    )


def _rows(ways: Ways, buildings: Sequence[int]) -> Int[np.ndarray, " n"]:
    """Links of all places in some buildings, in the order of `_batch`."""
    return np.concatenate([ways.rows[i] for i in np.flatnonzero(np.isin(ways.building, buildings))])
