"""Driving: error of a motion against speed, over time steps of the physics and against the kinematic twin.

In each building each engine gets the same random walk: noisy steps and turns of the published LoCoBot kind, from the
same places. The error of a motion is the difference between the commanded and the driven displacement, for motions
that begin too far from walls to meet one. How deep walls were entered is judged by the physics' contacts at each
step, and at the end of each motion by the hull's distance from the building's outline, which physics does not know.
"""

from time import process_time

import numpy as np
import shapely
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import Building, make_building
from robosim.robot.dynamic import PhysicsConfig, World
from robosim.robot.kinematic import KinematicWorld
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from slam.actions import Action
from slam.poses import between
from tests.benchmarks.harness import DEFAULT, Options, free_places, plans_of, quartiles
from tests.benchmarks.results import Results

#: Time steps compared [s].
TIMESTEPS_S = (0.001, 0.002, 0.005, 0.01)
#: Moves of a leg, each leg from a new place, and shares of steps forward and of turns left and right.
LEG, SHARES = 20, (0.6, 0.2, 0.2)
#: Walls farther away than this cannot be met in one move [m].
OPEN_M = 0.3


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    legs: int = 15,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Driving: error of a motion and moves a second, over time steps of the physics and against kinematic motion.

    Args:
        plans: Floor plans to drive in.
        legs: Random walks of 20 moves in each.
        options: Of every benchmark.
    """
    results = Results()
    for plan in plans_of(plans):
        building = make_building(plan)
        for timestep_s in TIMESTEPS_S:
            world = World(building, robot=RobotConfig(), config=PhysicsConfig(timestep_s=timestep_s))
            drive(
                building, f"{plan.name}, MuJoCo {1e3 * timestep_s:g} ms", world, legs, options.seed, results
            )
        twin = KinematicWorld(building, robot=RobotConfig())
        drive(building, f"{plan.name}, kinematic", twin, legs, options.seed, results)
    return options.finish("physics", results)


def drive(
    building: Building, row: str, world: World | KinematicWorld, legs: int, seed: int, results: Results
) -> None:
    """Measure one engine in one building."""
    rng, noise, radius_m = np.random.default_rng(seed), NoiseModel(), world.robot.hull.radius_m
    outline = building.free.boundary
    shapely.prepare(outline)
    errors, rates, inside_m, contacts_m, steps, collided = [], [], [0.0], 0.0, 0, 0
    for place in free_places(building.free.buffer(-radius_m), legs, rng):
        world.reset(np.array([*place, rng.uniform(-np.pi, np.pi)]))
        seconds = 0.0
        for action in map(Action, rng.choice(3, LEG, p=SHARES).tolist()):
            wanted, before = noise.actuation(action, rng), world.pose
            begin = process_time()
            motion = world.move(wanted)
            seconds += process_time() - begin
            steps, collided = steps + motion.physics_steps, collided + motion.collided
            contacts_m = max(contacts_m, motion.penetration_m)
            inside_m.append(radius_m - shapely.distance(shapely.Point(motion.pose[:2]), outline))
            if shapely.distance(shapely.Point(before[:2]), outline) > radius_m + OPEN_M:
                errors.append(between(before, motion.pose) - wanted)
        rates.append(LEG / max(seconds, 1e-9))
    off = np.array(errors).reshape(-1, 3)
    middle, spread = quartiles(rates)
    results.add("driving", row, "moves a CPU second", middle, digits=0, spread=spread, cases=legs * LEG)
    results.add("driving", row, "physics steps of a move", steps / (legs * LEG), digits=0)
    rms_m, rms_rad = np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1))), np.sqrt(np.mean(off[:, 2] ** 2))
    results.add("driving", row, "error of a motion", 1e3 * rms_m, "mm", digits=3, cases=len(off))
    results.add("driving", row, "error of a turn", np.degrees(rms_rad), "°", digits=4)
    results.add("driving", row, "moves that collide", collided)
    results.add("driving", row, "deepest in a wall, by contacts", 1e3 * contacts_m, "mm", digits=2)
    results.add("driving", row, "by the outline", 1e3 * max(inside_m), "mm", digits=2)
