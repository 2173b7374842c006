"""`robosim figures`."""

from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from robosim.commands.terminal import console, folder_for


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
    from rich.progress import track

    from robosim.generate import GeneratorConfig, generate_plan
    from robosim.generator.planstats import plot_comparison
    from robosim.planfiles import find_plans, read_plan

    if count < 1:
        raise ValueError(f"count is {count}, expected at least one plan to compare with.")
    real = [read_plan(path) for path in track(find_plans(plans), "reading", console=console, transient=True)]
    config = GeneratorConfig(navigable=True)
    numbers = track(range(seed, seed + count), "generating", console=console, transient=True)
    made = [generate_plan(number, config=config) for number in numbers]
    path = folder_for(out, "figures-plans") / "plans.png"
    plot_comparison(real, made, path)
    console.print(f"Wrote {path}: {len(real)} real plans beside {count} generated ones")


def arrays(*, element: Literal["patch", "3gpp", "isotropic"] = "patch", out: Path | None = None) -> None:
    """Draw antenna elements, and the beams and coverage of the base station's and the robot's three arrays.

    Example: robosim figures arrays --out out/figures

    Args:
        element: What the arrays are made of.
        out: Folder for the picture; a new one under runs/ if not given.
    """
    from robosim.plots import save_figure
    from wireless.antenna_figures import arrays_figure

    path = folder_for(out, "figures-arrays") / "arrays.png"
    save_figure(arrays_figure(element), path)
    console.print(f"Wrote {path}: elements, beams and coverage of the terminals gnb and ue")
