"""Robots that are sold: how exactly they drive, whether they arrive, and through how narrow doors.

Drives are compared with closed forms. In the doors there are two rooms of 4 m by 3.5 m, joined by one door in a wall of
0.1 m or 0.2 m, and tasks from one room to the other. The oracle knows where the target is, but not the building.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from tyro.conf import OmitArgPrefixes

from robosim.building.building import Building, make_building
from robosim.building.reach import Reach, reach
from robosim.camera.model import CameraConfig
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.lidar import LidarConfig
from robosim.parts import ROBOT
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.robot.calibration import open_floor
from robosim.robot.dynamic import World
from robosim.robot.robots import RobotConfig
from robosim.task.tasks import Task, make_task
from slam.poses import between
from tests.benchmarks.harness import DEFAULT, Options, plans_of, run_units
from tests.benchmarks.results import Results

ROBOTS = ("turtlebot3_burger", "turtlebot3_waffle", "turtlebot4", "create3", "jackal", "locobot")
#: Robots of the doors by row: name, lidar in place of the robot's own, and width of the door beyond the hull [m].
DOORS = {
    "jackal, RPLIDAR A1": ("jackal", "rplidar-a1", 0.04),
    "jackal, RGB-D camera": ("jackal", "none", 0.04),
    "jackal, UST-10LX": ("jackal", "ust-10lx", 0.12),
    "turtlebot3_waffle": ("turtlebot3_waffle", "lds-01", 0.04),
    "turtlebot3_burger": ("turtlebot3_burger", "lds-01", 0.04),
}
_CELL_M = 0.01


def main(
    plans: Sequence[str] = ("flat", "office"),
    *,
    tasks: int = 20,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Robots that are sold: errors of drives, tasks in buildings, and doors hardly wider than rectangular hulls.

    Args:
        plans: Floor plans.
        tasks: Tasks for each robot in each plan, and for each door.
        options: Of every benchmark.
    """
    results = Results()
    for name in ROBOTS:
        _drive(results, name)
    units: dict[str, tuple[object, ...]] = {}
    for name in ROBOTS:
        units |= {f"{name}, {plan}": (name, plan, tasks, options.seed) for plan in plans}
    found = run_units(_search, units, options.folder("robots"), workers=options.workers)
    for name in ROBOTS:
        _add(results, "tasks", name, [row for plan in plans for row in found[f"{name}, {plan}"]])
    doors = {
        f"{row}, {wall_m}": (*door, wall_m, tasks, options.seed)
        for row, door in DOORS.items()
        for wall_m in (0.1, 0.2)
    }
    passed = run_units(_pass_door, doors, options.folder("robots"), workers=options.workers)
    for row, (name, _, wider_m) in DOORS.items():
        hull_m = 2 * ROBOT.make(name).hull.radius_m
        results.add("doors", row, "hull", 100 * hull_m, "cm", digits=1)
        results.add("doors", row, "door", 100 * _CELL_M * _door_cells(hull_m + wider_m), "cm", digits=1)
        _add(results, "doors", row, passed[f"{row}, 0.1"] + passed[f"{row}, 0.2"])
    return options.finish("robots", results)


def _drive(results: Results, name: str) -> None:
    """Errors of a metre ahead, a quarter turn, and an arc of 1.5 s at 0.12 m/s and 0.25 rad/s."""
    world = World(open_floor(), robot=ROBOT.make(name))
    start = np.array([2.0, 2.0, 0.3])
    for what, wanted in (("1 m ahead", (1.0, 0.0, 0.0)), ("90° turn", (0.0, 0.0, np.pi / 2))):
        world.reset(start)
        world.move(np.array(wanted))
        off = np.abs(between(start, world.pose) - wanted)
        results.add("drives", name, f"{what}, place", 1000 * float(np.hypot(*off[:2])), "mm", digits=2)
        results.add("drives", name, f"{what}, heading", float(np.degrees(off[2])), "°", digits=3)
    v, turn = 0.12, 0.25 * 1.5
    world.reset(start)
    world.drive(v, 0.25, 1.0)
    begin = world.pose
    world.drive(v, 0.25, 1.5)
    circle = v / 0.25 * np.array([np.sin(turn), 1 - np.cos(turn)])
    off_m = float(np.hypot(*(between(begin, world.pose)[:2] - circle)))
    results.add("drives", name, "arc, place", 1000 * off_m, "mm", digits=2)


