"""`python -m tests.benchmarks`, of ways and maps: speed against error."""

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional

from robosim.commands.output import console, emit_result_file
from robosim.commands.shared_options import (
    ALL_CORES,
    WorkOptions,
    output_folder,
    read,
    results_folder,
    resume_hint,
)
from robosim.parts import EXPLORER, ExplorerPart, MapperPart, PhysicsPart
from robosim.support.checks import PLANS, SEED, STEPS, check_number, check_some


def navigation(
    plans: Positional[tuple[str, ...]],
    *,
    goals: tuple[Literal["oracle", "explore"], ...] = ("oracle", "explore"),
    seed: int = 1,
    noise: float = 1.0,
    mapper: MapperPart = "neural",
    explorer: ExplorerPart = "learned",
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Measure navigation: one task a plan, arrival, SPL, wall penetration, coverage and pose error.

    The results do not depend on the number of workers.

    Example: python -m tests.benchmarks navigation flat office --out out/navigation

    Args:
        plans: Floor plans, or folders of them.
        goals: Goal policies to run on each.
        seed: Seed of the tasks and of the noise.
        noise: Level of actuation and odometry noise.
        mapper: Who makes the map: neural, classical, or a .safetensors file.
        explorer: Who chooses among frontiers.
        work: Who does the work.
        out: Folder for the table; a new one under runs/ if not given.
    """
    from tests.benchmarks.navigation import run

    check_some("plans", plans, PLANS)
    check_some("goals", goals, "goal policies, such as oracle explore")
    check_number("seed", seed, *SEED, whole=True)
    folder = output_folder(out, "bench navigation")
    with resume_hint(folder):
        table = run(
            plans,
            goals=goals,
            seed=seed,
            noise=noise,
            mapper=mapper,
            explorer=explorer,
            workers=work.count,
            cluster=work.cluster,
            out=folder,
            console=console,
        )
    console.print(table)
    emit_result_file(folder / "navigation.json")
    console.print(f"Wrote navigation.json and the episodes in {folder}")


def exploration(
    plans: Positional[tuple[str, ...]],
    *,
    explorers: tuple[Annotated[str, EXPLORER.option()], ...] = ("nearest", "gain"),
    seed: int = 1,
    noise: float = 1.0,
    depth_noise: float = 0.0,
    physics: PhysicsPart = "dynamic",
    mapper: MapperPart = "neural",
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Measure exploration: how much of the floor is seen after how many decisions, explorer beside explorer.

    Goes on after a kill if given the same folder; the results do not depend on the number of workers.

    Example: python -m tests.benchmarks exploration flat office --out out/exploration

    Args:
        plans: Floor plans, or folders of them.
        explorers: Explorers to compare, with the first of them.
        seed: Seed of the tasks and of the noise.
        noise: Level of actuation and odometry noise.
        depth_noise: Level of the depth camera's noise.
        physics: dynamic drives wheels in MuJoCo; kinematic moves a disk, faster.
        mapper: Who makes the map: neural, classical, or a .safetensors file.
        work: Who does the work.
        out: Folder for table, curves and pictures; a new one under runs/ if not given.
    """
    from tests.benchmarks.exploration import ExplorationSettings, run

    check_some("plans", plans, PLANS)
    check_some("explorers", explorers, "explorers, such as nearest gain")
    settings = ExplorationSettings(
        mapper=mapper, seed=seed, noise=noise, depth_noise=depth_noise, physics=physics
    )
    folder = output_folder(out, "bench exploration")
    with resume_hint(folder):
        table = run(
            plans,
            settings,
            explorers=explorers,
            workers=work.count,
            cluster=work.cluster,
            out=folder,
            console=console,
        )
    console.print(table)
    emit_result_file(folder / "exploration.json")
    console.print(
        f"Wrote exploration.json, curves, and ways through the worst, median and best plan in {folder}"
    )


def slam(
    plans: Positional[tuple[str, ...]],
    *,
    mapper: str = "neural",
    steps: int = 1000,
    seed: int = 1,
    noise: float = 1.0,
    depth_noise: float = 1.0,
    physics: PhysicsPart = "kinematic",
    turned: tuple[float, ...] = (0.0,),
    transmitters: int = 0,
    sizes: tuple[int, ...] = (64, 96, 128, 192, 256),
    others: tuple[str, ...] = (),
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Measure mapping: the learned mapper against the classical one, and ways to know the pose, on the same frames.

    Overlap and calibration of maps, ATE and RPE, with parts of the mapper left out one by one, coverage, time by stage,
    and speed against error over the size of depth images and over networks. About two minutes a plan. Goes on after a
    kill if given the same folder; the scores do not depend on the number of workers.

    Example: python -m tests.benchmarks slam flat office --out out/slam

    Example: python -m tests.benchmarks slam hall ring corridor --turned 0 30 --transmitters 3 --sizes

    Args:
        plans: Floor plans, or folders of them; or floors on which poses are hard to tell, by name: hall, pillars,
            corridor, ring, large-1, large-2.
        mapper: Learned mapper: neural, or a .safetensors file.
        steps: Most decisions of each walk; two walks a plan.
        seed: Seed of the tasks and of the noise.
        noise: Level of actuation and odometry noise.
        depth_noise: Level of the depth camera's noise.
        physics: dynamic drives wheels in MuJoCo; kinematic moves a disk, faster.
        turned: Each plan is turned by each of these angles against its grid [degrees].
        transmitters: Radios that mappers beside that of the walk hear: one of them, and all.
        sizes: Widths of depth images at which speed is measured [pixels]; none leaves that part out.
        others: Further networks whose speed is measured: .safetensors files.
        work: Who does the work.
        out: Folder for the files; a new one under runs/ if not given.
    """
    from tests.benchmarks.slam import run
    from tests.benchmarks.slam_plan import SlamSettings
    from tests.benchmarks.slam_speed import SpeedSettings

    check_some("plans", plans, PLANS)
    check_some("turned", turned, "--turned 0 45")
    for angle in turned:
        check_number("turned", angle, -360, 360, "degrees")
    settings = SlamSettings(
        mapper=mapper,
        steps=steps,
        seed=seed,
        noise=noise,
        depth_noise=depth_noise,
        physics=physics,
        transmitters=transmitters,
    )
    speed = SpeedSettings(sizes=sizes, mappers=others, frames=min(steps, 150)) if sizes else None
    folder = output_folder(out, "bench slam")
    with resume_hint(folder):
        tables = run(
            plans,
            settings,
            speed=speed,
            workers=work.count,
            cluster=work.cluster,
            angles_deg=turned,
            out=folder,
            console=console,
        )
    console.print(tables)
    emit_result_file(folder / "slam.json")
    console.print(
        f"Wrote slam.json, curves, and maps of the worst, median and best plan in {folder}", soft_wrap=True
    )


def endurance(
    plan: Positional[str] = "office",
    *,
    mapper: str = "neural",
    steps: int = 10_000,
    seed: int = 1,
    noise: float = 1.0,
    depth_noise: float = 1.0,
    out: Path | None = None,
) -> None:
    """Measure endurance: thousands of decisions in one building; pose error, memory, and numbers that are none.

    Example: python -m tests.benchmarks endurance office --steps 10000

    Args:
        plan: Floor plan.
        mapper: classical, neural, or a .safetensors file.
        steps: Decisions.
        seed: Seed of the task and of the noise.
        noise: Level of actuation and odometry noise.
        depth_noise: Level of the depth camera's noise.
        out: Folder for the table; a new one under runs/ if not given.
    """
    from tests.benchmarks.endurance import PARTS, run
    from tests.benchmarks.slam_plan import SlamSettings

    check_number("steps", steps, PARTS, STEPS[1], "decisions", whole=True)
    settings = SlamSettings(mapper=mapper, steps=steps, seed=seed, noise=noise, depth_noise=depth_noise)
    with results_folder(out, "bench endurance") as folder:
        console.print(run(read(plan), settings, out=folder, console=console))
    emit_result_file(folder / "endurance.json")
    console.print(f"Wrote endurance.json in {folder}")
