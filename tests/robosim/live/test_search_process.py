"""Searches in processes of their own."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.entrants import make_entrants
from robosim.episode import run_episode, run_team
from robosim.episode_config import EpisodeConfig
from robosim.live.search_process import MANUAL, RUN, WAIT, SearchJob, SearchProcess
from robosim.task.tasks import make_task
from robosim.team.team_config import TeamConfig
from slam.actions import Action
from tests.plans import two_rooms
from tests.robosim.live.conftest import START, TARGET

LONG_S = 120.0


@pytest.fixture
def search(quick) -> Iterator[Callable]:
    """Starts searches, and ends them with the test."""
    started = []

    def start(mode: int, start: np.ndarray = START, config: EpisodeConfig = quick) -> SearchProcess:
        job = SearchJob(plan=two_rooms(0.8), config=config, start=start, target=TARGET)
        started.append(SearchProcess("test", job, lambda one: None, mode))
        return started[-1]

    yield start
    for one in started:
        one.close()
        assert not one.is_alive


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + LONG_S
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.01)


def decisions(one: SearchProcess) -> int:
    return 0 if one.recording is None else len(one.recording)


def test_a_search_is_the_episode_without_a_page(search, quick):
    """Its poses equal those of `run_episode` for the same task and seed."""
    one = search(RUN)
    wait_for(lambda: not one.is_alive)
    assert one.error == ""
    building = make_building(two_rooms(0.8), config=quick.building)
    places = reach(building, *quick.simulator.robot.hull_m)
    task = make_task(places, np.random.default_rng([quick.seed, 0]), start=START, target=TARGET)
    log, _ = run_episode(building, places, task, quick)
    assert one.recording.ended.startswith(log.ended)
    shown = np.array([one.recording[i].true.pose for i in range(len(one.recording))])
    assert np.array_equal(shown, np.array(log.poses[: len(shown)]))
    assert len(shown) == log.steps


def test_a_search_of_a_team_makes_steps_of_all_robots(search, quick):
    """A single step is one of each robot; the poses are those of `run_team`."""
    config = replace(quick, max_steps=5, team=TeamConfig(robots="2"))
    process = search(WAIT, config=config)
    wait_for(lambda: decisions(process) == 1)
    process.step()
    wait_for(lambda: decisions(process) == 2)
    time.sleep(0.3)
    assert [len(robot) for robot in process.recording.robots] == [2, 1]
    process.set_mode(RUN)
    wait_for(lambda: not process.is_alive)
    assert process.error == ""
    building = make_building(two_rooms(0.8), config=config.building)
    places = reach(building, *config.simulator.robot.hull_m)
    task = make_task(places, np.random.default_rng([config.seed, 0]), start=START, target=TARGET)
    team = run_team(building, make_entrants(building, places, task, config))
    for robot in process.recording.robots:
        shown = np.array([robot[i].true.pose for i in range(len(robot))])
        assert np.array_equal(shown, np.array(team.robots[robot.robot].poses[:5]))
        assert f"{team.robots[robot.robot].path_length_m:.1f} m" in robot.ended


def test_a_waiting_search_makes_single_steps(search):
    one = search(WAIT)
    wait_for(lambda: decisions(one) == 1)
    time.sleep(0.3)
    assert decisions(one) == 1
    one.step()
    wait_for(lambda: decisions(one) == 2)
    one.set_mode(RUN)
    wait_for(lambda: not one.is_alive)
    assert one.recording.ended


def test_a_person_can_drive(search):
    """Two turns to the left and one step forward, and nothing else."""
    one = search(MANUAL)
    for k, action in enumerate((Action.LEFT, Action.LEFT, Action.FORWARD)):
        wait_for(lambda k=k: decisions(one) == k + 1)
        one.press(action)
    wait_for(lambda: decisions(one) == 4)
    poses = np.array([one.recording[i].true.pose for i in range(4)])
    turned = np.degrees(np.diff(poses[:, 2]))
    assert (turned[:2] > 5).all(), "each turn is some 10 degrees"
    assert np.hypot(*(poses[3] - poses[2])[:2]) > 0.15, "a step forward is some 0.25 m"


def test_an_error_is_reported(search):
    """A start inside a wall gives the message of the command and ends the process."""
    one = search(RUN, start=np.array([3.1, 0.5, 0.0]))
    wait_for(lambda: not one.is_alive)
    assert "does not fit at the start (3.1, 0.5) m" in one.error
    assert one.recording is None


def test_a_killed_search_reports_it_and_keeps_its_steps(search):
    one = search(WAIT)
    wait_for(lambda: decisions(one) == 1)
    one._process.kill()
    wait_for(lambda: not one.is_alive)
    assert one.error == "the process of the search was killed"
    assert len(one.recording) == 1 and one.recording.ended