def _search(name: str, plan: str, tasks: int, seed: int) -> list[dict[str, float]]:
    """Results of tasks in a plan."""
    robot = ROBOT.make(name)
    building = make_building(plans_of([plan])[0])
    places = reach(building, *robot.hull_m)
    made = [make_task(places, np.random.default_rng([seed, number, 0])) for number in range(tasks)]
    return _run(robot, building, places, made, seed)


def _pass_door(
    name: str, lidar: str, wider_m: float, wall_m: float, tasks: int, seed: int
) -> list[dict[str, float]]:
    """Results of tasks through a door."""
    robot: RobotConfig = ROBOT.make(name)
    if lidar == "none":
        robot = replace(
            robot, camera=CameraConfig(), lidar="none", laser=LidarConfig(), mast_m=RobotConfig.mast_m
        )
    elif robot.lidar != "none":
        robot = replace(robot, lidar=lidar)
    building = make_building(_rooms(2 * robot.hull.radius_m + wider_m, wall_m))
    places = reach(building, *robot.hull_m)
    made = []
    for number in range(tasks):
        rng = np.random.default_rng([seed, number])
        ends = rng.uniform((0.8, 0.8), (2.8, 3.2)), rng.uniform((4.5, 0.8), (6.3, 3.2))
        start, target = ends if number % 2 else ends[::-1]
        pose = np.array([*start, rng.uniform(-np.pi, np.pi)])
        made.append(make_task(places, rng, start=pose, target=target))
    return _run(robot, building, places, made, seed)


def _run(
    robot: RobotConfig, building: Building, places: Reach, tasks: Sequence[Task], seed: int
) -> list[dict[str, float]]:
    rows = []
    for number, task in enumerate(tasks):
        config = EpisodeConfig(goal="oracle", seed=seed + number, max_steps=1000).of_robot(robot)
        log, _ = run_episode(building, places, task, config)
        row = log.result()
        rows.append({key: float(row[key]) for key in ("spl", "steps", "collisions", "path_length_m")})
        rows[-1]["arrived"] = float(log.arrived)
    return rows


def _rooms(door_m: float, wall_m: float) -> FloorPlan:
    """Two rooms of 3.5 m by 4 m with a door between them."""
    n, wall, door = round(4 / _CELL_M), round(wall_m / _CELL_M), _door_cells(door_m)
    occupancy = np.full((n, round(7 / _CELL_M)), FREE, np.uint8)
    middle = occupancy.shape[1] // 2
    occupancy[:, middle : middle + wall] = OCCUPIED
    low = round(1.2 / _CELL_M)
    occupancy[low : low + door, middle : middle + wall] = FREE
    return FloorPlan(occupancy=occupancy, resolution_m=_CELL_M, name="rooms with a door")


def _door_cells(door_m: float) -> int:
    """Width of a door that is at least as wide [cells]."""
    return math.ceil(door_m / _CELL_M - 1e-6)


def _add(results: Results, table: str, row: str, found: Sequence[dict[str, float]]) -> None:
    values = {name: np.array([one[name] for one in found]) for name in found[0]}
    km = values["path_length_m"].sum() / 1000
    for name, value, unit, digits in (
        ("arrived", 100 * values["arrived"].mean(), "%", 0),
        ("SPL", values["spl"].mean(), "", 2),
        ("steps, median", np.median(values["steps"]), "", 0),
        ("contacts", values["collisions"].sum() / km, "per km", 0),
    ):
        results.add(table, row, name, float(value), unit, digits=digits, cases=len(found))
