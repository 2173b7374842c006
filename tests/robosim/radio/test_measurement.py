"""Bearings from a radio, compared with the geometry of halls and corridors."""

import math
from dataclasses import replace

import numpy as np
import pytest

from robosim.building.building import Building, make_building
from robosim.building.reach import reach
from robosim.camera.depth_noise import DepthNoise
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.radio.link import RadioLink
from robosim.radio.measurement import Interpreter, bearings_of
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.task.tasks import make_task
from slam.mapping.classical import ClassicalMapper, MapperConfig
from slam.poses import wrap
from slam.robot import Robot
from slam.sensing.bearings import Bearing

NAME = "here"


def _room(wide_m: float, high_m: float) -> Building:
    """A bare room with a corner at 0.25 m, 0.25 m."""
    free = np.ones((round(high_m / 0.05), round(wide_m / 0.05)), bool)
    cells = np.where(np.pad(free, 5), FREE, OCCUPIED).astype(np.uint8)
    return make_building(FloorPlan(occupancy=cells, resolution_m=0.05))


def _bearings(
    building: Building, place: np.ndarray, pose: np.ndarray, seed: int = 0, **known
) -> list[Bearing]:
    link = RadioLink(building)
    link.place(place)
    interpreter = Interpreter(link, "generated")
    measured = link.measure(pose, np.random.default_rng(seed))
    # The robot takes its heading to be another than it is: bearings are in its own frame all the same.
    believed = pose + np.array([0.3, 0.0, 0.7])
    return bearings_of({NAME: interpreter.interpret(measured, believed)}, link.config, known)


def test_a_transmitter_in_sight_appears_where_it_stands() -> None:
    """In a bare room: the first bearing within half a degree, the distance within 5 %."""
    building, place = _room(12, 10), np.array([7.0, 6.0])
    for seed, pose in enumerate(np.array([[3.0, 3.0, 1.0], [9.0, 4.0, -2.0], [6.0, 8.5, 0.0]])):
        first = _bearings(building, place, pose, seed)[0]
        away = place - pose[:2]
        off = wrap(first.bearing_rad + pose[2] - math.atan2(away[1], away[0]))
        assert abs(off) < math.radians(0.5)
        assert first.range_m == pytest.approx(np.hypot(*away), rel=0.05)
        assert (first.source, first.beyond_m, first.place_xy) == (NAME, None, None)


def test_further_paths_come_from_mirror_images() -> None:
    """Each lies within 2 degrees and 0.1 m of the mirror image in a wall or of one of those in two."""
    building, place, pose = _room(12, 10), np.array([7.0, 8.5]), np.array([4.0, 8.5, 0.5])
    _, *others = _bearings(building, place, pose)
    assert others
    sides = [
        (2 * 0.25 - place[0], place[0], 2 * 12.25 - place[0]),
        (0.5 - place[1], place[1], 20.5 - place[1]),
    ]
    images = np.array([(x, y) for x in sides[0] for y in sides[1]])
    away = images - pose[:2]
    beyond = np.hypot(*away.T) - np.hypot(*(place - pose[:2]))
    for one in others:
        turn = np.arctan2(away[:, 1], away[:, 0]) - pose[2] - one.bearing_rad
        turn = np.abs((turn + math.pi) % (2 * math.pi) - math.pi)
        assert ((turn < math.radians(2)) & (np.abs(beyond - one.beyond_m) < 0.1)).any()
        assert one.direct == 0


def test_close_paths_are_less_sure() -> None:
    """Far along a narrow corridor, where reflections off both walls come with the direct path."""
    place = np.array([38.0, 1.4])
    narrow = _bearings(_room(40, 2.2), place, np.array([8.0, 1.5, 0.2]))
    wide = _bearings(_room(40, 30), np.array([38.0, 15.0]), np.array([8.0, 15.5, 0.2]))
    assert narrow[0].sigma_rad > 2 * wide[0].sigma_rad
    assert narrow[0].sigma_log_range > 2 * wide[0].sigma_log_range


