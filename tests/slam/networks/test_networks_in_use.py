"""Networks as they are used against networks as they are trained: PyTorch computes the same."""

import numpy as np
import pytest
import torch
from torch_modules import module_of

from robosim.support.installation import shipped_network
from robosim.support.torch_training import weights_of
from slam.learning.map_module import MapModule
from slam.networks.features import N_CHANNELS
from slam.networks.files import load_mapper
from slam.networks.map_network import MapNetwork, NetworkConfig, map_shapes


def shown(count: int, channels: int, side: int = 64) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1, 1, (count, channels, side, side)).astype(np.float32)


def test_the_shipped_mapper_says_what_pytorch_says():
    """Logits of up to 20 within 5e-5 (measured 8e-6)."""
    network, _ = load_mapper(shipped_network("mapper"))
    patches = shown(3, N_CHANNELS)
    with torch.inference_mode():
        expected = module_of(network)(torch.from_numpy(patches)).numpy()
    assert np.ptp(expected) > 10
    np.testing.assert_allclose(network(patches), expected, atol=5e-5)


@pytest.mark.parametrize("widths", [(4,), (3, 5), (4, 6, 8, 10, 12)])
def test_a_mapper_of_any_size_says_what_pytorch_says(widths):
    """Patches of another size than in training too: 32 cells, to 1e-5."""
    config = NetworkConfig(widths=widths, inputs=3)
    torch.manual_seed(0)
    module = MapModule(config)
    with torch.no_grad():  # normalisation that does something
        module(torch.randn(4, 3, 32, 32))
    module.eval()
    patches = shown(2, 3, 32)
    with torch.inference_mode():
        expected = module(torch.from_numpy(patches)).numpy()
    np.testing.assert_allclose(module.network()(patches), expected, atol=1e-5)


@pytest.mark.parametrize("widths", [(2,), (3, 5, 7), (2, 2, 2, 2, 2, 2)])
def test_shapes_are_those_that_pytorch_makes(widths):
    config = NetworkConfig(widths=widths, inputs=4)
    module = MapModule(config)
    assert {name: value.shape for name, value in weights_of(module).items()} == map_shapes(config)
    counted = sum(value.numel() for value in module.parameters())
    assert module.network().parameters == counted


def test_weights_that_do_not_fit_are_rejected():
    weights = dict(weights_of(MapModule(NetworkConfig(widths=(4,)))))
    with pytest.raises(ValueError, match="other names, shapes"):
        MapNetwork(weights, NetworkConfig(widths=(4, 8)))


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e30])
def test_values_that_overflow_are_rejected(value):
    weights = dict(weights_of(MapModule(NetworkConfig(widths=(4,)))))
    weights["last.bias"] = np.array([value, 0], np.float32)
    with pytest.raises(ValueError, match=r"last\.bias has values that are NaN, infinite or above 1,000,000"):
        MapNetwork(weights, NetworkConfig(widths=(4,)))


def test_negative_variances_are_rejected():
    weights = dict(weights_of(MapModule(NetworkConfig(widths=(4,)))))
    name = next(name for name in weights if name.endswith("running_var"))
    weights[name] = -weights[name]
    with pytest.raises(ValueError, match="has negative variances"):
        MapNetwork(weights, NetworkConfig(widths=(4,)))
