"""Training on segments: advantages by hand, imitation, and the clipped surrogate."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from robosim.policies.search_network import (
    HIDDEN,
    INPUTS,
    SearchNetwork,
    action_probabilities,
    empty_memory,
    initial_weights,
)
from robosim.training.policy_weights import as_tensors
from robosim.training.search_learning import Segment, advantages, forward, learn
from slam.learning.ppo import PpoConfig

#: Four robots, two in a batch.
LEARNING = PpoConfig(trace=0.95, passes=3, batch=2, rate=4e-4, entropy=0.003)


def segment_of(steps=6, robots=4, **changes):
    rng = np.random.default_rng(0)
    shape = steps, robots
    columns = {
        "inputs": rng.standard_normal((*shape, INPUTS)).astype(np.float32),
        "begins": np.zeros(shape, bool),
        "counts": np.ones(shape, bool),
        "advised": np.zeros(shape, int),
        "taken": np.zeros(shape, int),
        "log_odds": np.full(shape, np.log(1 / 3)),
        "reward": np.zeros(shape),
        "arrived": np.zeros(shape, bool),
        "late": np.zeros(shape, bool),
        "value": np.zeros((steps + 1, robots)),
        "memory": empty_memory(robots),
    }
    columns["begins"][0] = True
    return Segment(**columns | changes)


def test_advantages_by_hand():
    """Discount 0.5, trace 0.5, values of 1: an arrival at the second step, a pause, a search cut off by time."""
    reward, one = np.array([[1.0], [2.0], [9.0], [0.0], [4.0]]), np.array([[False]] * 5)
    arrived, counts, late = one.copy(), ~one, one.copy()
    arrived[1], counts[2], late[4] = True, False, True
    segment = segment_of(
        5, 1, reward=reward, arrived=arrived, counts=counts, late=late, value=np.ones((6, 1))
    )
    found, worth = advantages(segment, PpoConfig(discount=0.5, trace=0.5))
    last = 4 + 0.5 - 1  # time ran out: the expected reward counts
    second = 2 - 1  # there is no reward after an arrival
    assert found[:, 0] == pytest.approx([1 + 0.5 - 1 + 0.25 * second, second, 0, 0.5 - 1 + 0.25 * last, last])
    assert worth[:, 0] == pytest.approx(found[:, 0] + 1)


def test_learning_and_driving_use_one_network():
    """PyTorch over a segment against ONNX Runtime step by step, memories emptied at a beginning; measured 5e-7."""
    begins = segment_of().begins
    begins[3, 1] = True
    segment = segment_of(begins=begins)
    weights = initial_weights(np.random.default_rng(1))
    weights["action.weight"] = np.random.default_rng(2).standard_normal((HIDDEN, 3)).astype(np.float32)
    arrays = (torch.from_numpy(array) for array in (segment.inputs, segment.begins, segment.memory))
    scores, values = forward(as_tensors(weights), *arrays)
    network, memory = SearchNetwork(weights), empty_memory(4)
    for t in range(6):
        output = network(segment.inputs[t], np.where(segment.begins[t][:, None], np.float32(0), memory))
        memory = output.memory
        assert np.abs(output.scores - scores[t].detach().numpy()).max() < 1e-5
        assert np.abs(output.value - values[t].detach().numpy()).max() < 1e-5


def improved(segment, times=15, config=None, **options):
    """Probability of each action before and after learning, over the segment's first step."""
    weights = as_tensors(initial_weights(np.random.default_rng(1)))
    optimiser = torch.optim.Adam(weights.values(), lr=3e-3)
    shares = []
    for step in range(times + 1):
        network = SearchNetwork({name: value.detach().numpy() for name, value in weights.items()})
        scores = network(segment.inputs[0], empty_memory(4)).scores
        shares.append(action_probabilities(scores).mean(axis=0))
        if step < times:
            rng = np.random.default_rng(step)
            learn(weights, optimiser, segment, config or LEARNING, rng=rng, **options)
    return shares[0], shares[-1]


def test_imitation_learns_the_advised_actions():
    """The advice is always left; the actions of the policy do not matter."""
    before, after = improved(segment_of(advised=np.ones((6, 4), int)), advice=1.0, has_surrogate=False)
    assert before[1] == pytest.approx(1 / 3, abs=0.02)
    assert after[1] > 0.9


def test_rewarded_actions_become_more_frequent():
    """Two robots turned right with a reward, two went forward without; the advice has no weight."""
    taken = np.zeros((6, 4), int)
    taken[:, :2] = 2
    reward = np.where(taken == 2, 1.0, 0.0)
    before, after = improved(segment_of(taken=taken, reward=reward), advice=0.0, has_surrogate=True)
    assert after[2] > before[2] + 0.05 and after[0] < before[0] - 0.05


def test_the_surrogate_is_clipped():
    """Rewarded actions are 1.5 times as likely as when taken, others 0.67 times: no gradient is left."""
    taken = np.zeros((6, 4), int)
    taken[:, :2] = 2
    odds = np.log(np.where(taken == 2, 1 / 3 / 1.5, 1.5 / 3))
    segment = segment_of(taken=taken, reward=np.where(taken == 2, 1.0, 0.0), log_odds=odds)
    alone = replace(LEARNING, value=0.0, entropy=0.0, discount=0.0)  # each step by its own reward
    before, after = improved(segment, times=3, config=alone, advice=0.0, has_surrogate=True)
    assert after.tolist() == before.tolist()
