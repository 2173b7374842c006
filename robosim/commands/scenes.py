"""`robosim plan` and `robosim generate`."""

from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Literal

import numpy as np
from rich.text import Text
from tyro.conf import OmitArgPrefixes, Positional

from robosim.commands.speaking import console, tell
from robosim.commands.terminal import (
    NO_OPTIONS,
    PlanOptions,
    read,
    results_in,
)
from robosim.support.checks import RADIUS_M, SEED, check_number
from wireless.support.counting import counted

#: Where walls in Mitsuba scenes reflect most like ours [Hz].
MITSUBA_HZ = 28e9


def plan(
    plan: Positional[str],
    *,
    reading: OmitArgPrefixes[PlanOptions] = NO_OPTIONS,
    tolerance: float | None = None,
    radius: float = 0.10,
    mast: float = 1.25,
    out: Path | None = None,
) -> None:
    """Show a floor plan: its size, its rooms and what a robot can reach; and export it and its building.

    Writes NAME.yaml and NAME.pgm (ROS map_server), NAME.png, reach.png, building.glb, building.ply, a Mitsuba scene
    with ITU radio materials (mitsuba/) that other radio tools load, and mujoco.xml: building and robot for MuJoCo.

    Example: robosim plan office --radius 0.18 --out out/office

    Args:
        plan: Floor plan: a shipped one by name, a ROS map (.yaml), an image or mesh, a HouseExpo .json, .npy.
        reading: How to read the plan, where it does not say.
        tolerance: How far walls may be moved to save corners [m]; left out, walls under staircases are
            straight, but for published grids; 0 keeps every cell.
        radius: Radius of the robot's hull [m].
        mast: Height of the robot's camera [m]: it drives under what hangs higher in a furnished building.
        out: Folder for the files; a new one under runs/ if not given.
    """
    from robosim.building.building import BuildingConfig, make_building
    from robosim.building.export import export_mesh, export_mitsuba, itu_slab
    from robosim.building.reach import reach
    from robosim.drawing.plots import plot_plan
    from robosim.plans.files import write_png, write_ros
    from robosim.robot.mjcf import export_mjcf
    from robosim.robot.robots import robot_of_radius
    from wireless.geometry.extruded import find_extruded
    from wireless.tracing.tracer import TracerConfig

    config = BuildingConfig(tolerance_m=tolerance)
    check_number("radius", radius, *RADIUS_M)
    robot = replace(robot_of_radius(radius), mast_m=mast)
    with results_in(out, "plan") as folder:
        floor_plan = read(plan, reading)
        building = make_building(floor_plan, config=config)
        places = reach(building, *robot.hull_m)
        places.check_room()
        write_ros(floor_plan, folder / f"{floor_plan.name}.yaml")
        write_png(floor_plan, folder / f"{floor_plan.name}.png")
        plot_plan(folder / "reach.png", building, places)
        export_mesh(building, folder / "building.glb")
        export_mesh(building, folder / "building.ply")
        export_mitsuba(building, folder / "mitsuba", frequency_hz=MITSUBA_HZ)
        pose = np.array([*places.widest(), 0.0])
        export_mjcf(building, folder / "mujoco.xml", robot=robot, pose=pose)
    slabs = {str(material): itu_slab(material, MITSUBA_HZ) for material in building.materials}
    n_parts, cut_off = len(np.unique(places.parts[places.indoors])), places.cut_off(1)
    rows, columns = floor_plan.shape
    n_placed = len(building.mesh.faces) - len(building.bare.mesh.faces)
    extruded = find_extruded(building.mesh, building.face_material.astype(np.int64), TracerConfig.snap_m)
    engine = "space" if extruded is None else "plan"
    tell(
        {
            "plan": floor_plan.name,
            "cells": [columns, rows],
            "resolution_m": floor_plan.resolution_m,
            "free_m2": building.indoor_m2,
            "wall_pieces": len(building.walls_2d),
            "triangles": len(building.mesh.faces),
            "mitsuba": {name: slab._asdict() for name, slab in slabs.items()},
            "radius_m": radius,
            "height_m": robot.height_m,
            "furnishings": len(building.furnishings),
            "radio": engine,
            "parts": n_parts,
            "cut_off": [{"area_m2": room.area_m2, "centre_m": room.centre} for room in cut_off],
        },
        folder,
    )
    told = (
        f": {columns} x {rows} cells of {floor_plan.resolution_m:g} m, {building.indoor_m2:.1f} m2 free, "
        f"{counted(len(building.walls_2d), 'wall piece')}, {counted(len(building.mesh.faces), 'triangle')}"
    )
    console.print(Text.assemble((floor_plan.name, "bold"), told))
    tall = f" and a height of {robot.height_m:g} m" if building.furnishings else ""
    console.print(
        f"A hull of radius {radius:g} m{tall} can drive in {counted(n_parts, 'separate part')} of it."
    )
    if building.furnishings:
        console.print(
            f"{counted(len(building.furnishings), 'thing')} placed in it, of {counted(n_placed, 'triangle')}."
        )
    if engine == "space":
        console.print(
            "It is no extruded plan, so that radio is traced in space: some ten to a hundred times slower a link."
        )
    for room in cut_off:
        at = f"({room.centre[0]:.2f}, {room.centre[1]:.2f})"
        console.print(f"  out of reach from the largest part: {room.area_m2:.1f} m2 around {at} m")
    for name, slab in slabs.items():
        if slab.off_db > 0.5:
            console.print(
                f"In mitsuba/, {name} is a slab of {slab.itu_type} of {1e3 * slab.thickness_m:g} mm, whose reflections "
                f"differ by {slab.off_db:.1f} dB (root mean square, incidence to 85 degrees, {MITSUBA_HZ / 1e9:g} GHz)."
            )
    console.print(f"Wrote {floor_plan.name}.yaml, reach.png, building.glb, mitsuba/ and more in {folder}")
    # The file just written, since it says by itself what the options said of the plan.
    console.print(f"Next: robosim episode {quote(str(folder / floor_plan.name))}.yaml --out out/episode")


