"""Several transmitters in one episode: each measured by itself, reported by name, and none disturbs the target's."""

import json
from dataclasses import replace

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.cli import main
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.plans.files import write_ros
from robosim.plans.floorplan import MapError
from robosim.policies.goals import GoalPolicy, PolicyContext, Wireless, los
from robosim.radio.link import RadioLinkConfig
from robosim.simulator import SimulatorConfig
from robosim.task.tasks import Anchor, make_task, with_anchors
from tests.plans import two_rooms
from wireless.paths import LinkState

SIMULATOR = SimulatorConfig(physics="kinematic", camera="embree", radio=RadioLinkConfig(estimator="pca"))
CONFIG = EpisodeConfig(goal="los", mapper="classical", link_states="true", max_steps=6, simulator=SIMULATOR)
HALL = Anchor(name="hall", place=np.array([1.5, 2.0]))
LIFT = Anchor(name="lift", place=np.array([5.0, 2.5]), known=False)


class Watching(GoalPolicy):
    """Does as `los` does, and keeps what it was given."""

    uses_radio = True

    def __init__(self, context: PolicyContext) -> None:
        self._los: Wireless = los(context)
        self.given: list = []
        Watching.last = self

    def goal(self, sensed, estimated):
        self.given.append(estimated)
        return self._los.goal(sensed, estimated)


@pytest.fixture(scope="module")
def scene():
    building = make_building(two_rooms(0.8))
    places = reach(building, 0.1)
    start, target = np.array([0.8, 0.6, 0.0]), np.array([5.5, 0.8])
    return building, places, make_task(places, np.random.default_rng(0), start=start, target=target)


def test_others_change_nothing_of_the_target_and_are_reported_by_name(scene):
    """Two more transmitters: the same trajectory, the same measurements of the target, and two for each."""
    building, places, task = scene
    config = replace(CONFIG, goal=Watching)
    alone, _ = run_episode(building, places, task, config)
    together, _ = run_episode(building, places, with_anchors(task, places, [HALL, LIFT]), config)
    np.testing.assert_array_equal(together.poses, alone.poses)
    assert together.links == alone.links
    assert {name: len(links) for name, links in together.anchor_links.items()} == {"hall": 6, "lift": 6}

    estimated = Watching.last.given[0]
    assert set(estimated.anchors) == {"hall", "lift"}
    # The robot knows where one of them stands, and at the start sees it: its arrival points there.
    assert list(estimated.anchor_places) == ["hall"]
    measurement = estimated.anchors["hall"]
    assert measurement.state == LinkState.LOS
    x, y = HALL.place - estimated.pose[:2]
    assert measurement.aoa_rad[0] == pytest.approx(np.arctan2(y, x), abs=np.radians(3))


def test_the_result_reports_them(tmp_path):
    write_ros(two_rooms(0.8), tmp_path / "pair.yaml")
    main(
        f"episode {tmp_path}/pair.yaml --start 0.8,0.6,0 --target 5.5,0.8 --anchor hall,1.5,2 "
        f"--unknown-anchor lift,5,2.5 --goal los --mapper classical --physics kinematic --camera embree "
        f"--radio.estimator pca --link-states true --max-steps 3 --no-video --out {tmp_path}/out".split()
    )
    output = json.loads((tmp_path / "out" / "result.json").read_text())["anchors"]
    assert output["hall"]["place"] == [1.5, 2.0] and output["hall"]["known"]
    assert not output["lift"]["known"]
    assert output["hall"]["los_aoa_within_5_deg"] == 1.0


@pytest.mark.parametrize(
    ("anchors", "words"),
    [
        ([Anchor(name="wall", place=np.array([3.05, 0.2]))], "'wall' .* is in a wall"),
        ([HALL, HALL], "'hall' needs a name of its own"),
        ([Anchor(name="target", place=np.array([1.0, 1.0]))], "other than 'target'"),
        (
            [Anchor(name="far", place=np.array([1e9, 1.0]))],
            "the place of the transmitter 'far' is 1000000000.0",
        ),
    ],
)
def test_what_cannot_be_is_rejected(scene, anchors, words):
    _, places, task = scene
    with pytest.raises((ValueError, MapError), match=words):
        with_anchors(task, places, anchors)
