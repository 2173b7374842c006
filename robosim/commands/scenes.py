"""`robosim plan` and `robosim generate`."""

from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Annotated, Any, Literal

import numpy as np
from rich.text import Text
from tyro.conf import OmitArgPrefixes, Positional

from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import NO_OPTIONS, PlanOptions, read, results_folder
from robosim.support.checks import RADIUS_M, SEED, Range
from robosim.support.reading import naming
from wireless.support.counting import counted

#: Where walls in Mitsuba scenes reflect most like ours [Hz].
MITSUBA_HZ = 28e9
#: Parts of smaller area, such as gaps between furniture, are counted separately [m2].
_SMALL_M2 = 1.0


def plan(
    plan: Positional[str],
    *,
    reading: OmitArgPrefixes[PlanOptions] = NO_OPTIONS,
    tolerance: float | None = None,
    radius: Annotated[float, RADIUS_M] = 0.10,
    mast: float = 1.25,
    out: Path | None = None,
) -> None:
    """Show a floor plan: its size, its rooms and the floor that a robot can reach; export it and its building.

    Writes NAME.yaml and NAME.pgm (ROS map_server), NAME.png, reach.png, building.glb, building.ply, a Mitsuba scene
    with ITU radio materials (mitsuba/) that other radio tools load, and mujoco.xml: building and robot for MuJoCo.

    Example: robosim plan office --radius 0.18 --out out/office

    Args:
        plan: Floor plan: one shipped, by name, or a ROS map (.yaml), image, mesh, .dxf, .svg, .ifc, .json, .npy.
        reading: How to read the plan.
        tolerance: Largest shift of walls that saves corners [m]; by default walls under staircases are straight, except
            in published grids; 0 keeps every cell.
        radius: Radius of the robot's hull [m].
        mast: Height of the robot's camera [m]; in a furnished building it drives under higher obstacles.
        out: Output folder; by default a new one under runs/.
    """
    from robosim.building.building import BuildingConfig, make_building
    from robosim.building.mesh_export import export_mesh, export_mitsuba, itu_slab
    from robosim.building.reach import reach
    from robosim.drawing.plots import plot_plan
    from robosim.plans.files import write_png, write_ros
    from robosim.robot.mjcf import export_mjcf
    from robosim.robot.robots import robot_of_radius
    from wireless.geometry.extruded import find_extruded
    from wireless.tracing.tracer import TracerConfig

    config = BuildingConfig(tolerance_m=tolerance)
    robot = replace(robot_of_radius(radius), mast_m=mast, camera=None)
    with results_folder(out, "plan") as folder:
        floor_plan = read(plan, reading)
        building = make_building(floor_plan, config=config)
        places = reach(building, *robot.hull_m)
        with naming(plan, "a floor plan"):
            places.check_room()
        write_ros(floor_plan, folder / f"{floor_plan.name}.yaml")
        write_png(floor_plan, folder / f"{floor_plan.name}.png")
        plot_plan(folder / "reach.png", building, places)
        export_mesh(building, folder / "building.glb")
        export_mesh(building, folder / "building.ply")
        export_mitsuba(building, folder / "mitsuba", frequency_hz=MITSUBA_HZ)
        pose = np.array([*places.widest(), 0.0])
        export_mjcf(building, folder / "mujoco.xml", robot=robot, pose=pose)
    slabs = {str(material): itu_slab(material, MITSUBA_HZ)._asdict() for material in building.materials}
    _, n_cells = np.unique(places.parts[places.indoors], return_counts=True)
    extruded = find_extruded(building.mesh, building.face_material.astype(np.int64), TracerConfig.snap_m)
    result = {
        "plan": floor_plan.name,
        "cells": list(floor_plan.shape[::-1]),
        "resolution_m": floor_plan.resolution_m,
        "free_m2": building.indoor_m2,
        "wall_pieces": len(building.walls_2d),
        "triangles": len(building.mesh.faces),
        "mitsuba": slabs,
        "radius_m": radius,
        "height_m": robot.height_m,
        "furnishings": len(building.furnishings),
        "radio": "space" if extruded is None else "plan",
        "parts": len(n_cells),
        "small_parts": int((n_cells * floor_plan.resolution_m**2 < _SMALL_M2).sum()),
        "cut_off": [{"area_m2": room.area_m2, "centre_m": room.centre} for room in places.cut_off(1)],
    }
    emit_result(result, folder)
    _print_plan(result, len(building.mesh.faces) - len(building.bare.mesh.faces))
    console.print(f"Wrote {floor_plan.name}.yaml, reach.png, building.glb, mitsuba/ and more in {folder}")
    # The written file needs no options for reading.
    console.print(f"Next: robosim episode {quote(str(folder / floor_plan.name))}.yaml --out out/episode")


