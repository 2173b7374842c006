"""Link states along routes: the routes, the network that fuses, and the same answers place by place."""

import math

import numpy as np
import pytest
import torch

from wireless.linkstate.classifier import LinkStateClassifier, load_classifier
from wireless.linkstate.follower import Follower, fused_probability
from wireless.linkstate.learning.networks import NETWORKS, weights_of
from wireless.linkstate.learning.route_network import pack_routes, route_network_of, train_route_network
from wireless.linkstate.routes import make_routes, step_lengths
from wireless.linkstate.tokens import make_tokens

INPUTS = ("aoa", "snr")


def test_routes_are_shortest():
    """On an open square grid a route of (dx, dy) steps is as long as the octile distance, to rounding."""
    x, y = np.meshgrid(np.arange(12), np.arange(9))
    position = 0.15 * np.column_stack([x.ravel(), y.ravel()])
    routes = make_routes(position, 0.15, 40, np.random.default_rng(0))
    for route in routes:
        d = np.sort(np.abs(position[route[-1]] - position[route[0]]) / 0.15)
        assert step_lengths(position, route).sum() == pytest.approx(0.15 * (d[1] + (math.sqrt(2) - 1) * d[0]))
        assert step_lengths(position, route).max() <= 0.15 * math.sqrt(2) + 1e-9
    assert len({route[0] for route in routes}) > 20


def test_routes_stay_in_their_room():
    position = np.array([[0.0, 0], [0.15, 0], [5, 5], [5.15, 5]])
    for route in make_routes(position, 0.15, 20, np.random.default_rng(1)):
        assert set(route) <= {0, 1} or set(route) <= {2, 3}


def test_routes_to_a_goal_end_there():
    """All of them, at the place nearest to it, by the octile distance from where they begin, to rounding."""
    x, y = np.meshgrid(np.arange(12), np.arange(9))
    position = 0.15 * np.column_stack([x.ravel(), y.ravel()])
    routes = make_routes(position, 0.15, 30, np.random.default_rng(2), goal=np.array([0.66, 0.31]))
    for route in routes:
        assert position[route[-1]] == pytest.approx([0.6, 0.3])
        d = np.sort(np.abs(position[route[0]] - position[route[-1]]) / 0.15)
        assert step_lengths(position, route).sum() == pytest.approx(0.15 * (d[1] + (math.sqrt(2) - 1) * d[0]))
    assert len({route[0] for route in routes}) > 20


@pytest.fixture(scope="module")
def chain():
    """Routes whose state stays 12 places on average, classified correctly at each place with a chance of 0.7."""
    rng = np.random.default_rng(0)
    n = 60_000
    state = np.empty(n, int)
    state[0] = 1
    for i in range(1, n):
        state[i] = rng.integers(1, 4) if rng.random() < 1 / 8 else state[i - 1]
    classified = np.where(rng.random(n) < 0.7, state, 1 + (state + rng.integers(0, 2, n)) % 3)
    probability = np.full((n, 4), [0.0, 0.15, 0.15, 0.15])
    probability[np.arange(n), classified] = 0.7
    tokens = make_tokens(np.zeros((n, 5)), np.full((n, 5), 10.0))
    rows = [np.arange(i, i + 50) for i in range(0, n, 50)]
    return probability, tokens, state, rows


def exact_filter(probability, change):
    """Beliefs of the forward algorithm for a chain that jumps to any of three states at random."""
    belief, beliefs = np.full(3, 1 / 3), []
    for likelihood in probability[:, 1:]:
        belief = ((1 - change) * belief + change / 3) * likelihood
        belief = belief / belief.sum()
        beliefs.append(belief)
    return np.array(beliefs)


def test_the_network_learns_the_exact_filter(chain):
    """On a Markov chain nothing beats the forward algorithm; the network comes within 1.5 % of its accuracy."""
    probability, tokens, state, rows = chain
    moves = [np.full(50, 0.15)] * len(rows)
    cut = len(rows) * 3 // 4

    def pack(some):
        return pack_routes(rows[some], moves[some], probability, tokens, state, INPUTS)

    network = train_route_network(pack(slice(cut)), INPUTS, seed=0, epochs=8)
    held = pack(slice(cut, None))
    with torch.inference_mode():
        classified = network(held.features)[0][held.there].argmax(-1).numpy()
    true = held.state[held.there].numpy()
    place = np.concatenate(rows[cut:])
    exact = np.concatenate([exact_filter(probability[row], 1 / 8).argmax(1) + 1 for row in rows[cut:]])
    best, alone = (exact == state[place]).mean(), (probability[place].argmax(1) == true).mean()
    assert best > alone + 0.08
    assert best - 0.015 < (classified == true).mean() < best + 0.01


@pytest.fixture
def classifier(chain):
    probability, tokens, state, rows = chain
    batch = pack_routes(rows[:100], [np.full(50, 0.15)] * 100, probability, tokens, state, INPUTS)
    torch.manual_seed(0)
    network = weights_of(NETWORKS["reference"](INPUTS))
    route = train_route_network(batch, INPUTS, seed=0, epochs=2)
    return LinkStateClassifier(
        [network], model="reference", inputs=INPUTS, temperature=1.3, route=weights_of(route)
    )


def test_place_by_place_as_all_at_once(classifier, tmp_path):
    """What a robot gets on its route is what the packed route gives, also from a file; an outage is one for sure."""
    rng = np.random.default_rng(3)
    aoa, snr = rng.uniform(-3, 3, (20, 5)), rng.uniform(0, 50, (20, 5))
    snr[7] = -np.inf
    moves = rng.uniform(0, 0.5, 20)
    tokens = make_tokens(aoa, snr)
    classified = classifier.predict_tokens(tokens)
    batch = pack_routes([np.arange(20)], [moves], classified, tokens, np.zeros(20, int), INPUTS)
    with torch.inference_mode():
        logits = route_network_of(classifier.route, INPUTS)(batch.features)[0][batch.there].double().numpy()
    expected = fused_probability(logits, np.isfinite(snr[:, 0]), (1, 2, 3))
    for name, content in classifier.files("a").items():
        (tmp_path / name).write_bytes(content)
    follower = Follower(load_classifier(tmp_path / "a.safetensors"))
    got = [follower.update(a, s, moved_m=float(m)) for a, s, m in zip(aoa, snr, moves, strict=True)]
    np.testing.assert_allclose(got, expected, atol=1e-5)
    assert got[7].tolist() == [1, 0, 0, 0]
    assert np.abs(np.array(got)[1:] - classified[1:]).max() > 1e-3


def test_what_a_follower_needs(classifier):
    follower = Follower(classifier)
    with pytest.raises(ValueError, match=r"moved_m is -1, expected a distance"):
        follower.update(np.zeros(5), np.ones(5), moved_m=-1)
    classifier.route = None
    with pytest.raises(ValueError, match=r"no network for routes"):
        Follower(classifier)