def generate(
    *,
    seed: int = 0,
    count: int = 1,
    style: Literal["home", "office"] = "home",
    heights: bool = False,
    navigable: bool = False,
    out: Path | None = None,
) -> None:
    """Make floor plans of buildings like real ones, each from its own seed.

    With --heights NAME.yaml names NAME-furnishings.yaml, the list of what is placed in the building: tables, chairs,
    shelves and more of true height, which can be edited.

    Example: robosim generate --seed 100 --count 20 --out out/plans

    Args:
        seed: Seed of the first plan; the others count up from it.
        count: How many plans.
        style: home or office.
        heights: Furnish with pieces of true height in place of cells up to the ceiling.
        navigable: Write the area navigable for a 0.1 m robot, as the published grids are.
        out: Folder for the plans; a new one under runs/ if not given.
    """
    from robosim.generator.generate import GeneratorConfig, generate_plan
    from robosim.plans.files import write_ros
    from robosim.support.progress import tracked

    check_number("count", count, 1, 100_000, "plans", whole=True)
    check_number("seed", seed, *SEED, whole=True)
    config, names = GeneratorConfig(style=style, heights=heights, navigable=navigable), []
    with (
        results_in(out, "generate") as folder,
        tracked(range(seed, seed + count), "plans", console) as numbers,
    ):
        for number in numbers:
            made = generate_plan(number, config=config)
            write_ros(made, folder / f"{made.name}.yaml")
            names.append(made.name)
    tell({"plans": [f"{name}.yaml" for name in names]}, folder)
    console.print(f"Wrote {counted(count, 'plan')}, {made.name}.yaml the last, in {folder}")
    console.print(f"Next: robosim plan {quote(str(folder / made.name))}.yaml")
