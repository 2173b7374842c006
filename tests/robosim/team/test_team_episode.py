"""Episodes of several robots."""

import json
from dataclasses import replace
from shutil import copytree
from signal import SIGTERM, raise_signal

import numpy as np
import pytest

from robosim.agent import Agent
from robosim.building.building import Building, make_building
from robosim.building.reach import Reach, reach
from robosim.entrants import Entrant, make_entrants, starts_near
from robosim.episode import run_episode, run_team
from robosim.episode_config import EpisodeConfig
from robosim.episode_log import EpisodeLog
from robosim.movers.movers import Contact, MoversConfig
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan, MapError
from robosim.recording.episode_file import read_head, robots_of_team
from robosim.robot.motion import Motion
from robosim.run import record_episode
from robosim.simulator import SimulatorConfig
from robosim.step import Step
from robosim.task.coverage import Coverage
from robosim.task.tasks import ARRIVAL_M, Task
from robosim.team.team_config import TeamConfig
from robosim.team.team_log import TeamLog
from robosim.world import World
from slam.mapping.classical import ClassicalMapper

_CONFIG = EpisodeConfig(
    goal="explore",
    explorer="gain",
    mapper="classical",
    max_steps=40,
    seed=3,
    simulator=SimulatorConfig(physics="kinematic", camera="plan"),
    team=TeamConfig(robots="2", exchange="perfect"),
)


def three_rooms() -> FloorPlan:
    """Three rooms in a row with doors of 0.9 m."""
    occupancy = np.full((84, 244), OCCUPIED, np.uint8)
    for left in (2, 82, 162):
        occupancy[2:82, left : left + 78] = FREE
    occupancy[32:50, 60:180] = FREE
    return FloorPlan(occupancy=occupancy, resolution_m=0.05, origin=(0.0, 0.0, 0.0), name="rooms")


@pytest.fixture(scope="module")
def scene() -> tuple[Building, Reach]:
    building = make_building(three_rooms())
    return building, reach(building, *_CONFIG.simulator.robot.hull_m)


def _task(start: tuple[float, float, float], target: tuple[float, float]) -> Task:
    return Task(np.array(start), np.array(target), 1.0)


_TASK = _task((6.0, 2.0, 0.0), (11.0, 1.0))


def _run(scene: tuple[Building, Reach], config: EpisodeConfig, task: Task = _TASK) -> TeamLog:
    building, places = scene
    return run_team(building, make_entrants(building, places, task, config))


def _poses(team: TeamLog) -> dict[str, np.ndarray]:
    return {name: np.array(log.poses) for name, log in team.robots.items()}


def test_team_same_seed_same_poses(scene) -> None:
    one, other = (_poses(_run(scene, _CONFIG)) for _ in range(2))
    assert all(np.array_equal(one[name], other[name]) for name in one)
    different = _poses(_run(scene, replace(_CONFIG, seed=4)))
    assert not np.array_equal(one["robot1"], different["robot1"])


def test_team_sees_more_than_each_robot(scene) -> None:
    team = _run(scene, replace(_CONFIG, team=replace(_CONFIG.team, every=1)))
    assert team.coverage[-1] > max(log.coverage[-1] for log in team.robots.values())
    # Both know what each has seen.
    known = [np.count_nonzero(estimate.explored) for estimate in team.maps.values()]
    assert min(known) > 0.9 * max(known)


def test_team_without_exchange_knows_nothing_of_the_others(scene) -> None:
    alone = replace(_CONFIG, team=TeamConfig(robots="2", exchange="none"))
    team = _run(scene, alone)
    assert sum(team.sent_bytes.values()) == 0
    seen_m2 = np.count_nonzero(team.maps["robot1"].explored) * 0.05**2
    together_m2 = team.coverage[-1] * np.count_nonzero(scene[1].floor) * 0.05**2
    assert seen_m2 < together_m2


