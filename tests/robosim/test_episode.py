"""The main path: a robot crosses a building to a target it knows, or explores it."""

import json

import av
import numpy as np
import pytest

from robosim.building.building import BuildingConfig, make_building
from robosim.building.reach import reach
from robosim.camera.depth_noise import DepthNoise
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.robot.robots import RobotConfig
from robosim.run import record_episode
from robosim.simulator import Simulator, SimulatorConfig
from robosim.task.tasks import make_task
from slam.actions import Action
from slam.planning.planner import Planner
from tests.plans import two_rooms

KINEMATIC = SimulatorConfig(physics="kinematic")


def _run(config: EpisodeConfig, plan=None, start=None, target=None):
    building = make_building(plan or two_rooms(0.8))
    places = reach(building, 0.1)
    task = make_task(places, np.random.default_rng(config.seed), start=start, target=target)
    return run_episode(building, places, task, config)[0]


START, TARGET = np.array([1.0, 0.6, 2.0]), np.array([5.0, 2.4])


@pytest.mark.parametrize("physics", ["dynamic", "kinematic"])
@pytest.mark.parametrize("camera", ["pyrender", "embree"])
def test_the_oracle_goes_through_the_door_to_the_target(physics, camera):
    """Noise on, start facing away. The path is 4.4 m; measured SPL 0.9 or more."""
    config = EpisodeConfig(
        goal="oracle", simulator=SimulatorConfig(physics=physics, camera=camera), max_steps=150
    )
    log = _run(config, start=START, target=TARGET)
    result = log.result()
    assert result["ended"] == "arrived"
    assert np.hypot(*(log.poses[-1][:2] - TARGET)) <= 0.3
    assert result["spl"] > 0.7
    assert result["deepest_penetration_m"] < 0.005
    assert result["position_error_last_m"] < 0.1


@pytest.mark.parametrize("goal", ["snr", "los", "los-or-first", "visual"])
def test_a_robot_that_listens_or_looks_finds_the_target(goal):
    """From the other room, facing away; the path is 4.4 m, which the oracle drives in some 40 steps."""
    config = EpisodeConfig(goal=goal, link_states="true", simulator=KINEMATIC, max_steps=300)
    result = _run(config, start=START, target=TARGET).result()
    assert result["ended"] == "arrived"
    assert ("link_state_accuracy" in result) == (goal != "visual")
    if goal != "visual":
        assert result["link_state_accuracy"] == 1.0
        assert result["los_aoa_within_5_deg"] > 0.9
        assert result["steps"] < 120


def test_a_radio_changes_no_other_noise():
    """Two policies that choose the same goals drive alike, bit for bit, with a radio or without."""
    without, listening = (
        _run(
            EpisodeConfig(goal=goal, link_states="true", simulator=KINEMATIC, max_steps=4),
            start=np.array([2.5, 0.4, 2.0]),
            target=TARGET,
        )
        for goal in ("visual", "los")
    )
    assert np.array_equal(without.poses, listening.poses)
    assert len(listening.links) == 4
    assert not without.links


def test_exploration_sees_both_rooms_and_stops():
    """All that can be seen of two empty rooms is seen well before the steps are out."""
    result = _run(EpisodeConfig(goal="explore", simulator=KINEMATIC, max_steps=400)).result()
    assert result["ended"] == "explored"
    assert result["coverage"] > 0.95


@pytest.mark.parametrize(("goal", "looks"), [("explore", True), ("visual", False)])
def test_only_a_robot_that_searches_nothing_looks_at_the_edge_from_before_it(goal, looks, monkeypatch):
    """A target may stand in a niche, so that a search drives up to where the map ends."""
    requests, plan = [], Planner.plan

    def record(self, estimate, goal_xy, *, look=False):
        requests.append(look)
        return plan(self, estimate, goal_xy, look=look)

    monkeypatch.setattr(Planner, "plan", record)
    _run(EpisodeConfig(goal=goal, max_steps=3))
    assert requests == [looks] * len(requests)
    assert requests


