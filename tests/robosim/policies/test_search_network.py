"""Inputs and network of the learned search."""

import numpy as np
import pytest
import torch

from robosim.policies.search_network import (
    COLUMNS,
    HIDDEN,
    INPUTS,
    SearchNetwork,
    SearchSenses,
    action_probabilities,
    draw_actions,
    empty_memory,
    initial_weights,
)


def encode(senses, *, depth=None, odometry=(0, 0, 0), directions=(), waited=False):
    n = len(directions)
    return senses.encode(
        np.full((8, 64), 2.0) if depth is None else depth,
        np.array(odometry, float),
        np.array(directions, float),
        np.linspace(30, 20, n),
        np.zeros(n),
        np.array([0, 1, 0, 0.0]),
        waited=waited,
    )


def trail_of(inputs):
    return inputs[-27:-3].reshape(3, 8)


def test_depth_is_that_of_the_horizon_from_left_to_right():
    """A wall 1.5 m ahead on the left half, nothing measured on the right; floor and ceiling are not looked at."""
    depth = np.full((128, 128), 0.7)
    depth[63:65, :64], depth[63:65, 64:] = 1.5, 0.0
    inputs = encode(SearchSenses(), depth=depth)
    assert inputs.shape == (INPUTS,) and inputs.dtype == np.float32
    assert inputs[:32] == pytest.approx(0.5 / 2.0)
    assert inputs[COLUMNS : COLUMNS + 32] == pytest.approx(0.15)
    assert not inputs[32:COLUMNS].any() and not inputs[COLUMNS + 32 : 2 * COLUMNS].any()
    same = encode(SearchSenses(), depth=depth[::16, ::2])  # a smaller picture
    assert same[:COLUMNS].shape == inputs[:COLUMNS].shape


def test_paths_are_encoded_by_cosine_and_sine():
    paths = encode(SearchSenses(), directions=(np.pi / 2, -np.pi / 2))[128:153].reshape(5, 5)
    assert paths[0] == pytest.approx([1, 0, 1, 1, 0], abs=1e-6)
    assert paths[1] == pytest.approx([1, 0, -1, 20 / 30, 0], abs=1e-6)
    assert not paths[2:].any()


def test_the_trail_lies_where_the_robot_was():
    """Three steps of 0.5 m leave their starts 0.5, 1 and 1.5 m behind; after a left turn they are to the right."""
    senses = SearchSenses()
    encode(senses)
    for _ in range(3):
        inputs = encode(senses, odometry=(0.5, 0, 0))
    assert inputs[-3:-1] * 10 == pytest.approx([-1.5, 0], abs=1e-6)
    behind = (0, 7)  # on the border of the first and the last of eight directions
    assert np.flatnonzero(trail_of(inputs).any(axis=0)).tolist() in ([0], [7])
    assert trail_of(inputs)[0, list(behind)].sum() == pytest.approx(np.log(2) / 4)
    assert trail_of(inputs)[1, list(behind)].sum() == pytest.approx(np.log(3) / 4)
    inputs = encode(senses, odometry=(0, 0, np.pi / 4))
    assert inputs[-3:-1] * 10 == pytest.approx(1.5 * np.array([-np.sqrt(0.5), np.sqrt(0.5)]), abs=1e-5)
    assert inputs[-1] == pytest.approx(0.004)


def test_waits_do_not_count():
    """The same inputs after any number of waits, also in physics in which a wait moves the robot a little."""
    senses = SearchSenses()
    encode(senses)
    encode(senses, odometry=(0.5, 0, 0))
    turned = encode(senses, odometry=(0, 0, 0.3))
    for _ in range(3):
        waited = encode(senses, odometry=(1e-5, 0, 1e-6), waited=True)
    np.testing.assert_array_equal(np.delete(waited, slice(153, 160)), np.delete(turned, slice(153, 160)))


def test_the_trail_of_a_long_search_is_complete():
    """Two hundred turns on the spot: all steps count as within the nearest ring, in some direction."""
    senses = SearchSenses()
    for _ in range(200):
        inputs = encode(senses, odometry=(0, 0, 0.1))
    assert np.expm1(4 * trail_of(inputs)[0]).sum() == pytest.approx(199, rel=1e-5)


def test_the_memory_is_that_of_pytorch():
    """PyTorch's own gated recurrent unit over 20 steps; measured 1e-6."""
    rng = np.random.default_rng(0)
    weights = initial_weights(rng)
    cell = torch.nn.GRUCell(HIDDEN, HIDDEN)
    with torch.no_grad():
        for name, own in (("weight_ih", "input_weight"), ("weight_hh", "own_weight")):
            getattr(cell, name).copy_(torch.from_numpy(weights[f"memory.{own}"].T.copy()))
        for name, own in (("bias_ih", "input_bias"), ("bias_hh", "own_bias")):
            bias = rng.standard_normal(3 * HIDDEN).astype(np.float32)
            weights[f"memory.{own}"] = bias
            getattr(cell, name).copy_(torch.from_numpy(bias))
        network, memory, other = SearchNetwork(weights), empty_memory(4), torch.zeros(4, HIDDEN)
        for _ in range(20):
            inputs = rng.standard_normal((4, INPUTS)).astype(np.float32)
            memory = network(inputs, memory).memory
            seen = torch.relu(torch.from_numpy(inputs @ weights["encoder.weight"]))
            other = cell(seen, other)
    assert memory.dtype == np.float32
    assert np.abs(memory - other.numpy()).max() < 2e-5


def test_a_batch_gives_the_same_output():
    rng = np.random.default_rng(1)
    network = SearchNetwork(initial_weights(rng))
    inputs = rng.standard_normal((3, INPUTS)).astype(np.float32)
    together = network(inputs, empty_memory(3))
    alone = [network(one, empty_memory()) for one in inputs]
    for name in together._fields:
        assert np.stack([getattr(one, name) for one in alone]) == pytest.approx(
            getattr(together, name), abs=1e-5
        )


def test_actions_are_drawn_by_their_probabilities():
    """20,000 draws of probabilities 0.1, 0.6, 0.3: each within four standard deviations, 0.014."""
    scores = np.tile(np.log(np.float32([0.1, 0.6, 0.3])), (20_000, 1))
    assert action_probabilities(scores[:1])[0] == pytest.approx([0.1, 0.6, 0.3], abs=1e-6)
    share = np.bincount(draw_actions(scores, np.random.default_rng(0)), minlength=3) / len(scores)
    assert np.abs(share - [0.1, 0.6, 0.3]).max() < 0.014