@pytest.mark.parametrize("physics", ["kinematic", "dynamic"])
def test_team_robots_do_not_pass_through_each_other(scene, physics: str) -> None:
    simulator = replace(_CONFIG.simulator, physics=physics)
    config = replace(_CONFIG, simulator=simulator, goal="oracle", max_steps=30)
    # Both want to the same place.
    team = _run(scene, config, _task((2.0, 2.0, 0.0), (6.0, 2.0)))
    a, b = (poses[:, :2] for poses in _poses(team).values())
    n = min(len(a), len(b))
    assert np.hypot(*(a[:n] - b[:n]).T).min() > 2 * config.simulator.robot.hull.radius_m - 0.01


def test_team_ends_when_the_first_robot_arrives(scene) -> None:
    team = _run(scene, replace(_CONFIG, goal="oracle"), _task((9.0, 2.0, 0.0), (10.5, 2.0)))
    assert team.first.arrived_at is not None
    others = [log.ended for log in team.robots.values() if log is not team.first]
    assert others == ["another arrived"] or others == ["arrived"]


def test_team_that_starts_at_the_target_ends_at_once(scene) -> None:
    team = _run(scene, replace(_CONFIG, goal="oracle"), _task((9.0, 2.0, 0.0), (9.1, 2.0)))
    assert [log.ended for log in team.robots.values()] == ["arrived", "another arrived"]
    assert team.first.steps == 0


def test_team_with_places_of_another_building_is_rejected(scene) -> None:
    _, places = scene
    other = make_building(read_plan("flat"))
    with pytest.raises(ValueError, match=r"reach of robot is in 'rooms', another plan than .* 'flat'"):
        run_episode(other, places, _TASK, replace(_CONFIG, team=TeamConfig()))


def test_team_loss_after_the_last_decision_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"team\.lose is 1@40, expected a decision before max_steps = 40"):
        replace(_CONFIG, team=TeamConfig(robots="2", lose=("1@40",)))


def test_team_lost_robot_stops_and_the_others_go_on(scene) -> None:
    config = replace(_CONFIG, team=TeamConfig(robots="2", exchange="perfect", lose=("1@5",)))
    team = _run(scene, config)
    assert team.robots["robot1"].ended == "lost"
    assert team.robots["robot1"].steps == 5
    assert team.robots["robot2"].steps == config.max_steps


def test_team_of_lost_robots_ends(scene) -> None:
    config = replace(_CONFIG, team=TeamConfig(robots="2", lose=("1@5", "2@7")))
    team = _run(scene, config)
    assert [log.ended for log in team.robots.values()] == ["lost", "lost"]


def test_team_robot_stays_lost_when_the_others_have_explored_all(scene, monkeypatch) -> None:
    """The result is that of a robot that went on, not of the first one, which was lost after two steps."""
    decide, calls = Agent.decide, iter(range(100))
    monkeypatch.setattr(Agent, "decide", lambda self: decide(self) if next(calls) < 7 else None)
    config = replace(_CONFIG, team=TeamConfig(robots="2", exchange="none", lose=("1@2",)))
    team = _run(scene, config)
    assert {name: (log.ended, log.steps) for name, log in team.robots.items()} == {
        "robot1": ("lost", 2),
        "robot2": ("explored", 5),
    }
    assert (team.result()["ended"], team.result()["steps"]) == ("explored", 5)


def test_team_interrupted_leaves_the_lost_robot_lost(scene) -> None:
    def interrupt(log: EpisodeLog, step: Step) -> None:
        if log.robot == "robot2" and step.number == 3:
            raise_signal(SIGTERM)

    building, places = scene
    config = replace(_CONFIG, team=TeamConfig(robots="2", exchange="none", lose=("1@2",)))
    team = run_team(building, make_entrants(building, places, _TASK, config), interrupt)
    assert [log.ended for log in team.robots.values()] == ["lost", "terminated"]
    assert team.first.robot == "robot2"


