"""The network of link states as it is used against the network as it is trained: PyTorch computes the same."""

import numpy as np
import pytest
import torch

from robosim.support.torch_training import weights_of
from wireless.linkstate.forward import relation_logits, relation_shapes
from wireless.linkstate.learning.networks import RelationNetwork
from wireless.linkstate.tokens import make_tokens

SOME, ALL = ("aoa", "snr"), ("aoa", "aod", "snr", "peak", "delay")


def tokens(n: int = 100) -> np.ndarray:
    """Random estimates, a third of the paths missing."""
    rng = np.random.default_rng(0)
    aoa, aod = rng.uniform(-np.pi, np.pi, (2, n, 5))
    snr = np.where(rng.random((n, 5)) < 0.3, -np.inf, rng.uniform(-20, 60, (n, 5)))
    peak, delay = rng.uniform(0, 30, (n, 5)), rng.uniform(0, 3e-7, (n, 5))
    return make_tokens(aoa, snr, aod_rad=aod, peak=peak, delay_s=delay)


@pytest.mark.parametrize("inputs", [SOME, ALL])
def test_logits_are_those_of_pytorch(inputs):
    """To 1e-5 (measured 2e-6 on logits of 10), with weights of the same names and shapes."""
    torch.manual_seed(0)
    network = RelationNetwork(inputs).eval()
    weights = weights_of(network)
    assert {name: value.shape for name, value in weights.items()} == relation_shapes(inputs)
    with torch.inference_mode():
        expected = network(torch.from_numpy(tokens())).numpy()
    assert np.ptp(expected) > 0.01
    np.testing.assert_allclose(relation_logits(weights, tokens(), inputs), expected, atol=1e-5)


def test_a_link_does_not_depend_on_those_asked_about_with_it():
    """Bit for bit."""
    torch.manual_seed(0)
    weights = weights_of(RelationNetwork(ALL))
    together = relation_logits(weights, tokens(), ALL)
    alone = [relation_logits(weights, link[None], ALL)[0] for link in tokens()]
    np.testing.assert_array_equal(together, alone)
