"""Figures of plans and searches."""

from pathlib import Path

from tyro.conf import Positional

from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import (
    results_folder,
)
from robosim.support.checks import PLANS, SEED, check_number, check_some
from wireless.support.counting import counted


def plans(
    plans: Positional[tuple[str, ...]], *, count: int = 200, seed: int = 0, out: Path | None = None
) -> None:
    """Compare generated buildings with real ones: size, rooms, walls, doors, narrowest passages.

    Example: python -m tests.benchmarks plans maps/*.yaml --out out/figures

    Args:
        plans: Real floor plans, or folders of them.
        count: How many plans to generate beside them.
        seed: Seed of the first one generated.
        out: Folder for the picture; a new one under runs/ if not given.
    """
    from robosim.generator.generate import GeneratorConfig, generate_plan
    from robosim.plans.files import find_plans, read_plan
    from robosim.support.progress import tracked
    from tests.benchmarks.plan_statistics import plot_comparison

    check_some("plans", plans, PLANS)
    check_number("count", count, 1, 100_000, "plans to compare with", whole=True)
    check_number("seed", seed, *SEED, whole=True)
    with tracked(find_plans(plans), "reading", console) as paths:
        real = [read_plan(path) for path in paths]
    config = GeneratorConfig(navigable=True)
    with tracked(range(seed, seed + count), "generating", console) as numbers:
        made = [generate_plan(number, config=config) for number in numbers]
    with results_folder(out, "figures") as folder:
        path = folder / "plans.png"
        plot_comparison(real, made, path)
    emit_result({"files": [path.name]}, folder)
    console.print(f"Wrote {path}: {counted(len(real), 'real plan')} and {counted(count, 'generated one')}")


def search(
    results: Positional[Path], *, stuck: str = "snr", better: str = "los-or-first", out: Path | None = None
) -> None:
    """Draw the published figures of the search from an evaluation: arrival rates, relative times, an example.

    The example is one start with two policies, where following paths of higher order gets stuck; it is found in the
    episodes. index.html in the folder shows all of them with captions and the published numbers. An evaluation
    that is still running can be drawn too.

    Example: python -m tests.benchmarks search out/evaluation --out out/figures

    Args:
        results: Folder of `robosim evaluate`.
        stuck: Policy of the example that gets stuck.
        better: Policy that is shown beside it.
        out: Folder for the pictures; a new one under runs/ if not given.
    """
    from robosim.evaluation.evaluate import check_policies
    from tests.benchmarks.search_figures import draw_search

    (follower,), (other,) = check_policies([stuck]), check_policies([better])
    with results_folder(out, "figures") as folder:
        page, notes = draw_search(results, folder, follower, other)
    emit_result({"page": page.name, "notes": notes}, folder)
    for note in notes:
        console.print(note, highlight=False)
    console.print(f"Wrote {page} and the pictures that it shows")
