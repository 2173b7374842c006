"""Buildings of the learned search's training, and trainings that start from weights."""

import numpy as np
import pytest

from robosim.environments.sources import GeneratedHomes
from robosim.policies.search_network import initial_weights
from robosim.support.reading import FileError
from robosim.training import search
from robosim.training.policy_weights import write_policy
from robosim.training.search import SearchRecipe, Training
from robosim.training.search_walks import GeneratedBuildings


def test_without_offices_all_buildings_are_those_of_generated_homes():
    buildings, homes = GeneratedBuildings(count=3, seed=7, offices=0.0), GeneratedHomes(count=3, seed=7)
    for number in range(3):
        assert buildings.task_spec(number).plan is homes.task_spec(number).plan


def test_offices_have_many_sizes_and_the_share_that_is_asked_for():
    """Of 60 buildings with a share of 0.5; three standard deviations of a binomial share are 0.19."""
    buildings = GeneratedBuildings(count=60, seed=0, offices=0.5)
    plans = [buildings.task_spec(number).plan for number in range(60)]
    areas = [plan.free.sum() * plan.resolution_m**2 for plan in plans if plan.name.startswith("office")]
    assert 0.3 < len(areas) / 60 < 0.7
    assert 100 < min(areas) < 300 and 1000 < max(areas) < 2200


def test_a_training_starts_from_the_weights_of_a_file(tmp_path):
    weights = initial_weights(np.random.default_rng(9))
    write_policy(tmp_path, "search", weights, {})
    training = Training(SearchRecipe(start=str(tmp_path / "search.safetensors")), tmp_path)
    for name, value in training.weights.items():
        np.testing.assert_array_equal(value.detach().numpy(), weights[name])
    with pytest.raises(FileError, match="nothing"):
        Training(SearchRecipe(start=str(tmp_path / "nothing.safetensors")), tmp_path)


@pytest.mark.parametrize("count", [5, 30])
def test_a_training_uses_exactly_the_homes_that_are_asked_for(count, tmp_path, monkeypatch):
    """Also if they are fewer than those of an epoch (12), or no multiple."""

    class Stop(Exception):
        """The homes are known."""

    def stop(walks):
        homes.update(range(walks.first, walks.first + walks.homes))
        raise Stop

    homes = set()
    monkeypatch.setattr(search, "Robots", stop)
    training = Training(SearchRecipe(homes=count, seed=7), tmp_path)
    for training.epoch in range(6):
        with pytest.raises(Stop):
            training.run_epoch()
    assert homes == set(range(7, 7 + count))
