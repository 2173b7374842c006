"""The `robosim` command: parses what is asked for, calls what does it, prints what came out.

Bad input ends in one sentence on standard error and exit status 2, never in a traceback.
"""

import logging
import sys
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from rich.console import Console
from rich.logging import RichHandler
from tyro.conf import Positional

from robosim.floorplan import FloorPlan

#: A pipe has no width; tables should not be cut for it.
_console = Console(width=None if sys.stdout.isatty() else 150)


def _numbers(count: int, metavar: str) -> tyro.constructors.PrimitiveConstructorSpec:
    """How tyro reads comma-separated numbers such as 3.2,-4.5."""

    def read(words: list[str]) -> tuple[float, ...]:
        values = tuple(float(word) for word in words[0].split(","))
        if len(values) != count or not np.isfinite(values).all():
            raise ValueError(f"expected {metavar}, {count} finite numbers with commas and no spaces")
        return values

    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=metavar,
        instance_from_str=read,
        is_instance=lambda value: isinstance(value, tuple),
        str_from_instance=lambda value: [",".join(f"{v:g}" for v in value)],
    )


XY = Annotated[tuple[float, ...], _numbers(2, "X,Y")]
Pose = Annotated[tuple[float, ...], _numbers(3, "X,Y,YAW")]


def episode(
    plan: Positional[str],
    *,
    target: XY | None = None,
    start: Pose | None = None,
    goal: Literal["oracle", "explore"] = "oracle",
    seed: int = 0,
    physics: Literal["dynamic", "kinematic"] = "dynamic",
    camera: Literal["pyrender", "embree"] = "pyrender",
    robot: Literal["turtlebot", "locobot"] = "turtlebot",
    noise: float = 1.0,
    size: int = 128,
    max_steps: int = 1000,
    tolerance: float = 0.0,
    resolution: float | None = None,
    floor_height: float | None = None,
    video: bool = True,
    out: Path | None = None,
) -> None:
    """Drive a robot through a building, and record what it did and saw.

    Writes result.json, trajectory.tum (true) and estimate.tum, the built map (map.yaml, map.pgm), map.png and
    episode.mp4. Ctrl-C ends the episode and leaves the same files of what was done until then. One seed gives
    one result.

    Example: robosim episode flat --goal explore --seed 3 --out out/explore

    Args:
        plan: Floor plan: a shipped one by name, a ROS map (.yaml), an image or mesh, a HouseExpo .json, .npy.
        target: Where the target stands [m], in the plan's frame; drawn from the seed if not given.
        start: Where the robot starts [m, m, degrees from +x]; drawn from the seed if not given.
        goal: Who chooses the goals. oracle knows the target; explore goes where the map ends.
        seed: Seed of everything random: task and noise.
        physics: dynamic drives wheels in MuJoCo; kinematic moves a disk, much faster.
        camera: pyrender draws with OpenGL; embree casts rays, slower, and needs no OpenGL.
        robot: turtlebot has a hull of radius 0.10 m, locobot 0.18 m.
        noise: Level of actuation and odometry noise: 0 none, 1 as published for LoCoBot.
        size: Width and height of the camera's pictures [pixels].
        max_steps: Actions before giving up.
        tolerance: How far walls may be moved to straighten them [m]; 0 keeps every cell.
        resolution: Metres per pixel, for plans that do not say (images).
        floor_height: Height of the storey's floor [m], for meshes of several storeys.
        video: Whether to write episode.mp4.
        out: Folder for the results; a new one under runs/ if not given.
    """
    from robosim.building import BuildingConfig
    from robosim.camera import CameraConfig
    from robosim.episode import EpisodeConfig
    from robosim.odometry import NoiseModel
    from robosim.robot import ROBOTS
    from robosim.run import record_episode
    from robosim.simulator import SimulatorConfig

    config = EpisodeConfig(
        goal=goal,
        seed=seed,
        max_steps=max_steps,
        building=BuildingConfig(tolerance_m=tolerance),
        simulator=SimulatorConfig(
            physics=physics,
            camera=camera,
            image=CameraConfig(width=size, height=size),
            robot=ROBOTS[robot],
            noise=NoiseModel(level=noise),
        ),
    )
    folder = _folder(out, "episode")
    result = record_episode(
        _read(plan, resolution, floor_height),
        config,
        folder,
        start=None if start is None else np.array([start[0], start[1], np.radians(start[2])]),
        target=None if target is None else np.array(target),
        video=video,
        console=_console,
    )
    seen = f"{100 * result['coverage']:.1f} % of the reachable floor seen"
    _console.print(
        f"[bold]{result['ended']}[/] after {result['steps']} steps and {result['path_length_m']:.2f} m "
        f"(shortest {result['shortest_m']:.2f} m, SPL {result['spl']:.2f}), {seen}, "
        f"{result['collisions']} collisions, {result['timing']['decisions_per_s']:.0f} decisions/s"
    )
    files = ["result.json", "map.png", "map.yaml", "trajectory.tum", "estimate.tum"]
    _console.print(f"Wrote {', '.join(files + ['episode.mp4'] * video)} in {folder}")
    _console.print(f"Next: evo_ape tum {folder}/trajectory.tum {folder}/estimate.tum")
    if result["ended"] == "interrupted":
        sys.exit(130)


