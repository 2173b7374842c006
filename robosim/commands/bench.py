"""`robosim bench`: speed against error."""

import math
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional

from robosim.commands.speaking import console, tell_file
from robosim.commands.terminal import (
    ALL_CORES,
    WorkOptions,
    check_threads,
    folder_for,
    going_on,
    read,
    results_in,
)
from robosim.parts import EXPLORER, ExplorerPart, MapperPart, PhysicsPart
from robosim.support.checks import PLANS, SEED, SIZE_PX, STEPS, TASKS, check_number, check_some


def render(*, plan: str = "flat", sizes: tuple[int, ...] = (128, 256), out: Path | None = None) -> None:
    """Measure cameras: frames per second against depth error, with the usual alternatives beside ours.

    Args:
        plan: Floor plan to draw.
        sizes: Widths of the square pictures [pixels].
        out: Folder for the table and the plot; a new one under runs/ if not given.
    """
    from robosim.bench.render import run
    from robosim.building.building import make_building

    check_some("sizes", sizes, "widths of pictures, such as 128 256")
    for size in sizes:
        check_number("sizes", size, *SIZE_PX, whole=True)
    with results_in(out, "bench render") as folder:
        console.print(run(make_building(read(plan)), sizes=sizes, out=folder))
    tell_file(folder / "render.json")
    console.print(f"Wrote the table and the plot in {folder}")


def physics(*, plans: tuple[str, ...] = ("flat", "office"), out: Path | None = None) -> None:
    """Measure driving: steps per second against motion error, over time steps and against kinematic.

    Args:
        plans: Floor plans to drive in.
        out: Folder for the table and the plot; a new one under runs/ if not given.
    """
    from robosim.bench.physics import run
    from robosim.building.building import make_building

    check_some("plans", plans, PLANS)
    with results_in(out, "bench physics") as folder:
        console.print(run([make_building(read(name)) for name in plans], out=folder))
    tell_file(folder / "physics.json")
    console.print(f"Wrote the table and the plot in {folder}")


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

    Example: robosim bench navigation flat office --out out/navigation

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
    from robosim.bench.navigation import run

    check_some("plans", plans, PLANS)
    check_some("goals", goals, "goal policies, such as oracle explore")
    check_number("seed", seed, *SEED, whole=True)
    folder = folder_for(out, "bench navigation")
    with going_on(folder):
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
    tell_file(folder / "navigation.json")
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

    Example: robosim bench exploration flat office --out out/exploration

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
    from robosim.bench.exploration import ExplorationSettings, run

    check_some("plans", plans, PLANS)
    check_some("explorers", explorers, "explorers, such as nearest gain")
    settings = ExplorationSettings(
        mapper=mapper, seed=seed, noise=noise, depth_noise=depth_noise, physics=physics
    )
    folder = folder_for(out, "bench exploration")
    with going_on(folder):
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
    tell_file(folder / "exploration.json")
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

    Example: robosim bench slam flat office --out out/slam

    Example: robosim bench slam hall ring corridor large-1 --turned 0 30 --transmitters 3 --sizes --out out/floors

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
    from robosim.bench.slam import run
    from robosim.bench.slam_plan import SlamSettings
    from robosim.bench.slam_speed import SpeedSettings

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
    folder = folder_for(out, "bench slam")
    with going_on(folder):
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
    tell_file(folder / "slam.json")
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

    Example: robosim bench endurance office --steps 10000

    Args:
        plan: Floor plan.
        mapper: classical, neural, or a .safetensors file.
        steps: Decisions.
        seed: Seed of the task and of the noise.
        noise: Level of actuation and odometry noise.
        depth_noise: Level of the depth camera's noise.
        out: Folder for the table; a new one under runs/ if not given.
    """
    from robosim.bench.endurance import PARTS, run
    from robosim.bench.slam_plan import SlamSettings

    check_number("steps", steps, PARTS, STEPS[1], "decisions", whole=True)
    settings = SlamSettings(mapper=mapper, steps=steps, seed=seed, noise=noise, depth_noise=depth_noise)
    with results_in(out, "bench endurance") as folder:
        console.print(run(read(plan), settings, out=folder, console=console))
    tell_file(folder / "endurance.json")
    console.print(f"Wrote endurance.json in {folder}")


def wireless(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    receivers: int = 400,
    workers: int | None = None,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Measure the radio tracer: links per second against errors, over outline tolerance, reflections, diffraction.

    Also growth with walls and receivers, latency of one link, and visibility against Embree. Rooms of up to 1e5
    triangles are traced in space: paths found over rays, and links per second over facets.

    Example: robosim bench wireless flat office --out out/wireless

    Args:
        plans: Floor plans, or folders of them.
        receivers: Receivers of each plan when settings are compared.
        workers: Most threads; one on each available core if not given.
        seed: Seed of the places of transmitters and receivers.
        out: Folder for the tables and the plot; a new one under runs/ if not given.
    """
    from robosim.bench.wireless import run
    from robosim.plans.files import find_plans

    check_some("plans", plans, PLANS)
    check_number("receivers", receivers, 1, 1_000_000, whole=True)
    check_number("seed", seed, *SEED, whole=True)
    check_threads(workers)
    with results_in(out, "bench wireless") as folder:
        found = [read(str(plan)) for plan in find_plans(plans)]
        console.print(
            run(found, out=folder, receivers=receivers, workers=workers, seed=seed, console=console)
        )
    tell_file(folder / "wireless.json")
    console.print(f"Wrote wireless.json, wireless.png and space.png in {folder}")