def test_one_seed_gives_one_episode_bit_for_bit():
    config = EpisodeConfig(seed=4, max_steps=25)
    first, second = _run(config), _run(config)
    assert np.array_equal(first.poses, second.poses)
    assert np.array_equal(first.estimates, second.estimates)
    assert first.coverage == second.coverage
    assert not np.array_equal(first.poses[1], _run(EpisodeConfig(seed=5, max_steps=25)).poses[1])


def test_recorded_files_show_the_same_story(tmp_path):
    """Every file of a recorded episode can be read back and agrees with the result."""
    config = EpisodeConfig(goal="oracle", seed=2, simulator=KINEMATIC, max_steps=25)
    result = record_episode(two_rooms(0.8), config, tmp_path, start=START, target=TARGET)
    stored = json.loads((tmp_path / "result.json").read_text())
    assert stored["steps"] == result["steps"] == 25
    assert stored["ended"] == "out of steps"
    assert len((tmp_path / "trajectory.tum").read_text().splitlines()) == 26
    with av.open(str(tmp_path / "episode.mp4")) as video:
        assert sum(1 for _ in video.decode(video=0)) == 25
    built = read_plan(tmp_path / "map.yaml")
    assert built.resolution_m == 0.05
    assert 1 < built.free.sum() * 0.05**2 < 20
    assert (tmp_path / "map.png").stat().st_size > 10_000
    assert {path.name for path in tmp_path.iterdir()} == {
        "result.json", "trajectory.tum", "estimate.tum", "map.yaml", "map.pgm", "map.png", "episode.mp4",
        "episode.npz", "settings.json",
    }  # fmt: skip


def test_the_episode_runs_in_the_building_asked_for(tmp_path):
    """A staircase of cells is a slope of 6 cm or less next to it: 4 walls and a slope with that tolerance."""
    free = np.tri(40, 60, 10, dtype=bool)
    plan = FloorPlan(occupancy=np.where(free, FREE, OCCUPIED).astype(np.uint8), resolution_m=0.05)
    walls = {}
    for tolerance_m in (0.0, 0.06):
        config = EpisodeConfig(
            goal="oracle", simulator=KINEMATIC, max_steps=1, building=BuildingConfig(tolerance_m=tolerance_m)
        )
        result = record_episode(plan, config, tmp_path, video=False)
        assert result["config"]["building"]["tolerance_m"] == tolerance_m
        walls[tolerance_m] = result["walls"]
    assert walls[0.0] > 60
    assert walls[0.06] < 10


def test_results_do_not_depend_on_the_run(tmp_path):
    """The same command twice gives the same result.json but for `timing`."""
    config = EpisodeConfig(seed=2, max_steps=15)
    results = []
    for run in ("a", "b"):
        record_episode(two_rooms(0.8), config, tmp_path / run, video=False)
        stored = json.loads((tmp_path / run / "result.json").read_text())
        stored.pop("timing")
        results.append((stored, (tmp_path / run / "trajectory.tum").read_bytes()))
    assert results[0] == results[1]


def test_depth_noise_is_measured_but_not_judged_by():
    """The mapper gets noisy depth, coverage the true one, and motion noise is the same with and without depth noise."""
    plan = read_plan("cottage")
    building = make_building(plan)
    task = make_task(reach(building, 0.1), np.random.default_rng(0))
    views = {}
    for level in (0.0, 1.0):
        simulator = Simulator(
            building,
            SimulatorConfig(physics="kinematic", robot=RobotConfig(depth_noise=DepthNoise(level=level))),
        )
        first = simulator.reset(task, np.random.default_rng(3))
        assert not np.shares_memory(first.depth, simulator.true_depth)
        views[level] = (first, simulator.true_depth, *simulator.step(Action.LEFT))
        simulator.close()
    (clean, true, turned, _), (noisy, same, turned_too, _) = views[0.0], views[1.0]
    assert (clean.depth == true).all() and (true == same).all()
    assert (noisy.depth != true).any()
    np.testing.assert_array_equal(turned.odometry, turned_too.odometry)