def plan(
    plan: Positional[str],
    *,
    resolution: float | None = None,
    floor_height: float | None = None,
    tolerance: float = 0.0,
    radius: float = 0.10,
    out: Path | None = None,
) -> None:
    """Show a floor plan: its size, its rooms and what a robot can reach; and export it and its building.

    Writes NAME.yaml and NAME.pgm (ROS map_server), NAME.png, reach.png, building.glb, building.ply, and a
    Mitsuba scene with ITU radio materials (mitsuba/) that other radio tools load.

    Example: robosim plan office --radius 0.18 --out out/office

    Args:
        plan: Floor plan: a shipped one by name, a ROS map (.yaml), an image or mesh, a HouseExpo .json, .npy.
        resolution: Metres per pixel, for plans that do not say (images).
        floor_height: Height of the storey's floor [m], for meshes of several storeys.
        tolerance: How far walls may be moved to straighten them [m]; 0 keeps every cell.
        radius: Radius of the robot's hull [m].
        out: Folder for the files; a new one under runs/ if not given.
    """
    from robosim.building import BuildingConfig, make_building
    from robosim.export import export_mesh, export_mitsuba
    from robosim.planfiles import write_png, write_ros
    from robosim.plots import plot_plan
    from robosim.reach import reach

    floor_plan = _read(plan, resolution, floor_height)
    building = make_building(floor_plan, config=BuildingConfig(tolerance_m=tolerance))
    places = reach(building, radius)
    folder = _folder(out, "plan")
    write_ros(floor_plan, folder / f"{floor_plan.name}.yaml")
    write_png(floor_plan, folder / f"{floor_plan.name}.png")
    plot_plan(folder / "reach.png", building, places)
    export_mesh(building, folder / "building.glb")
    export_mesh(building, folder / "building.ply")
    export_mitsuba(building, folder / "mitsuba")
    rows, columns = floor_plan.shape
    _console.print(
        f"[bold]{floor_plan.name}[/]: {columns} x {rows} cells of {floor_plan.resolution_m:g} m, "
        f"{building.free.area:.1f} m2 free, {len(building.walls_2d)} wall pieces, "
        f"{len(building.mesh.faces)} triangles"
    )
    _console.print(f"A hull of radius {radius:g} m can drive in {places.n_parts} separate part(s) of it.")
    for room in places.cut_off(1) if places.n_parts else []:
        at = f"({room.centre[0]:.2f}, {room.centre[1]:.2f})"
        _console.print(f"  out of reach from the largest part: {room.area_m2:.1f} m2 around {at} m")
    _console.print(f"Wrote {floor_plan.name}.yaml, reach.png, building.glb, mitsuba/ and more in {folder}")
    _console.print(f"Next: robosim episode {plan} --out out/episode")


def generate(
    *,
    seed: int = 0,
    count: int = 1,
    style: Literal["home", "office"] = "home",
    navigable: bool = False,
    out: Path | None = None,
) -> None:
    """Make floor plans of buildings like real ones, each from its own seed.

    Example: robosim generate --seed 100 --count 20 --out out/plans

    Args:
        seed: Seed of the first plan; the others count up from it.
        count: How many plans.
        style: home or office.
        navigable: Write the area navigable for a 0.1 m robot, as the published grids are.
        out: Folder for the plans; a new one under runs/ if not given.
    """
    from rich.progress import track

    from robosim.generate import GeneratorConfig, generate_plan
    from robosim.planfiles import write_ros

    folder = _folder(out, "generate")
    config = GeneratorConfig(style=style, navigable=navigable)
    for number in track(range(seed, seed + count), "plans", console=_console, transient=True):
        made = generate_plan(number, config=config)
        write_ros(made, folder / f"{made.name}.yaml")
    _console.print(f"Wrote {count} plan(s), {made.name}.yaml the last, in {folder}")
    _console.print(f"Next: robosim plan {folder / made.name}.yaml")


def doctor() -> None:
    """Check this machine: what works, how fast, and what to install where something does not."""
    from robosim.doctor import examine, report

    with _console.status("looking ..."):
        findings = examine()
    if not report(findings, _console):
        sys.exit(1)


def bench_render(*, plan: str = "flat", sizes: tuple[int, ...] = (128, 256), out: Path | None = None) -> None:
    """Measure cameras: frames per second against depth error, with the usual alternatives beside ours.

    Args:
        plan: Floor plan to draw.
        sizes: Widths of the square pictures [pixels].
        out: Folder for the table and the plot; a new one under runs/ if not given.
    """
    from robosim.bench import render
    from robosim.building import make_building

    folder = _folder(out, "bench-render")
    _console.print(render.run(make_building(_read(plan)), sizes=sizes, out=folder))
    _console.print(f"Wrote the table and the plot in {folder}")


