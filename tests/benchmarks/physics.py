"""Driving: speed against motion error, over time steps and against the kinematic twin.

In each building each engine gets the same random walk: noisy steps and turns of the published LoCoBot
kind, from the same places, until each leg of it is over. A motion's error is the distance and angle
between where it was sent and where it ended, over motions begun too far from walls to meet one. How deep
walls were entered is judged twice: by physics' own contacts at each step, and at the end of each motion
by the hull's distance from the building's outline, which physics knows nothing of. Rates are medians over
legs, so that a busy machine disturbs them less.
"""

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import shapely
from rich.table import Table
from rich.text import Text

from robosim.building.building import Building
from robosim.robot.dynamic import PhysicsConfig, World
from robosim.robot.kinematic import KinematicWorld
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from robosim.support.figures import save_figure
from robosim.support.files import write_json
from slam.actions import Action
from slam.poses import between

#: Time steps compared [s].
TIMESTEPS_S = (0.001, 0.002, 0.005, 0.01)
#: Moves of a leg, each leg from a new place.
LEG = 20
#: Shares of steps forward, and of turns left and right.
SHARES = (0.6, 0.2, 0.2)
#: Walls further away than this cannot be met in one move [m].
OPEN_M = 0.3
#: Error below which a motion counts as exact in the plot [m]: rounding only.
EXACT_M = 1e-6


def run(
    buildings: Sequence[Building],
    *,
    out: Path,
    legs: int = 15,
    seed: int = 0,
    robot: RobotConfig | None = None,
) -> Table:
    """Drive in buildings with all engines; write `physics.json` and `physics.png`, and return the table.

    Args:
        buildings: Where to drive.
        out: Folder for the files.
        legs: Random walks of `LEG` moves in each building, the same for each engine.
        seed: Seed of places and moves.
        robot: The robot; by default a small one.
    """
    robot = robot or RobotConfig()
    rows = []
    for building in buildings:
        for timestep_s in TIMESTEPS_S:
            world = World(building, robot=robot, config=PhysicsConfig(timestep_s=timestep_s))
            name = f"MuJoCo {1e3 * timestep_s:g} ms"
            rows.append(_row(building, name, world, legs, seed) | {"walls": world.model.ngeom})
        for slide in (False, True):
            name = "kinematic, sliding" if slide else "kinematic"
            twin = KinematicWorld(building, robot=robot, slide=slide)
            rows.append(_row(building, name, twin, legs, seed))
    write_json(Path(out) / "physics.json", {"seed": seed, "legs": legs, "moves_per_leg": LEG, "rows": rows})
    _plot(rows, Path(out) / "physics.png")
    return _table(rows)


def _row(
    building: Building, name: str, world: World | KinematicWorld, legs: int, seed: int
) -> dict[str, Any]:
    """Measurements of one engine in one building."""
    rng, noise, radius_m = np.random.default_rng(seed), NoiseModel(), world.robot.radius_m
    outline, places = building.free.boundary, building.free.buffer(-radius_m)
    shapely.prepare(outline)
    errors, rates, step_rates, inside_m = [], [], [], []
    collided, own_m, steps = 0, 0.0, 0
    for _ in range(legs):
        world.reset(_place(places, rng))
        leg_s, leg_steps = 0.0, 0
        for action in map(Action, rng.choice(3, LEG, p=SHARES).tolist()):
            wanted, before = noise.actuation(action, rng), world.pose
            begin = perf_counter()
            motion = world.move(wanted)
            leg_s += perf_counter() - begin
            leg_steps += motion.physics_steps
            collided += motion.collided
            own_m = max(own_m, motion.penetration_m)
            inside_m.append(radius_m - shapely.distance(shapely.Point(motion.pose[:2]), outline))
            if shapely.distance(shapely.Point(before[:2]), outline) > radius_m + OPEN_M:
                errors.append(between(before, motion.pose) - wanted)
        rates.append(LEG / leg_s)
        step_rates.append(leg_steps / leg_s)
        steps += leg_steps
    off = np.array(errors).reshape(-1, 3)
    return {
        "plan": building.plan.name,
        "engine": name,
        "moves": legs * LEG,
        "moves_in_the_open": len(off),
        "moves_per_s": float(np.median(rates)),
        "steps_per_s": float(np.median(step_rates)),
        "steps_per_move": steps / (legs * LEG),
        "error_m": float(np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1)))) if len(off) else None,
        "error_rad": float(np.sqrt(np.mean(off[:, 2] ** 2))) if len(off) else None,
        "collided": collided,
        "penetration_by_contacts_m": own_m,
        "penetration_by_outline_m": max(max(inside_m), 0.0),
    }


def _place(places: shapely.Geometry, rng: np.random.Generator) -> np.ndarray:
    """A pose in the free space that is left for the hull's centre."""
    xmin, ymin, xmax, ymax = places.bounds
    while True:
        x, y = rng.uniform([xmin, ymin], [xmax, ymax])
        if shapely.contains_xy(places, x, y):
            return np.array([x, y, rng.uniform(-np.pi, np.pi)])


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("plan")
    table.add_column("engine")
    for column in (
        "moves/s",
        "steps/s",
        "steps/move",
        "error, mm",
        "error, deg",
        "collided",
        "in walls, mm",
        "judged, mm",
    ):
        table.add_column(column, justify="right")
    for row in rows:
        dynamic = row["steps_per_move"] > 0
        table.add_row(
            Text(row["plan"]),
            row["engine"],
            f"{row['moves_per_s']:,.0f}",
            f"{row['steps_per_s']:,.0f}" if dynamic else "-",
            f"{row['steps_per_move']:.0f}" if dynamic else "-",
            "-" if row["error_m"] is None else f"{1e3 * row['error_m']:.3f}",
            "-" if row["error_rad"] is None else f"{np.degrees(row['error_rad']):.4f}",
            str(row["collided"]),
            f"{1e3 * row['penetration_by_contacts_m']:.2f}" if dynamic else "-",
            f"{1e3 * row['penetration_by_outline_m']:.2f}",
        )
    return table


def _plot(rows: list[dict[str, Any]], path: Path) -> None:
    """Error and depth in walls against decisions per second, one line a plan."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    markers = dict(zip(dict.fromkeys(row["engine"] for row in rows), "os^Dvx*", strict=False))
    colours = {plan: f"C{i}" for i, plan in enumerate(dict.fromkeys(row["plan"] for row in rows))}
    for row in rows:
        style = {"marker": markers[row["engine"]], "color": colours[row["plan"]], "linestyle": "none"}
        if row["error_m"] is not None:
            axes[0].plot(row["moves_per_s"], 1e3 * max(row["error_m"], EXACT_M), **style)
        axes[1].plot(row["moves_per_s"], 1e3 * row["penetration_by_contacts_m"], **style)
    axes[0].set(yscale="log", ylabel="error of a motion in the open, rms [mm]")
    axes[0].axhline(1e3 * EXACT_M, color="0.7", linestyle=":", label="exact")
    axes[1].axhline(5.0, color="0.7", linestyle=":")
    axes[1].set(ylabel="deepest in a wall [mm]")
    for ax in axes:
        ax.set(xscale="log", xlabel="decisions per second")
        ax.grid(alpha=0.3)
    for name, marker in markers.items():
        axes[0].plot([], [], marker=marker, color="0.4", linestyle="none", label=name)
    for name, colour in colours.items():
        axes[1].plot([], [], marker="s", color=colour, linestyle="none", label=name)
    axes[0].legend(fontsize=8)
    axes[1].legend(fontsize=8)
    save_figure(figure, path)
