"""Frames of robots that do not know each other's starts."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from robosim.agent import make_agent
from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.entrants import Entrant, make_entrants
from robosim.episode import run_team
from robosim.episode_config import EpisodeConfig
from robosim.plans.files import read_plan
from robosim.simulator import SimulatorConfig
from robosim.task.tasks import make_task
from robosim.team.frames import Frames, Seen
from robosim.team.shared_map import SharedMap, Tile
from robosim.team.team_config import TeamConfig
from robosim.team.team_log import TeamLog
from robosim.world import World
from slam.graph.tracked_map import TrackedMap
from slam.grid import GridFrame, MapEstimate
from slam.hull import Hull
from slam.poses import between, compose, to_map

#: True starts, in one frame.
_STARTS = {"a": np.array([0.0, 0.0, 0.5]), "b": np.array([3.0, 1.0, -2.0]), "c": np.array([-2.0, 2.0, 1.0])}


def _meet(frames: Frames, one: str, two: str, decision: int, rng: np.random.Generator) -> None:
    """Two robots at random places see each other."""
    poses = {name: rng.uniform(-3, 3, 3) for name in (one, two)}
    for name, other in ((one, two), (two, one)):
        there = between(poses[name], poses[other])
        seen = Seen(
            pose=between(_STARTS[name], poses[name]),
            bearing_rad=math.atan2(there[1], there[0]),
            sigma_rad=0.01,
            range_m=math.hypot(*there[:2]),
            sigma_m=0.05,
        )
        frames.add(name, decision, {other: seen})


def test_frames_of_robots_that_were_never_in_sight_are_known_through_others() -> None:
    frames, rng = Frames("a"), np.random.default_rng(0)
    for decision in range(6):
        _meet(frames, "b", "c", decision, rng)
    frames.update()
    assert not frames.known  # nothing connects them with this robot
    for decision in range(6):
        _meet(frames, "a", "b", decision, rng)
    assert frames.update()
    for name in "bc":
        assert frames.known[name].pose == pytest.approx(between(_STARTS["a"], _STARTS[name]), abs=1e-5)
    assert np.trace(frames.known["c"].covariance) > np.trace(frames.known["b"].covariance)
    assert not frames.update()


def test_sight_of_one_robot_alone_is_no_encounter() -> None:
    frames, rng = Frames("a"), np.random.default_rng(0)
    for decision in range(6):
        pose = rng.uniform(-3, 3, 3)
        seen = Seen(pose=pose, bearing_rad=0.1, sigma_rad=0.01, range_m=2.0, sigma_m=0.05)
        frames.add("a", decision, {"b": seen})
    assert not frames.update()


def test_turned_tile_lies_where_its_frame_does() -> None:
    shape = (200, 200)
    estimate = MapEstimate(
        frame=GridFrame(origin_xy=(-5.0, -5.0), resolution_m=0.05, shape=shape),
        obstacle_probability=np.full(shape, 0.5, np.float32),
        explored=np.zeros(shape, bool),
        blocked=np.zeros(shape, bool),
        pose=np.zeros(3),
    )
    codes = np.full((64, 64), 128, np.uint8)
    codes[20:24, 40:44] = 128 + 126  # a pillar
    at = np.array([0.3, -0.7, 0.6])
    shared = SharedMap(Hull(0.1))
    shared.add("b", Tile((0.0, 0.0), codes).transformed(at), estimate)
    merged = shared.merge(estimate)
    obstacles = merged.frame.centres(np.asarray(merged.obstacle_probability) > 0.9)
    assert obstacles.mean(axis=0) == pytest.approx(to_map(at, np.array([2.1, 1.1])), abs=0.02)
    assert np.count_nonzero(merged.explored) == pytest.approx(64 * 64, rel=0.01)
    shared.remove("b")
    assert not shared.merge(estimate).explored.any()


def _config(starts: str, exchange: str, max_steps: int) -> EpisodeConfig:
    return EpisodeConfig(
        goal="explore",
        explorer="nearest",
        mapper="classical",
        max_steps=max_steps,
        simulator=SimulatorConfig(physics="kinematic", camera="plan"),
        team=TeamConfig(robots="2", starts=starts, exchange=exchange),
    )


def _run(starts: str, exchange: str = "radio") -> TeamLog:
    config = _config(starts, exchange, max_steps=60)
    building = make_building(read_plan("flat"))
    places = reach(building, *config.simulator.robot.hull_m)
    entrants = make_entrants(building, places, make_task(places, np.random.default_rng(0)), config)
    # Headings that differ, so that their frames do.
    second = entrants["robot2"]
    turned = replace(second.task, start=compose(second.task.start, np.array([0.0, 0.0, 1.0])))
    return run_team(building, {**entrants, "robot2": second._replace(task=turned)})


@pytest.mark.parametrize("exchange", ["radio", "perfect"])
def test_robots_that_meet_merge_their_maps(exchange: str) -> None:
    team = _run("unknown", exchange)
    errors = team.frame_errors()
    assert len(errors) == 2
    assert np.hypot(*errors[:, :2].T).max() < 0.1
    assert np.degrees(np.abs(errors[:, 2])).max() < 1.0
    result = team.result()
    assert result["frames_known"] == 1.0
    assert result["frame_error_m"] < 0.1
    one, other = team.maps.values()
    known = [np.count_nonzero(estimate.explored) for estimate in (one, other)]
    assert min(known) > 0.8 * max(known)
    # Each map is placed by the true start of its robot, and what the other has reported lies on walls, too.
    plan = read_plan("flat")
    walls = cv2.dilate((~plan.free).astype(np.uint8), np.ones((5, 5)))
    for estimate in (one, other):
        points = estimate.frame.centres(np.asarray(estimate.obstacle_probability) > 0.6)
        ix, iy = np.floor((points - plan.origin[:2]) / plan.resolution_m).astype(int).T
        assert walls[iy, ix].mean() > 0.96


def test_maps_stay_apart_without_exchange() -> None:
    team = _run("unknown", "none")
    assert team.result()["frames_known"] == 0.0
    assert all(not estimate.claims for estimate in team.maps.values())


@pytest.mark.parametrize("plan", ["flat", "office"])
def test_robots_that_never_meet_match_their_maps(plan: str) -> None:
    """From different rooms, with a radio that receives nothing; all notes arrive."""
    config = _config("unknown", "perfect", max_steps=320)
    radio = config.simulator.radio
    radio = replace(radio, sounding=replace(radio.sounding, tx_power_dbm=-100.0))
    config = replace(config, simulator=replace(config.simulator, radio=radio))
    building = make_building(read_plan(plan))
    places = reach(building, *config.simulator.robot.hull_m)
    task = make_task(places, np.random.default_rng(3))
    travel_m = places.travel_m(task.start[:2])
    starts = places.plan.centres((travel_m > 4.0) & (travel_m < 6.0) & places.roomy)
    line = np.linspace(task.start[:2], starts[0], 50)
    assert not building.plan.free[tuple(np.floor(building.plan.to_cells(line)).astype(int).T[::-1])].all()
    other = replace(task, start=np.array([*starts[0], 2.0]))
    team = run_team(building, {"a": Entrant(task, config, places), "b": Entrant(other, config, places)})
    errors = team.frame_errors()
    assert len(errors) == 2
    assert np.hypot(*errors[:, :2].T).max() < 0.1
    assert np.degrees(np.abs(errors[:, 2])).max() < 1.0
    known = [np.count_nonzero(estimate.explored) for estimate in team.maps.values()]
    assert min(known) > 0.8 * max(known)


def test_maps_of_different_buildings_stay_apart() -> None:
    """Rooms of equal size alone do not place one map on the other."""
    frames = Frames("a")
    maps = [_tracked(plan) for plan in ("flat", "cottage")]
    frames.match("b", *maps)
    assert not frames.update()


def _tracked(plan: str) -> TrackedMap:
    """The map of a robot that has explored for a while."""
    config = EpisodeConfig(goal="explore", explorer="nearest", mapper="classical")
    config = replace(config, simulator=SimulatorConfig(physics="kinematic", camera="plan"))
    building = make_building(read_plan(plan))
    places = reach(building, *config.simulator.robot.hull_m)
    task = make_task(places, np.random.default_rng(0))
    world, agent = World(building, {"a": config.simulator}), make_agent(config, task)
    agent.reset(task.start)
    sensed = world.reset({"a": task}, np.random.default_rng(0))
    for _ in range(150):
        decision = agent.act(sensed["a"])
        assert decision is not None
        sensed = world.step({"a": decision.command})
    world.close()
    tracked = agent.mapper.tracked_map()
    assert tracked is not None
    return tracked