def bench_physics(*, plans: tuple[str, ...] = ("flat", "office"), out: Path | None = None) -> None:
    """Measure driving: steps per second against motion error, over time steps and against kinematic.

    Args:
        plans: Floor plans to drive in.
        out: Folder for the table and the plot; a new one under runs/ if not given.
    """
    from robosim.bench import physics
    from robosim.building import make_building

    folder = _folder(out, "bench-physics")
    _console.print(physics.run([make_building(_read(name)) for name in plans], out=folder))
    _console.print(f"Wrote the table and the plot in {folder}")


def bench_navigation(
    plans: Positional[tuple[str, ...]],
    *,
    goals: tuple[Literal["oracle", "explore"], ...] = ("oracle", "explore"),
    seed: int = 1,
    noise: float = 1.0,
    workers: int = 2,
    out: Path | None = None,
) -> None:
    """Measure navigation: one task a plan, arrival, SPL, wall penetration, coverage and pose error.

    The results do not depend on the number of workers.

    Example: robosim bench navigation flat office --out out/navigation

    Args:
        plans: Floor plans, or folders of them.
        goals: Goal policies to run on each.
        seed: Seed of the tasks and of the noise.
        noise: Level of actuation and odometry noise.
        workers: Processes to run at once.
        out: Folder for the table; a new one under runs/ if not given.
    """
    from robosim.bench import navigation

    folder = _folder(out, "bench-navigation")
    table = navigation.run(
        plans, goals=goals, seed=seed, noise=noise, workers=workers, out=folder, console=_console
    )
    _console.print(table)
    _console.print(f"Wrote navigation.json and one folder an episode in {folder}")


def figures_plans(
    plans: Positional[tuple[str, ...]], *, count: int = 200, seed: int = 0, out: Path | None = None
) -> None:
    """Compare generated buildings with real ones: size, rooms, walls, doors, narrowest passages.

    Example: robosim figures plans maps/*.yaml --out out/figures

    Args:
        plans: Real floor plans, or folders of them.
        count: How many plans to generate beside them.
        seed: Seed of the first one generated.
        out: Folder for the picture; a new one under runs/ if not given.
    """
    from rich.progress import track

    from robosim.generate import GeneratorConfig, generate_plan
    from robosim.generator.planstats import plot_comparison
    from robosim.planfiles import find_plans, read_plan

    real = [read_plan(path) for path in track(find_plans(plans), "reading", console=_console, transient=True)]
    config = GeneratorConfig(navigable=True)
    numbers = track(range(seed, seed + count), "generating", console=_console, transient=True)
    made = [generate_plan(number, config=config) for number in numbers]
    path = _folder(out, "figures-plans") / "plans.png"
    plot_comparison(real, made, path)
    _console.print(f"Wrote {path}: {len(real)} real plans beside {count} generated ones")


_BENCH: dict[str, Callable[..., None]] = {
    "render": bench_render,
    "physics": bench_physics,
    "navigation": bench_navigation,
}
_FIGURES: dict[str, Callable[..., None]] = {"plans": figures_plans}
_GROUPS: dict[str, tuple[str, dict[str, Callable[..., None]]]] = {
    "bench": (f"Measure speed against error: {', '.join(_BENCH)}.", _BENCH),
    "figures": (f"Draw figures: {', '.join(_FIGURES)}.", _FIGURES),
}
_COMMANDS: dict[str, Callable[..., None]] = {
    "episode": episode,
    "plan": plan,
    "generate": generate,
    "doctor": doctor,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the `robosim` command."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    handler = RichHandler(console=Console(stderr=True), show_time=False, show_path=False)
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[handler])
    if words and words[0] in _GROUPS:
        group = words.pop(0)
        description, commands = _GROUPS[group]
        prog = f"robosim {group}"
    else:
        groups = {name: _as_command(text) for name, (text, _) in _GROUPS.items()}
        commands, prog = {**_COMMANDS, **groups}, "robosim"
        description = (
            "Robots that see and hear in buildings made from floor plans. Each command has its own --help."
        )
    try:
        tyro.extras.subcommand_cli_from_dict(commands, prog=prog, description=description, args=words)
    except (ValueError, OSError) as error:
        Console(stderr=True).print(f"robosim: {error}", style="red", highlight=False, soft_wrap=True)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


def _as_command(text: str) -> Callable[..., None]:
    """Something for the top-level help to list a group by."""

    def group() -> None: ...

    group.__doc__ = text
    return group


def _read(plan: str, resolution_m: float | None = None, floor_height_m: float | None = None) -> FloorPlan:
    from robosim.planfiles import read_plan

    return read_plan(plan, resolution_m=resolution_m, floor_height_m=floor_height_m)


def _folder(out: Path | None, verb: str) -> Path:
    folder = out or Path("runs") / f"{datetime.now():%Y%m%d-%H%M%S}-{verb}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder
