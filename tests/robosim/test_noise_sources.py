"""Each source of noise has random numbers of its own: a further source changes no other."""

from dataclasses import replace

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.camera.depth_noise import DepthNoise
from robosim.movers.movers import MoversConfig
from robosim.robot.robots import RobotConfig
from robosim.simulator import Simulator, SimulatorConfig
from robosim.support.randomness import named_generator
from robosim.task.tasks import Anchor, make_task, with_anchors
from slam.actions import Action
from tests.plans import two_rooms

ROOMS = make_building(two_rooms(0.9))
PLACES = reach(ROOMS, 0.1)
LIDAR = RobotConfig(lidar="ring-64")
BASE = SimulatorConfig(physics="kinematic", camera="plan", robot=LIDAR)
ANCHORS = [Anchor(name="hall", place=np.array([1.0, 1.0])), Anchor(name="lift", place=np.array([5.0, 2.0]))]
#: Further sources: another configuration, number of anchors, and whether there is a radio.
SOURCES = {
    "person": (replace(BASE, movers=MoversConfig(people=1)), 0, True),
    "anchor": (BASE, 1, True),
    "second anchor": (BASE, 2, True),
    "depth": (replace(BASE, robot=replace(LIDAR, depth_noise=DepthNoise(level=1.0))), 0, True),
    "no lidar": (replace(BASE, robot=RobotConfig()), 0, True),
    "no radio": (BASE, 0, False),
}


def random_states(config, anchors, uses_radio):
    """State of each generator after two searches of three steps, by the source's name."""
    simulator = Simulator(ROOMS, config, uses_radio=uses_radio)
    rng = np.random.default_rng(1)
    for _ in range(2):
        task = make_task(PLACES, np.random.default_rng(0))
        simulator.reset(with_anchors(task, PLACES, ANCHORS[:anchors]), rng)
        for action in (Action.FORWARD, Action.LEFT, Action.LEFT):
            simulator.step(action)
    generators = {
        "motion": simulator._rng,
        **({"radio": simulator._radio_rng} if uses_radio else {}),
        **({"lidar": simulator._lidar_rng} if config.robot.lidar != "none" else {}),
        **({"depth": simulator._depth_rng} if config.robot.depth_noise.level else {}),
        **{f"anchor {name}": generator for name, generator in simulator._anchor_rngs.items()},
    }
    return {name: generator.bit_generator.state for name, generator in generators.items()}


@pytest.mark.parametrize("source", SOURCES)
def test_simulator_keeps_other_noise_with_a_further_source(source):
    """Generators that both have are in the same state, exactly, also in the second search."""
    before, after = random_states(BASE, 0, True), random_states(*SOURCES[source])
    for name in set(before) & set(after):
        assert before[name] == after[name], name


def test_anchor_noise_does_not_depend_on_other_anchors():
    """The first of two anchors draws what it draws alone."""
    alone, first = random_states(*SOURCES["anchor"]), random_states(*SOURCES["second anchor"])
    assert alone["anchor hall"] == first["anchor hall"]


def test_named_generators_differ_by_name_and_seed():
    """Equal for equal seeds and names; the parent draws nothing."""
    parent = np.random.default_rng(3)
    before = parent.bit_generator.state
    draws = [
        named_generator(rng, name).random()
        for rng in (parent, np.random.default_rng(3), np.random.default_rng(4))
        for name in ("lidar", "movers")
    ]
    assert draws[:2] == draws[2:4] and len(set(draws)) == 4
    assert parent.bit_generator.state == before
