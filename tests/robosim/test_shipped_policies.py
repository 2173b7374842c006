"""The shipped local policy drives, through a building and with a body that it was not trained in."""

import numpy as np

from robosim.building import make_building
from robosim.episode import EpisodeConfig, run_episode
from robosim.planfiles import read_plan
from robosim.reach import reach
from robosim.tasks import make_task


def test_the_learned_local_policy_arrives():
    """In the shipped cottage, with wheels and contacts and noise, in at most half as many decisions more.

    Measured: 67 decisions, and 83 by the deterministic controller.
    """
    building = make_building(read_plan("cottage"))
    places = reach(building, 0.1)
    task = make_task(places, np.random.default_rng([1, 0]))
    steps = {}
    for controller in ("planned", "learned"):
        log, _ = run_episode(building, places, task, EpisodeConfig(seed=1, controller=controller))
        assert log.ended == "arrived"
        steps[controller] = log.steps
    assert steps["learned"] <= 1.5 * steps["planned"]