def _print_plan(result: dict[str, Any], n_furnishing_triangles: int) -> None:
    columns, rows = result["cells"]
    details = (
        f": {columns} x {rows} cells of {result['resolution_m']:g} m, {result['free_m2']:.1f} m2 free, "
        f"{counted(result['wall_pieces'], 'wall piece')}, {counted(result['triangles'], 'triangle')}"
    )
    console.print(Text.assemble((result["plan"], "bold"), details))
    tall = f" and a height of {result['height_m']:g} m" if result["furnishings"] else ""
    parts = counted(result["parts"], "separate part")
    small = f" ({n} of less than {_SMALL_M2:g} m2)" if (n := result["small_parts"]) else ""
    console.print(f"A hull of radius {result['radius_m']:g} m{tall} can drive in {parts} of it{small}.")
    if count := result["furnishings"]:
        triangles = counted(n_furnishing_triangles, "triangle")
        console.print(f"{counted(count, 'furnishing')} placed in it, of {triangles}.")
    if result["radio"] == "space":
        console.print(
            "It is not an extruded plan, so radio is traced in space: ten to a hundred times slower per link."
        )
    for room in result["cut_off"]:
        at = "({:.2f}, {:.2f})".format(*room["centre_m"])
        console.print(f"  out of reach from the largest part: {room['area_m2']:.1f} m2 around {at} m")
    for name, slab in result["mitsuba"].items():
        if slab["off_db"] > 0.5:
            console.print(
                f"In mitsuba/, {name} is a slab of {slab['itu_type']} of {1e3 * slab['thickness_m']:g} mm, whose "
                f"reflections differ by {slab['off_db']:.1f} dB (root mean square, incidence to 85 degrees, "
                f"{MITSUBA_HZ / 1e9:g} GHz)."
            )


def generate(
    *,
    seed: Annotated[int, SEED] = 0,
    count: Annotated[int, Range(1, 100_000, "plans")] = 1,
    style: Literal["home", "office", "campus", "school", "hospital", "hall"] = "home",
    area_m2: Annotated[float | None, Range(4, 5000, "m2")] = None,
    rooms: Annotated[int | None, Range(1, 400, "rooms")] = None,
    heights: bool = False,
    navigable: bool = False,
    out: Path | None = None,
) -> None:
    """Generate floor plans of realistic buildings, each from its own seed.

    With --heights, NAME.yaml refers to NAME-furnishings.yaml, an editable list of furnishings of true height: tables,
    chairs, shelves and more.

    Example: robosim generate --style office --area-m2 1500 --rooms 40 --count 20 --out out/plans

    Args:
        seed: Seed of the first plan; the others count up from it.
        count: Number of plans.
        style: Kind of building. Campus (offices), school, hospital and hall have 1,000 to 5,000 m2, with several
            corridors or great halls.
        area_m2: Floor area of all rooms together [m2]; by default drawn from the seed.
        rooms: Number of rooms of a home or an office, corridors included; by default drawn from the seed.
        heights: Whether furniture has its true height, instead of cells up to the ceiling.
        navigable: Whether to write the area navigable for a robot of 0.1 m, like the published grids.
        out: Output folder; by default a new one under runs/.
    """
    from robosim.generator.generate import GeneratorConfig, generate_plan
    from robosim.plans.files import write_ros
    from robosim.support.progress import tracked

    config = GeneratorConfig(style=style, area_m2=area_m2, rooms=rooms, heights=heights, navigable=navigable)
    names = []
    with (
        results_folder(out, "generate") as folder,
        tracked(range(seed, seed + count), "plans", console) as numbers,
    ):
        for number in numbers:
            made = generate_plan(number, config=config)
            write_ros(made, folder / f"{made.name}.yaml")
            names.append(made.name)
    emit_result({"plans": [f"{name}.yaml" for name in names]}, folder)
    console.print(f"Wrote {counted(count, 'plan')}, {made.name}.yaml the last, in {folder}")
    console.print(f"Next: robosim plan {quote(str(folder / made.name))}.yaml")
