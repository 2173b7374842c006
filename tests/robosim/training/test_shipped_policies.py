"""What was learnt by acting holds where it was not learnt: the local policy, where to look next, and whole searches."""

import numpy as np
from safetensors.numpy import load_file

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.plans.files import read_plan
from robosim.support.installation import shipped_network
from robosim.task.tasks import make_task
from robosim.training.explorer import ExplorerRecipe, mean_coverage


def test_the_learned_choice_sees_more_sooner():
    """Walks of 150 decisions through four homes of another seed: above the hand-made rating it began from."""
    weights, recipe = load_file(shipped_network("explorer")), ExplorerRecipe(decisions=150, seed=77)
    learned = [mean_coverage(home, recipe, "learned", weights) for home in range(4)]
    rated = [mean_coverage(home, recipe, "gain") for home in range(4)]
    assert np.mean(learned) > np.mean(rated) + 0.03


def test_the_learned_search_arrives():
    """In the shipped cottage, with wheels and contacts, noise and live radio: in at most twice as many decisions."""
    building = make_building(read_plan("cottage"))
    places = reach(building, 0.1)
    task = make_task(places, np.random.default_rng([1, 0]))
    steps = {}
    for goal in ("oracle", "learned"):
        log, _ = run_episode(building, places, task, EpisodeConfig(goal=goal, mapper="classical", seed=1))
        assert log.ended == "arrived"
        steps[goal] = log.steps
    assert steps["learned"] <= 2 * steps["oracle"]
