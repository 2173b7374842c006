"""`python -m tests.benchmarks`, of what is simulated and of whole searches: speed against error."""

from pathlib import Path
from typing import Literal

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
from robosim.support.checks import PLANS, SEED, SIZE_PX, STEPS, TASKS, check_number, check_some


def render(*, plan: str = "flat", sizes: tuple[int, ...] = (128, 256), out: Path | None = None) -> None:
    """Measure cameras: frames per second against depth error, with the usual alternatives beside ours.

    Args:
        plan: Floor plan to draw.
        sizes: Widths of the square pictures [pixels].
        out: Folder for the table and the plot; a new one under runs/ if not given.
    """
    from robosim.building.building import make_building
    from tests.benchmarks.render import run

    check_some("sizes", sizes, "widths of pictures, such as 128 256")
    for size in sizes:
        check_number("sizes", size, *SIZE_PX, whole=True)
    with results_folder(out, "bench render") as folder:
        console.print(run(make_building(read(plan)), sizes=sizes, out=folder))
    emit_result_file(folder / "render.json")
    console.print(f"Wrote the table and the plot in {folder}")


def physics(*, plans: tuple[str, ...] = ("flat", "office"), out: Path | None = None) -> None:
    """Measure driving: steps per second against motion error, over time steps and against kinematic.

    Args:
        plans: Floor plans to drive in.
        out: Folder for the table and the plot; a new one under runs/ if not given.
    """
    from robosim.building.building import make_building
    from tests.benchmarks.physics import run

    check_some("plans", plans, PLANS)
    with results_folder(out, "bench physics") as folder:
        console.print(run([make_building(read(name)) for name in plans], out=folder))
    emit_result_file(folder / "physics.json")
    console.print(f"Wrote the table and the plot in {folder}")


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

    Example: python -m tests.benchmarks episode flat office --out out/episodes

    Args:
        plans: Floor plans, or folders of them.
        goal: Who chooses the goals.
        targets: Tasks of each plan.
        seed: Seed of the tasks and of the noise.
        max_steps: Actions before giving up.
        out: Folder for the table and the plot; a new one under runs/ if not given.
    """
    from tests.benchmarks.episode import run

    check_some("plans", plans, PLANS)
    check_number("targets", targets, *TASKS, whole=True)
    check_number("seed", seed, *SEED, whole=True)
    check_number("max_steps", max_steps, *STEPS, whole=True)
    folder = output_folder(out, "bench episode")
    table = run(
        plans, goal=goal, targets=targets, seed=seed, max_steps=max_steps, out=folder, console=console
    )
    console.print(table)
    emit_result_file(folder / "episode.json")
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

    Example: python -m tests.benchmarks belief flat office --out out/belief

    Args:
        plans: Floor plans, or folders of them.
        goal: Who drives.
        targets: Tasks of each plan.
        seed: Seed of the tasks and of the noise.
        max_steps: Actions before giving up.
        work: Who does the work.
        out: Folder for the table and the plot; a new one under runs/ if not given.
    """
    from tests.benchmarks.belief import run

    check_some("plans", plans, PLANS)
    check_number("targets", targets, *TASKS, whole=True)
    check_number("seed", seed, *SEED, whole=True)
    check_number("max_steps", max_steps, *STEPS, whole=True)
    folder = output_folder(out, "bench belief")
    with resume_hint(folder):
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
    emit_result_file(folder / "belief.json")
    console.print(f"Wrote belief.json and belief.png in {folder}")


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

    Example: python -m tests.benchmarks environment flat --out out/environment

    Args:
        plan: Floor plan to search in.
        robots: Robots in one process, beside one alone.
        links: Places at which radio tables are compared with the tracer, for each of three transmitters.
        seed: Seed of tasks, actions and places.
        out: Folder for the tables and plots; a new one under runs/ if not given.
    """
    from tests.benchmarks.environment import run

    check_number("robots", robots, 1, 4096, whole=True)
    check_number("links", links, 10, 100_000, whole=True)
    check_number("seed", seed, *SEED, whole=True)
    with results_folder(out, "bench environment") as folder:
        for one in run(read(plan), robots=robots, links=links, seed=seed, out=folder, console=console):
            console.print(one)
    emit_result_file(folder / "environment.json")
    console.print(f"Wrote environment.json, environment.png and radio_tables.png in {folder}")
