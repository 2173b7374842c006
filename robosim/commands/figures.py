"""`robosim figures`."""

from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from robosim.commands.speaking import console, tell
from robosim.commands.terminal import (
    read,
    results_in,
)
from robosim.support.checks import PLANS, SEED, check_number, check_some
from wireless.support.counting import counted


def plans(
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
    from robosim.generator.generate import GeneratorConfig, generate_plan
    from robosim.generator.planstats import plot_comparison
    from robosim.plans.files import find_plans, read_plan
    from robosim.support.progress import tracked

    check_some("plans", plans, PLANS)
    check_number("count", count, 1, 100_000, "plans to compare with", whole=True)
    check_number("seed", seed, *SEED, whole=True)
    with tracked(find_plans(plans), "reading", console) as paths:
        real = [read_plan(path) for path in paths]
    config = GeneratorConfig(navigable=True)
    with tracked(range(seed, seed + count), "generating", console) as numbers:
        made = [generate_plan(number, config=config) for number in numbers]
    with results_in(out, "figures") as folder:
        path = folder / "plans.png"
        plot_comparison(real, made, path)
    tell({"files": [path.name]}, folder)
    console.print(f"Wrote {path}: {counted(len(real), 'real plan')} and {counted(count, 'generated one')}")


def arrays(*, element: Literal["patch", "3gpp", "isotropic"] = "patch", out: Path | None = None) -> None:
    """Draw antenna elements, and the beams and coverage of the base station's and the robot's three arrays.

    Example: robosim figures arrays --out out/figures

    Args:
        element: What the arrays are made of.
        out: Folder for the picture; a new one under runs/ if not given.
    """
    from robosim.support.figures import save_figure
    from wireless.antennas.figures import arrays_figure

    with results_in(out, "figures") as folder:
        path = folder / "arrays.png"
        save_figure(arrays_figure(element), path)
    tell({"files": [path.name]}, folder)
    console.print(f"Wrote {path}: elements, beams and coverage of the terminals gnb and ue")


def wireless(
    plans: Positional[tuple[str, ...]] = ("flat",),
    *,
    links: int = 2000,
    grid: float = 0.15,
    tolerance: float | None = None,
    classifier: str | None = None,
    training: tuple[Path, ...] = (),
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Draw the published figures of radio from any plans: arrays, links, angles, training, maps of link states.

    index.html in the folder shows all of them with captions and the published numbers.

    Example: robosim figures wireless flat office --out out/figures

    Args:
        plans: Floor plans, or folders of them; links and maps are of the first.
        links: Links of each plan for errors of angles.
        grid: Step between receivers of the map of link states [m].
        tolerance: How far walls may be moved to save corners [m]; left out, walls under staircases are
            straight, but for published grids; 0 keeps every cell.
        classifier: What tells link states: a shipped one by name, or a file of `robosim train link-state`; if not
            given, a shipped one that goes by our own estimates.
        training: Folders of `robosim train link-state`, for curves and confusion matrices; those of the shipped
            classifiers if not given.
        seed: Seed of places, phases and noise.
        out: Folder for the pictures; a new one under runs/ if not given.
    """
    from robosim.figures.wireless import FiguresConfig, draw_wireless
    from robosim.plans.files import find_plans

    check_some("plans", plans, PLANS)
    config = FiguresConfig(
        links=links, grid_m=grid, tolerance_m=tolerance, classifier=classifier, training=training, seed=seed
    )
    found = [read(str(plan)) for plan in find_plans(plans)]
    with results_in(out, "figures") as folder:
        page, notes = draw_wireless(found, folder, config, console)
    tell({"page": page.name, "notes": notes}, folder)
    for note in notes:
        console.print(note)
    console.print(f"Wrote {page} and the pictures that it shows")


def search(
    results: Positional[Path], *, stuck: str = "snr", better: str = "los-or-first", out: Path | None = None
) -> None:
    """Draw the published figures of the search from an evaluation: arrival rates, relative times, an example.

    The example is one start with two policies, where following paths of higher order gets stuck; it is found in the
    episodes. index.html in the folder shows all of them with captions and the published numbers. An evaluation
    that is still running can be drawn too.

    Example: robosim figures search out/evaluation --out out/figures

    Args:
        results: Folder of `robosim evaluate`.
        stuck: Policy of the example that gets stuck.
        better: Policy that is shown beside it.
        out: Folder for the pictures; a new one under runs/ if not given.
    """
    from robosim.evaluation.evaluate import check_policies
    from robosim.evaluation.search_figures import draw_search

    (follower,), (other,) = check_policies([stuck]), check_policies([better])
    with results_in(out, "figures") as folder:
        page, notes = draw_search(results, folder, follower, other)
    tell({"page": page.name, "notes": notes}, folder)
    for note in notes:
        console.print(note, highlight=False)
    console.print(f"Wrote {page} and the pictures that it shows")