def test_first_robot_is_the_one_that_arrived_first_also_where_none_seeks_the_target() -> None:
    """Two robots explore past a target 2 m away and back, in steps of 1 m and of 2 m; paths are whole."""
    logs = {}
    for name, step_m in (("robot1", 1.0), ("robot2", 2.0), ("robot3", -1.0)):
        xs = step_m * np.array([0, 1, 2, 1, 0])
        poses = [np.array([x, 0.0, 0.0]) for x in xs]
        task = Task(np.zeros(3), np.array([2.0, 0.0]), 1.0)
        motions = [Motion(pose=np.zeros(3), collided=False, duration_s=1.0)] * 4
        logs[name] = EpisodeLog(
            task, poses=poses, estimates=poses, motions=motions, coverage=[0.5] * 5, robot=name
        )
    team = TeamLog(logs, coverage=[0.5], overlap=[0.5])
    assert team.first.robot == "robot2"
    assert team.result()["arrived_at_step"] == 1
    assert team.result()["path_length_all_m"] == 4 + 8 + 4


def test_coverage_of_a_team_counts_what_any_of_unequal_hulls_reaches() -> None:
    """A wide robot reaches the first room only; all seen is 1 in either order, and overlap that room."""
    plan = three_rooms()
    everywhere, first_room = plan.free, plan.free.copy()
    first_room[:, 82:] = False
    coverages = [Coverage(plan, region, 1.5) for region in (first_room, everywhere)]
    for order in (coverages, coverages[::-1]):
        team = TeamLog({})
        team.add_seen(order)
        for coverage in order:
            coverage._unseen[:] = False
        team.add_seen(order)
        assert team.coverage[-1] == 1.0
        assert team.overlap[-1] == first_room.sum() / everywhere.sum()


def test_robots_are_lost_by_their_order_whatever_their_names(scene) -> None:
    building, places = scene
    config = replace(_CONFIG, max_steps=2, team=TeamConfig(robots="2", lose=("2@1",)))
    entrants = make_entrants(building, places, _TASK, config).values()
    team = run_team(building, dict(zip(("anna", "bert"), entrants, strict=True)))
    assert {name: log.ended for name, log in team.robots.items()} == {"anna": "out of steps", "bert": "lost"}
    with pytest.raises(ValueError, match="entrants is empty"):
        run_team(building, {})


def test_team_of_one_is_the_episode_of_one(scene) -> None:
    building, places = scene
    config = replace(_CONFIG, team=TeamConfig())
    log, _ = run_episode(building, places, _TASK, config)
    (other,) = _run(scene, config).robots.values()
    assert np.array_equal(log.poses, other.poses)


def test_team_robot_is_seen_and_tracked_or_reported(scene) -> None:
    building, places = scene
    seen: dict[str, int] = {}

    def look(log: EpisodeLog, step: Step) -> None:
        seen[log.robot] = max(seen.get(log.robot, 0), len(step.estimated.map.moving))
        assert len(step.true.bodies) == 1

    run_team(building, make_entrants(building, places, _TASK, _CONFIG), look)
    assert seen == {"robot1": 1, "robot2": 1}


@pytest.mark.parametrize(
    ("options", "people", "knows"),
    [
        ({}, 0, [True] * 6),
        ({}, 1, [False] * 6),
        ({"exchange": "none"}, 0, [False] * 6),
        ({"starts": "unknown"}, 0, [False] * 6),
        # It is looked for again from the second decision on without a report.
        ({"lose": ("1@2",)}, 0, [True] * 4 + [False] * 2),
    ],
)
def test_team_mapper_is_given_places_of_others_that_report_them(
    scene, monkeypatch, options, people, knows
) -> None:
    has_places: dict[int, list[bool]] = {}
    update = ClassicalMapper.update

    def look(self, *args, others=None, **inputs):
        has_places.setdefault(id(self), []).append(others is not None)
        return update(self, *args, others=others, **inputs)

    monkeypatch.setattr(ClassicalMapper, "update", look)
    simulator = replace(_CONFIG.simulator, movers=MoversConfig(people=people))
    team = replace(_CONFIG.team, **options)
    _run(scene, replace(_CONFIG, max_steps=5, simulator=simulator, team=team))
    assert list(has_places.values())[-1] == knows


