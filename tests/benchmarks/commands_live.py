"""`python -m tests.benchmarks live`."""

from pathlib import Path

from tyro.conf import Positional

from robosim.commands.output import console, emit_result_file
from robosim.commands.shared_options import read, results_folder
from robosim.support.checks import PLANS, SEED, STEPS, check_number, check_some


def live(
    plans: Positional[tuple[str, ...]],
    *,
    moves: int = 200,
    decisions: int = 60,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Measure the page of `robosim live`: how soon rays follow a drag, and what watching costs a search.

    Needs the extra `live`; with Playwright and Chromium drags are timed in a browser too.

    Example: python -m tests.benchmarks live office

    Args:
        plans: Floor plans.
        moves: Moves of the transmitter in each case.
        decisions: Decisions of a search.
        seed: Seed of the search.
        out: Folder for the table; a new one under runs/ if not given.
    """
    from robosim.live.server import viser_module

    check_some("plans", plans, PLANS)
    check_number("moves", moves, 10, 100_000, whole=True)
    check_number("decisions", decisions, *STEPS, whole=True)
    check_number("seed", seed, *SEED, whole=True)
    viser_module()
    with results_folder(out, "bench live") as folder:
        from tests.benchmarks.live import run

        console.print(
            run([read(plan) for plan in plans], out=folder, moves=moves, decisions=decisions, seed=seed)
        )
    emit_result_file(folder / "live.json")
    console.print(f"Wrote live.json in {folder}")
