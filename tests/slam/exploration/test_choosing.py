"""The learned choice among frontiers: what must hold of it before and after training."""

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file

from robosim.navigation import gain_explorer, learned_explorer
from slam.exploration.choosing import FEATURES, HIDDEN, Chooser, evaluate, initial_weights, load_chooser
from slam.exploration.explorer import ExplorerConfig
from slam.learning.ppo import PpoConfig, Walk, advantages, improve
from slam.robot import Robot


def weights_at_random(seed=0):
    """Weights all of which play a part."""
    rng = np.random.default_rng(seed)
    return {name: rng.standard_normal(w.shape).astype(np.float32) for name, w in initial_weights(rng).items()}


def offers(n, seed=1):
    return np.random.default_rng(seed).standard_normal((n, len(FEATURES))).astype(np.float32)


def all_there(n):
    return np.ones((n, 1), np.float32)


def test_untrained_it_takes_the_best_rating():
    """The first feature is the hand-made rating, less is better; the rest has no say yet."""
    choose = Chooser(initial_weights(np.random.default_rng(3)))
    for seed in range(20):
        features = offers(7, seed)
        assert choose(features) == np.argmin(features[:, 0])


def test_order_and_padding_play_no_part():
    """Offers in another order get the same log-odds in that order; rows of padding change nothing."""
    weights, features = weights_at_random(), offers(5)
    logits, value = evaluate(weights, features, all_there(5))
    order = np.array([3, 0, 4, 1, 2])
    other, same = evaluate(weights, features[order], all_there(5))
    np.testing.assert_allclose(other, logits[order], rtol=1e-5, atol=1e-5)
    padded = np.vstack([features, np.full((2, len(FEATURES)), 9.0, np.float32)])
    longer, still = evaluate(weights, padded, np.vstack([all_there(5), np.zeros((2, 1), np.float32)]))
    np.testing.assert_allclose(longer[:5], logits, rtol=1e-5, atol=1e-5)
    assert (longer[5:] < -1e8).all()
    np.testing.assert_allclose([same, still], [value, value], rtol=1e-5)


def test_numpy_and_torch_agree():
    weights, features = weights_at_random(), offers(3 * 4).reshape(3, 4, -1)
    there = np.ones((3, 4, 1), np.float32)
    own = evaluate(weights, features, there)
    tensors = {name: torch.from_numpy(w) for name, w in weights.items()}
    theirs = evaluate(tensors, torch.from_numpy(features), torch.from_numpy(there), torch)
    for a, b in zip(own, theirs, strict=True):
        np.testing.assert_allclose(a, b.numpy(), rtol=1e-4, atol=1e-5)


def test_the_shipped_choice_has_the_settings_of_its_training():
    """Features depend on them; defaults for other ratings differ."""
    config = learned_explorer(Robot()).config
    assert (config.depth_m, config.max_gain_m2, config.keep, config.every) == (1.5, 5.0, 4.0, 8)
    assert gain_explorer(Robot()).config == ExplorerConfig(rating="gain")


@pytest.mark.parametrize("content", [{}, {"own.weight": np.zeros((2, HIDDEN), np.float32)}])
def test_a_wrong_file_is_rejected(content, tmp_path):
    path = tmp_path / "explorer.safetensors"
    with pytest.raises(
        ValueError, match=r"explorer\.safetensors: no such file, expected weights of explorer"
    ):
        load_chooser(path)
    save_file(content, path)
    with pytest.raises(
        ValueError, match=r"explorer\.safetensors: not readable as weights .*`robosim train explorer`"
    ):
        load_chooser(path)


def walk(coverage, at, value, ended):
    n = len(at)
    return Walk(
        features=[offers(2, k) for k in range(n)],
        taken=np.zeros(n, int),
        log_odds=np.full(n, np.log(0.5)),
        value=np.array(value, float),
        at=np.array(at),
        coverage=np.array(coverage),
        ended=ended,
    )


def test_with_full_traces_the_worth_is_the_discounted_return():
    """With lambda 1 what a choice was worth is what was seen after it, decision by decision, whatever was expected."""
    config = PpoConfig(discount=0.9, trace=1.0)
    seen = walk([0.1, 0.2, 0.2, 0.5, 0.6, 1.0], at=[0, 1, 4], value=[0.3, -2.0, 7.0], ended=True)
    advantage, worth = advantages(seen, config)
    gain = np.array([0.1, 0.0, 0.3, 0.1, 0.4])
    exact = [gain @ 0.9 ** np.arange(5), gain[1:] @ 0.9 ** np.arange(4), gain[4]]
    np.testing.assert_allclose(worth, exact, atol=1e-12)
    np.testing.assert_allclose(advantage, np.array(exact) - seen.value, atol=1e-12)


def test_without_traces_a_choice_is_held_against_the_next_expectation():
    """With lambda 0: reward while it lasts, and what was expected when it ended, as far off as it lasted."""
    config = PpoConfig(discount=0.9, trace=0.0)
    advantage, _ = advantages(walk([0.0, 0.2, 0.4, 0.4], at=[0, 2], value=[0.5, 0.6], ended=False), config)
    np.testing.assert_allclose(
        advantage, [0.2 + 0.9 * 0.2 + 0.81 * 0.6 - 0.5, 0.0 + 0.9 * 0.6 - 0.6], atol=1e-12
    )


def test_it_learns_which_of_two_pays():
    """A world where only the offer with more walls around shows anything: soon it is taken 9 times of 10.

    The hand-made rating says nothing here, and the signal is one feature of fourteen.
    """
    rng = np.random.default_rng(5)
    walls = FEATURES.index("walls_around")
    first = initial_weights(rng)
    weights = {name: torch.from_numpy(w.copy()).requires_grad_() for name, w in first.items()}
    optimiser = torch.optim.Adam(weights.values(), lr=1e-2)

    def step(learn):
        walks, right = [], 0
        now = {name: w.detach().numpy() for name, w in weights.items()}
        for _ in range(64):
            features = rng.standard_normal((2, len(FEATURES))).astype(np.float32)
            features[:, 0] = 0.0
            logits, value = evaluate(now, features, all_there(2))
            odds = np.exp(logits - logits.max()) / np.exp(logits - logits.max()).sum()
            taken = int(rng.random() < odds[1])
            paid = features[taken, walls] > features[1 - taken, walls]
            right += int(paid)
            walks.append(
                Walk(
                    features=[features],
                    taken=np.array([taken]),
                    log_odds=np.log(odds[[taken]]).astype(float),
                    value=np.array([float(value)]),
                    at=np.array([0]),
                    coverage=np.array([0.0, float(paid)]),
                    ended=True,
                )
            )
        if learn:
            improve(weights, optimiser, walks, PpoConfig(batch=64), rng)
        return right / 64

    right = [step(learn=True) for _ in range(40)]
    assert right[0] < 0.75
    assert np.mean(right[-5:]) > 0.9