@pytest.mark.parametrize("apart_m", [0.0, 0.19])
def test_run_team_rejects_robots_that_start_in_each_other(scene, apart_m: float) -> None:
    building, places = scene
    entrants = make_entrants(building, places, _TASK, _CONFIG)
    start = _TASK.start + np.array([0.0, apart_m, 0.0])
    entrants["robot2"] = entrants["robot1"]._replace(task=replace(_TASK, start=start))
    with pytest.raises(ValueError, match=f"robot2 starts {apart_m:.2f} m from robot1, expected 0.20 m"):
        run_team(building, entrants)


def test_starts_near_have_room_for_unequal_hulls(scene) -> None:
    building, places = scene
    wide = reach(building, 0.3, 0.5)
    starts = starts_near(_TASK, [places, wide, places])
    gaps = [np.hypot(*(starts[i] - starts[k])[:2]) for i, k in ((0, 1), (1, 2), (0, 2))]
    assert min(gaps[:2]) >= 0.1 + 0.3 + 0.3 and gaps[2] >= 0.5
    assert all(place.part_at(start[:2]) for place, start in zip([places, wide, places], starts, strict=True))


def test_starts_near_leave_the_place_where_a_robot_has_arrived(scene) -> None:
    _, places = scene
    second = starts_near(_TASK, [places] * 2)[1]
    starts = starts_near(replace(_TASK, target=second[:2]), [places] * 3)
    assert min(np.hypot(*(start[:2] - second[:2])) for start in starts) > ARRIVAL_M


def test_starts_near_rejects_more_robots_than_there_is_room_for(scene) -> None:
    occupancy = np.full((24, 24), OCCUPIED, np.uint8)
    occupancy[2:22, 2:22] = FREE
    plan = FloorPlan(occupancy=occupancy, resolution_m=0.05, origin=(0.0, 0.0, 0.0), name="closet")
    places = reach(make_building(plan), *_CONFIG.simulator.robot.hull_m)
    with pytest.raises(MapError, match="there is room for"):
        starts_near(replace(_TASK, start=np.array([0.6, 0.6, 0.0])), [places] * 20)


def test_record_episode_of_a_team_writes_files_of_each_robot(tmp_path) -> None:
    config = replace(_CONFIG, max_steps=8)
    result = record_episode(
        three_rooms(), config, tmp_path, start=_TASK.start, target=_TASK.target, video=True
    )
    assert result["robots"] == 2
    assert {"result.json", "map.png", "episode.mp4"} <= {path.name for path in tmp_path.iterdir()}
    for name in ("robot1", "robot2"):
        folder = tmp_path / name
        assert {"episode.npz", "map.yaml", "trajectory.tum", "estimate.tum"} <= {
            p.name for p in folder.iterdir()
        }
        row = json.loads((folder / "result.json").read_text())
        assert row["steps"] == 8 and row["robot"] == name
        assert read_head(folder / "episode.npz").row["run"] == row["run"]
    other = replace(config, team=replace(config.team, exchange="none"))
    record_episode(
        three_rooms(), other, tmp_path / "other", start=_TASK.start, target=_TASK.target, video=False
    )
    assert json.loads((tmp_path / "other" / "robot1" / "result.json").read_text())["run"] != row["run"]


def test_record_episode_replaces_robots_of_an_earlier_team(tmp_path) -> None:
    """A robot of it would be drawn and exported with those of the new one; other episodes stay."""
    for robots in ("3", "2"):
        config = replace(_CONFIG, max_steps=1, team=TeamConfig(robots=robots))
        record_episode(three_rooms(), config, tmp_path, start=_TASK.start, target=_TASK.target, video=False)
        copytree(tmp_path / "robot2", tmp_path / "robot-of-mine", dirs_exist_ok=True)
    assert robots_of_team(tmp_path) == ["robot1", "robot2"]
    assert (tmp_path / "robot-of-mine" / "episode.npz").is_file()