def storeys(
    building: Positional[Path | None] = None,
    *,
    receivers: int = 200,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Measure the radio tracer in a building of several storeys: links per second of CPU, and paths against space.

    Example: robosim bench storeys house.yaml --out out/storeys

    Args:
        building: YAML file of the storeys; three shipped villas over each other if not given.
        receivers: Receivers on each storey.
        seed: Seed of the places of transmitters and receivers.
        out: Folder for the table; a new one under runs/ if not given.
    """
    from robosim.bench.storeys import run, three_villas
    from robosim.plans.storeys_file import read_storeys

    check_number("receivers", receivers, 1, 1_000_000, whole=True)
    check_number("seed", seed, *SEED, whole=True)
    with results_in(out, "bench storeys") as folder:
        plan = three_villas() if building is None else read_storeys(building)
        console.print(run(plan, out=folder, receivers=receivers, seed=seed))
    tell_file(folder / "storeys.json")
    console.print(f"Wrote storeys.json in {folder}")


def labels(
    data: Positional[Path],
    plans: Positional[Path],
    *,
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Compare traced link states and angles with the published ones of mmwRobotNav, and say how many agree.

    Goes on after a kill if given the same folder for its results, which do not depend on the number of workers.

    Example: robosim bench labels mmwRobotNav/data mmwRobotNav/maps --out out/labels

    Args:
        data: Folder with a folder of measurements for each building.
        plans: Folder with the buildings' top-down grids.
        work: Who does the work.
        out: Folder for the table and the maps; a new one under runs/ if not given.
    """
    from robosim.bench.labels import run

    folder = folder_for(out, "bench labels")
    console.print(f"Writing labels.json and maps of the worst buildings in {folder}")
    with going_on(folder):
        run(data, plans, workers=work.count, cluster=work.cluster, out=folder, console=console)
    tell_file(folder / "labels.json")


def edges(
    data: Positional[Path],
    plans: Positional[Path],
    *,
    transmitters: int = 4,
    out: Path | None = None,
) -> None:
    """Compare the strength of lone diffractions with the published data of mmwRobotNav, by one law after the other.

    Strengths are told by SNRs that saturate, so traced paths are received by the published receiver too; the offset is
    that of far links in line of sight. Seven seconds a transmitter.

    Example: robosim bench edges mmwRobotNav/data mmwRobotNav/maps --out out/edges

    Args:
        data: Folder with a folder of measurements for each building.
        plans: Folder with the buildings' top-down grids.
        transmitters: How many of each building, at most.
        out: Folder for the table and the figure; a new one under runs/ if not given.
    """
    from robosim.bench.edges import run

    check_number("transmitters", transmitters, 1, 1000, "of each building", whole=True)
    with results_in(out, "bench edges") as folder:
        console.print(run(data, plans, transmitters=transmitters, out=folder, console=console))
    tell_file(folder / "edges.json")
    console.print(f"Wrote edges.json and edges.png in {folder}")


def scattering(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    links: int = 200,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Measure what rough walls change: power and link states of random links with and without scattering.

    Example: robosim bench scattering flat office --out out/scattering

    Args:
        plans: Floor plans, or folders of them.
        links: Links of each plan, in tens.
        seed: Seed of the places.
        out: Folder for the table; a new one under runs/ if not given.
    """
    from robosim.bench.scattering import run
    from robosim.plans.files import find_plans

    check_some("plans", plans, PLANS)
    check_number("links", links, 10, 100_000, "in each plan", whole=True)
    check_number("seed", seed, *SEED, whole=True)
    found = [read(str(plan)) for plan in find_plans(plans)]
    with results_in(out, "bench scattering") as folder:
        console.print(run(found, links=links, seed=seed, out=folder, console=console))
    tell_file(folder / "scattering.json")
    console.print(f"Wrote scattering.json in {folder}")


def estimation(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    links: int = 2000,
    tolerance: float | None = None,
    workers: int | None = None,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Measure sounding and path estimation: links per second against the error of the angle of arrival.

    Waveforms against their closed form, estimators against the Cramér-Rao bound and on traced plans.

    Example: robosim bench estimation flat office --out out/estimation

    Args:
        plans: Floor plans, or folders of them, that links are traced in.
        links: Links of each plan, and a quarter as many lone paths at each SNR.
        tolerance: How far walls may be moved to save corners [m]; left out, walls under staircases are
            straight, but for published grids; 0 keeps every cell.
        workers: Most threads; one on each available core if not given. Errors do not depend on it.
        seed: Seed of places, phases and noise.
        out: Folder for the tables and the plot; a new one under runs/ if not given.
    """
    from robosim.bench.estimation import run
    from robosim.building.outline import check_tolerance
    from robosim.evaluation.arrivals import TX_PER_PLAN
    from robosim.plans.files import find_plans

    check_some("plans", plans, PLANS)
    check_number("links", links, 4 * TX_PER_PLAN, 1_000_000, "in each plan", whole=True)
    check_tolerance(tolerance)
    check_number("seed", seed, *SEED, whole=True)
    check_threads(workers)
    found = [read(str(plan)) for plan in find_plans(plans)]
    with results_in(out, "bench estimation") as folder:
        console.print(
            run(
                found,
                out=folder,
                links=links,
                tolerance_m=tolerance,
                workers=workers,
                seed=seed,
                console=console,
            )
        )
    tell_file(folder / "estimation.json")
    console.print(f"Wrote estimation.json and estimation.png in {folder}")


def episode(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    goal: Literal["oracle", "visual", "snr", "los", "los-or-first", "fused"] = "fused",
    targets: int = 3,
    seed: int = 0,
    max_steps: int = 1000,
    out: Path | None = None,
) -> None:
    """Measure whole episodes: decisions per second against arrival time, with one part changed at a time.

    Camera, physics, mapper, radio, and how far walls may be moved to straighten them. One episode at a time, for the
    sake of the times; goes on after a kill if given the same folder.

    Example: robosim bench episode flat office --out out/episodes

    Args:
        plans: Floor plans, or folders of them.
        goal: Who chooses the goals.
        targets: Tasks of each plan.
        seed: Seed of the tasks and of the noise.
        max_steps: Actions before giving up.
        out: Folder for the table and the plot; a new one under runs/ if not given.
    """
    from robosim.bench.episode import run

    check_some("plans", plans, PLANS)
    check_number("targets", targets, *TASKS, whole=True)
    check_number("seed", seed, *SEED, whole=True)
    check_number("max_steps", max_steps, *STEPS, whole=True)
    folder = folder_for(out, "bench episode")
    table = run(
        plans, goal=goal, targets=targets, seed=seed, max_steps=max_steps, out=folder, console=console
    )
    console.print(table)
    tell_file(folder / "episode.json")
    console.print(f"Wrote episode.json and episode.png in {folder}")


def belief(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    goal: Literal["snr", "los", "los-or-first", "fused"] = "fused",
    targets: int = 3,
    seed: int = 0,
    max_steps: int = 1000,
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Measure the belief about the target's place: is it calibrated, how much does it say, what does it cost.

    One policy drives, and beliefs with parts left out look on. Goes on after a kill if given the same folder; the
    scores do not depend on the number of workers.

    Example: robosim bench belief flat office --out out/belief

    Args:
        plans: Floor plans, or folders of them.
        goal: Who drives.
        targets: Tasks of each plan.
        seed: Seed of the tasks and of the noise.
        max_steps: Actions before giving up.
        work: Who does the work.
        out: Folder for the table and the plot; a new one under runs/ if not given.
    """
    from robosim.bench.belief import run

    check_some("plans", plans, PLANS)
    check_number("targets", targets, *TASKS, whole=True)
    check_number("seed", seed, *SEED, whole=True)
    check_number("max_steps", max_steps, *STEPS, whole=True)
    folder = folder_for(out, "bench belief")
    with going_on(folder):
        table = run(
            plans,
            goal=goal,
            targets=targets,
            seed=seed,
            max_steps=max_steps,
            workers=work.count,
            cluster=work.cluster,
            out=folder,
            console=console,
        )
    console.print(table)
    tell_file(folder / "belief.json")
    console.print(f"Wrote belief.json and belief.png in {folder}")


def positioning(
    paths: Positional[Path],
    *,
    turn_deg: float = 0.0,
    out: Path | None = None,
) -> None:
    """Find receivers and the transmitter of a real hall from measured radio paths, and compare with the truth.

    Line of sight and single bounces, directions at both ends and delays; the clocks need not agree. Two minutes for
    45 places.

    Example: robosim bench positioning paths.csv --turn-deg -1.6 --out out/positioning

    Args:
        paths: Table with a row for each path (.csv): place, tx_x_m, tx_y_m, tx_heading_rad, rx_x_m, rx_y_m,
            rx_heading_rad, range_m, aod_rad, aoa_rad.
        turn_deg: What the transmitter's heading in the table is corrected by [deg].
        out: Folder for the table and the plot; a new one under runs/ if not given.
    """
    from robosim.bench.positioning import run
    from robosim.published.measured_paths import read_measured_paths
    from wireless.positioning.single_bounce import PositioningConfig

    check_number("turn_deg", turn_deg, -360, 360, "degrees")
    hall = read_measured_paths(paths, math.radians(turn_deg))
    with results_in(out, "bench positioning") as folder:
        console.print(run(hall, folder, PositioningConfig(), console))
    tell_file(folder / "positioning.json")
    console.print(f"Wrote the table and the plot in {folder}")


def environment(
    plan: Positional[str] = "flat",
    *,
    robots: int = 16,
    links: int = 300,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Measure environments: steps per second of CPU by what is observed; and radio tables: errors by what they cost.

    Beside environments of Gymnasium-Robotics and MiniWorld where these are installed. Two minutes.

    Example: robosim bench environment flat --out out/environment

    Args:
        plan: Floor plan to search in.
        robots: Robots in one process, beside one alone.
        links: Places at which radio tables are compared with the tracer, for each of three transmitters.
        seed: Seed of tasks, actions and places.
        out: Folder for the tables and plots; a new one under runs/ if not given.
    """
    from robosim.bench.environment import run

    check_number("robots", robots, 1, 4096, whole=True)
    check_number("links", links, 10, 100_000, whole=True)
    check_number("seed", seed, *SEED, whole=True)
    with results_in(out, "bench environment") as folder:
        for one in run(read(plan), robots=robots, links=links, seed=seed, out=folder, console=console):
            console.print(one)
    tell_file(folder / "environment.json")
    console.print(f"Wrote environment.json, environment.png and radio_tables.png in {folder}")
