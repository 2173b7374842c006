"""The example of learning runs, from the first step to the comparison."""

import importlib.util
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "docs" / "tasks" / "learn_with_sb3.py"


# Stable-Baselines3 warns about the small sizes of this test.
@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
def test_training_and_comparison_run():
    spec = importlib.util.spec_from_file_location("learn_with_sb3", EXAMPLE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    example.SEARCH["max_episode_steps"] = 20
    shares = example.main(256, robots=1, searches=1, homes=1)
    assert set(shares) == {"learned", "at random", "snr", "oracle"}
    assert all(0 <= spl <= share <= 1 for share, spl in shares.values())