def test_first_robot_starts_where_its_own_hull_fits(tmp_path) -> None:
    wide = tmp_path / "wide.yaml"
    wide.write_text("radius_m: 0.8\n")
    places = reach(make_building(three_rooms()), 0.8)
    config = replace(_CONFIG, max_steps=1, team=TeamConfig(robots=f"{wide},turtlebot"))
    result = record_episode(three_rooms(), config, tmp_path, video=False)
    assert places.part_at(np.array(result["start"])[:2])


@pytest.mark.parametrize("physics", ["kinematic", "dynamic"])
def test_team_people_walk_once_for_all_robots(scene, physics: str) -> None:
    """People are the same for both robots, which track them and count contacts; one seed gives one result."""
    building, places = scene
    people = MoversConfig(people=4)
    config = replace(_CONFIG, simulator=replace(_CONFIG.simulator, physics=physics, movers=people))
    met: dict[str, list[np.ndarray]] = {"robot1": [], "robot2": []}
    tracked = []

    def look(log: EpisodeLog, step: Step) -> None:
        met[log.robot].append(np.column_stack([np.full(4, log.times()[-1]), step.true.bodies[1:, :2]]))
        tracked.append(len(step.estimated.map.moving))

    team = run_team(building, make_entrants(building, places, _TASK, config), look)
    first, second = (np.array(met[name]) for name in met)
    assert np.array_equal(first[0], second[0])
    # No robot is ahead of the other by more than an action, and people walk on between what the two see.
    apart_s = first[:, 0, 0] - second[:, 0, 0]
    assert np.abs(apart_s).max() < 2.5
    gap_m = np.hypot(*np.moveaxis(first[:, :, 1:] - second[:, :, 1:], -1, 0))
    assert (gap_m.max(axis=1) <= 2.2 * np.abs(apart_s) + 0.01).all()
    assert np.ptp(first[:, :, 1:], axis=0).max() > 1.0
    assert max(tracked) > 1
    assert all(log.contacts is not None for log in team.robots.values())
    assert {"contacts_by_robot", "contacts_by_others", "contacts_between_robots"} <= set(team.result())
    again = _run(scene, config)
    assert all(np.array_equal(_poses(team)[name], _poses(again)[name]) for name in met)


def test_team_result_separates_contacts_with_people_and_robots(scene) -> None:
    team = _run(scene, replace(_CONFIG, max_steps=1))
    for log in team.robots.values():
        log.contacts = [Contact(1.0, 0, True), Contact(2.0, 1, True), Contact(3.0, 2, False)]
    result = team.result()
    counts = [result[f"contacts_{kind}"] for kind in ("between_robots", "by_robot", "by_others")]
    assert counts == [2, 2, 2]


def test_world_rejects_robots_among_different_people(scene) -> None:
    simulators = [replace(_CONFIG.simulator, movers=MoversConfig(people=count)) for count in (1, 2)]
    with pytest.raises(ValueError, match="movers differ"):
        World(scene[0], dict(zip("ab", simulators, strict=True)))


def test_two_robots_that_meet_in_a_door_pass_each_other() -> None:
    """They swap rooms through a door of 0.9 m: neither waits forever for the other next to it."""
    occupancy = np.full((84, 128), OCCUPIED, np.uint8)
    occupancy[2:82, 2:62] = occupancy[2:82, 66:126] = FREE
    occupancy[33:51, 60:68] = FREE
    building = make_building(
        FloorPlan(occupancy=occupancy, resolution_m=0.05, origin=(0.0, 0.0, 0.0), name="door")
    )
    config = replace(_CONFIG, goal="oracle", max_steps=60, seed=1)
    places = reach(building, *config.simulator.robot.hull_m)
    right, left = _task((1.6, 2.1, 0.0), (5.9, 2.1)), _task((4.7, 2.1, np.pi), (0.5, 2.1))
    team = run_team(
        building, {"robot1": Entrant(right, config, places), "robot2": Entrant(left, config, places)}
    )
    assert team.result()["arrived"] and team.result()["contacts_between_robots"] == 0
    xs = {name: log.poses[-1][0] for name, log in team.robots.items()}
    assert xs["robot1"] > 3.2 > xs["robot2"]
