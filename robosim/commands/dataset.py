"""`robosim dataset`."""

import json
from pathlib import Path
from shlex import quote
from typing import Annotated, Literal

import tyro
from rich.text import Text
from tyro.conf import OmitArgPrefixes, Positional

from robosim.commands.radio import DEFAULT_RADIO, RadioOptions
from robosim.commands.speaking import console, tell
from robosim.commands.terminal import (
    ALL_CORES,
    NO_OPTIONS,
    PlanOptions,
    WorkOptions,
    folder_for,
    going_on,
    read_place,
)
from robosim.parts import EstimatorPart, TerminalPart
from robosim.support.checks import check_number
from wireless.support.counting import counted


def dataset(
    plans: Positional[tuple[str, ...]] = (),
    *,
    generated: int = 0,
    tx_per_plan: int = 10,
    grid: float = 0.15,
    seed: int = 0,
    estimator: EstimatorPart = "sage",
    transmitter: TerminalPart = "gnb",
    receiver: TerminalPart = "ue",
    headings: Literal["fixed", "random"] = "fixed",
    format: Annotated[tuple[Literal["mmwrobotnav", "deepmimo"], ...], tyro.conf.UseAppendAction] = (),
    tolerance: float | None = None,
    radio: OmitArgPrefixes[RadioOptions] = DEFAULT_RADIO,
    reading: OmitArgPrefixes[PlanOptions] = NO_OPTIONS,
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Make a data set of links: true paths, link states, and what a receiver with beams estimates of them.

    Transmitters are put at random, receivers on a grid. Links are traced, sounded by the closed form with the
    reference's base station and robot, and estimated. Writes links/NAME_Tx_K.parquet, a row a link, and
    manifest.json, which tells what is in them. A long run that was interrupted or killed goes on when the same
    command is given again, to the same bytes with any number of workers.

    Example: robosim dataset flat office --tx-per-plan 10 --grid 0.15 --out out/links

    Args:
        plans: Floor plans, or folders of them, or YAML files of buildings of several storeys.
        generated: So many generated homes too, from --seed on.
        tx_per_plan: Transmitters in each building.
        grid: Step between receivers [m].
        seed: Seed of places, phases and noise, and of the first generated home.
        estimator: sage, likelihood of all paths together, or pca, the reference's, less sharp and faster.
        transmitter: Antennas that send; gnb is the published base station's.
        receiver: Antennas that receive; ue is the published robot's.
        headings: Where receivers' arrays face: fixed, as published, or random, as a robot's that drives about.
        format: Written too: CSV files of mmwRobotNav or DeepMIMO v4 scenarios; can be given several times.
        tolerance: How far walls may be moved to save corners [m], faster; left out, walls under staircases are
            straight, but for published grids; 0 keeps every cell.
        radio: Which paths are traced.
        reading: How to read the plans, where they do not say.
        work: Who does the work.
        out: Folder for the data, and to go on from; a new one under runs/ if not given.
    """
    from robosim.datasets.link_units import LinkSetConfig
    from robosim.datasets.links import make_dataset
    from robosim.generator.generate import generate_plan
    from robosim.plans.files import find_plans

    check_number("generated", generated, 0, 100_000, "homes", whole=True)
    if not plans and not generated:
        raise ValueError(
            f"plans is empty and generated is {generated}: give floor plans or folders of them, or --generated 50."
        )
    config = LinkSetConfig(
        tx_per_plan=tx_per_plan,
        grid_m=grid,
        seed=seed,
        estimator=estimator,
        tx=transmitter,
        rx=receiver,
        headings=headings,
        formats=tuple(sorted(set(format))),
        radio=radio.config(tolerance),
    )
    folder = folder_for(out, "dataset")
    with console.status("reading plans ..."):
        buildings = [read_place(str(plan), reading) for plan in find_plans(plans)]
        buildings += [generate_plan(number) for number in range(seed, seed + generated)]
    with going_on(folder):
        made = make_dataset(
            buildings, config, folder, workers=work.count, cluster=work.cluster, console=console
        )
    tell(made, folder)
    rows, timing = made["rows"], made["timing"]
    shares = ", ".join(f"{name} {100 * n / rows:.1f} %" for name, n in made["states"].items())
    told = f": {shares}; {timing['links']} made in {timing['seconds']:.1f} s ({timing['links_per_s']:.0f} links/s)"
    console.print(Text.assemble((counted(rows, "link"), "bold"), told))
    console.print(
        f"Wrote {counted(len(made['units']), 'table')} in {folder / 'links'}, and manifest.json, which describes them"
    )
    read_all = f"import pyarrow.parquet as p; print(p.read_table({json.dumps(str(folder / 'links'))}))"
    console.print(f"Next: python -c {quote(read_all)}", soft_wrap=True)
