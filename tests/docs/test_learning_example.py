"""The example of learning runs, from the first step to the comparison."""

import runpy

import pytest

from tests.benchmarks import learning
from tests.benchmarks.harness import Options


# Stable-Baselines3 warns about the small sizes of this test.
@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
def test_training_and_comparison_run(monkeypatch, tmp_path):
    example = runpy.run_path(str(learning.EXAMPLE))
    example["SEARCH"]["max_episode_steps"] = 20
    monkeypatch.setattr(runpy, "run_path", lambda path: example)
    results = learning.main(steps=256, robots=1, searches=1, homes=1, options=Options(out=tmp_path))
    agents = {row["row"] for row in results.rows}
    assert agents == {"PPO", "random actions", "policy snr", "policy oracle"}
    for agent in agents:
        share, spl = (results.find("searches", agent, name)["value"] for name in ("arrived", "SPL"))
        assert 0 <= spl <= share / 100 <= 1