def test_directions_are_as_exact_as_strengths_down_a_corridor() -> None:
    """Paths off its walls pull both: within 2 % of free space, half of all directions are within 0.1 degrees.

    Where strengths are off by more than a tenth, half of them are off by more than 0.3 degrees.
    """
    building, place = _room(40, 2.4), np.array([20.0, 0.5])
    link = RadioLink(building)
    link.place(place)
    interpreter, rng = Interpreter(link, "generated"), np.random.default_rng(3)
    found = []
    for _ in range(80):
        pose = np.array([rng.uniform(5.0, 17.0), rng.uniform(0.6, 2.3), rng.uniform(-3, 3)])
        first = bearings_of({NAME: interpreter.interpret(link.measure(pose, rng), pose)}, link.config, {})[0]
        away = place - pose[:2]
        turn = abs(wrap(first.bearing_rad + pose[2] - math.atan2(away[1], away[0])))
        found.append((abs(math.log(first.range_m / np.hypot(*away))), math.degrees(turn)))
    off, turn_deg = np.array(found).T
    assert min((off < 0.02).sum(), (off > 0.1).sum()) > 10
    assert np.median(turn_deg[off < 0.02]) < 0.1
    assert np.median(turn_deg[off > 0.1]) > 0.3


def test_a_known_place_is_given() -> None:
    """With the bearing; other names' places are not."""
    building, place, pose = _room(12, 10), np.array([7.0, 6.0]), np.array([3.0, 3.0, 1.0])
    assert np.array_equal(_bearings(building, place, pose, here=place)[0].place_xy, place)
    assert _bearings(building, place, pose, there=place)[0].place_xy is None


def test_what_is_no_number_says_nothing() -> None:
    """Of anybody's estimators: paths without a direction, power or delay are left out, probabilities over 1 are 1."""
    building, place, pose = _room(12, 10), np.array([7.0, 8.5]), np.array([4.0, 8.5, 0.5])
    link = RadioLink(building)
    link.place(place)
    interpreter = Interpreter(link, "generated")
    whole = interpreter.interpret(link.measure(pose, np.random.default_rng(0)), pose)
    odd = replace(
        whole, probability=np.array([0.0, 1.0 + 1e-6, 0.0, 0.0]), delay_s=np.full_like(whole.delay_s, np.nan)
    )
    assert [one.direct for one in bearings_of({NAME: odd}, link.config, {})] == [1.0]
    for name in ("aoa_rad", "gain_db"):
        odd = replace(whole, **{name: np.full_like(whole.aoa_rad, np.nan)})
        assert bearings_of({NAME: odd}, link.config, {}) == []
    assert bearings_of({NAME: replace(whole, snr_db=whole.snr_db - 200)}, link.config, {}) == []


def test_a_search_ends_knowing_where_the_transmitter_stands() -> None:
    """Sixty decisions towards it in a bare room: within four standard deviations and 0.3 m of the truth."""
    mappers = []

    def noted(robot: Robot, config: MapperConfig) -> ClassicalMapper:
        mappers.append(ClassicalMapper(robot, config))
        return mappers[-1]

    building = _room(12, 10)
    places = reach(building, 0.1)
    task = make_task(
        places, np.random.default_rng(0), start=np.array([2.0, 2.0, 0.5]), target=np.array([10.0, 8.0])
    )
    simulator = SimulatorConfig(
        physics="kinematic", camera="embree", robot=RobotConfig(depth_noise=DepthNoise(level=1.0))
    )
    config = EpisodeConfig(
        goal="snr", mapper=noted, explorer="gain", max_steps=60, seed=1, simulator=simulator
    )
    run_episode(building, places, task, config)
    found = mappers[-1].transmitters()["target"]
    off = found.xy - task.target
    assert np.hypot(*off) < 0.3
    assert off @ np.linalg.solve(found.covariance, off) < 16
