"""Training of classifiers: what is learnt, that seeds decide it, going on after an interruption; calibration."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from robosim.training.policy_weights import Checkpoint
from wireless.linkstate import Recipe, make_tokens, train
from wireless.linkstate.calibration import cross_entropy, fit_temperature, reliability, scaled

SHORT = Recipe(inputs=("aoa", "aod", "snr"), epochs=3, batch=64, width=16)


class Stopped(Exception):
    """Somebody pulled the plug."""


def made_up(n, seed):
    """Links that differ in geometry alone: state 1 has its strongest path straight, state 2 off a wall, 3 neither.

    A straight path has aoa = aod + 180 degrees, a mirrored one aoa = 180 - aod, one of state 3 aoa = 135 - aod.
    """
    rng = np.random.default_rng(seed)
    state = rng.integers(1, 4, n)
    aoa, aod = rng.uniform(-np.pi, np.pi, (2, n, 5))
    tilt = np.radians(rng.uniform(20, 70, n) + 90 * rng.integers(0, 4, n))
    aod[:, 0] = tilt
    aoa[:, 0] = np.select(
        [state == 1, state == 2], [tilt + np.pi, np.pi - tilt], np.radians(90) + np.radians(45) - tilt
    )
    snr = np.sort(rng.uniform(0, 40, (n, 5)))[:, ::-1].copy()
    return make_tokens(aoa, snr, aod_rad=aod), state


def weights(network):
    return torch.cat([value.flatten().double() for value in network.state_dict().values()])


def test_geometry_is_learnt():
    """States that differ in no single input, only in sums and differences of angles: over 97 % right."""
    tokens, state = made_up(2000, 0)
    _, epochs = train(tokens, state, replace(SHORT, epochs=5, averaging=0.9), watch=made_up(600, 1))
    assert epochs[-1].accuracy > 0.97
    assert epochs[-1].loss < epochs[0].loss
    untrained = train(tokens[:1], state[:1], replace(SHORT, epochs=1), watch=made_up(600, 1))[1]
    assert untrained[0].accuracy < 0.5


def test_the_seed_decides_everything():
    """Also with other threads and another state of PyTorch's generator, which is left as it was."""
    tokens, state = made_up(300, 0)
    recipe = replace(SHORT, epochs=2, jitter_deg=1.0, shift_db=1.0)
    first = weights(train(tokens, state, recipe)[0])
    torch.manual_seed(5)
    before = torch.get_rng_state()
    threads = torch.get_num_threads()
    torch.set_num_threads(2)
    again = weights(train(tokens, state, recipe)[0])
    assert torch.get_num_threads() == 2
    torch.set_num_threads(threads)
    assert torch.equal(first, again)
    assert torch.equal(torch.get_rng_state(), before)
    assert not torch.equal(first, weights(train(tokens, state, replace(recipe, seed=1))[0]))


def test_a_resumed_training_equals_one_never_stopped(tmp_path):
    """Bit for bit, stopped after either epoch."""
    tokens, state = made_up(300, 0)
    recipe = SHORT
    whole, epochs = train(tokens, state, recipe)
    for last in (1, 2):
        file = Checkpoint(tmp_path / f"{last}.pt")

        def pull(epoch, last=last):
            if epoch.epoch == last:
                raise Stopped

        with pytest.raises(Stopped):
            train(tokens, state, recipe, checkpoint=file, report=pull)
        resumed, rest = train(tokens, state, recipe, checkpoint=file)
        assert torch.equal(weights(whole), weights(resumed))
        assert rest == epochs


def test_a_checkpoint_of_something_else_is_rejected(tmp_path):
    tokens, state = made_up(200, 0)
    file = Checkpoint(tmp_path / "run.pt")
    train(tokens, state, replace(SHORT, epochs=1), checkpoint=file)
    with pytest.raises(ValueError, match="epochs 1 there, 2 now"):
        train(tokens, state, replace(SHORT, epochs=2), checkpoint=file)
    with pytest.raises(ValueError, match="another training: sums"):
        train(*made_up(200, 1), replace(SHORT, epochs=1), checkpoint=file)
    file.path.write_bytes(b"rubbish")
    with pytest.raises(ValueError, match=r"run\.pt: not readable as the checkpoint"):
        train(tokens, state, replace(SHORT, epochs=1), checkpoint=file)
    assert [p.name for p in tmp_path.iterdir()] == ["run.pt"]


def test_links_without_paths_teach_nothing():
    tokens, state = made_up(200, 0)
    empty = np.full((50, 5, 5), np.nan, np.float32)
    recipe = replace(SHORT, epochs=1)
    with_them = train(np.concatenate([empty, tokens]), np.concatenate([np.zeros(50, int), state]), recipe)[0]
    assert torch.equal(weights(with_them), weights(train(tokens, state, recipe)[0]))
    with pytest.raises(ValueError, match="none of 50 links has an estimated path"):
        train(empty, np.zeros(50, int), recipe)


@pytest.mark.parametrize(
    "wrong",
    [{"epochs": 0}, {"dropout": 1.0}, {"inputs": ("aoa", "sne")}, {"inputs": ("aoa",)}],
)
def test_a_recipe_that_cannot_be_is_rejected(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Recipe(**wrong)


def sure_links(n, seed, temperature=1.0):
    """Probabilities, and states drawn from them at a temperature."""
    rng = np.random.default_rng(seed)
    probability = rng.dirichlet([0.5] * 4, n)
    drawn = scaled(probability, temperature).cumsum(1) > rng.random((n, 1))
    return probability, drawn.argmax(1)


def test_a_perfectly_calibrated_predictor_has_no_calibration_error():
    """States drawn from the predicted probabilities: by chance alone below 0.004 at 200,000 links."""
    assert reliability(*sure_links(200_000, 0)).expected_calibration_error < 0.004
    assert reliability(*sure_links(200_000, 0, temperature=2.0)).expected_calibration_error > 0.05


def test_calibration_error_by_hand():
    """Two links classified with 0.9, one of them right; one with 0.6, right: (2 x 0.4 + 0.4) / 3."""
    bins = reliability(np.array([[0.9, 0.1], [0.9, 0.1], [0.4, 0.6]]), np.array([0, 1, 1]), bins=10)
    assert bins.expected_calibration_error == pytest.approx(0.4)
    assert bins.count.tolist() == [0, 0, 0, 0, 0, 0, 1, 0, 0, 2]


@pytest.mark.parametrize("temperature", [0.5, 1.0, 2.5])
def test_the_temperature_is_found(temperature):
    """Of states drawn at a temperature, to 3 % at 50,000 links; zeros stay zero and order stays."""
    probability, state = sure_links(50_000, 1, temperature)
    found = fit_temperature(probability, state)
    assert found == pytest.approx(temperature, rel=0.03)
    assert cross_entropy(scaled(probability, found), state) <= cross_entropy(probability, state)
    assert scaled(np.array([[0.0, 0.25, 0.75]]), 0.5)[0] == pytest.approx([0, 0.1, 0.9])
