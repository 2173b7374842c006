"""`robosim dataset`."""

import json
from pathlib import Path
from shlex import quote
from typing import Annotated, Literal

import tyro
from rich.text import Text
from tyro.conf import OmitArgPrefixes, Positional

from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import (
    ALL_CORES,
    DEFAULT_RADIO,
    NO_OPTIONS,
    RadioOptions,
    Reading,
    Work,
    output_folder,
    read_place,
    resume_hint,
)
from robosim.parts import EstimatorPart, TerminalPart
from robosim.support.checks import Range
from wireless.support.counting import counted


def dataset(
    plans: Positional[tuple[str, ...]] = (),
    *,
    generated: Annotated[int, Range(0, 100_000, "homes")] = 0,
    tx_per_plan: int = 10,
    grid: float = 0.15,
    seed: int = 0,
    estimator: EstimatorPart = "sage",
    transmitter: TerminalPart = "gnb",
    receiver: TerminalPart = "ue",
    headings: Literal["fixed", "random"] = "fixed",
    format: Annotated[tuple[Literal["mmwrobotnav", "deepmimo"], ...], tyro.conf.UseAppendAction] = (),
    radio: OmitArgPrefixes[RadioOptions] = DEFAULT_RADIO,
    reading: Reading = NO_OPTIONS,
    work: Work = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Make a data set of links: true paths, link states, and what a receiver with beams estimates of them.

    Transmitters are placed at random, receivers on a grid. Links are traced, sounded in closed form with the
    reference's base station and robot, and estimated. Writes links/NAME_Tx_K.parquet, one row per link, and
    manifest.json, which describes them. The same command resumes an interrupted run, to the same bytes with any number
    of workers.

    Example: robosim dataset flat office --tx-per-plan 10 --grid 0.15 --out out/links

    Args:
        plans: Floor plans, or folders of them, or YAML files of buildings of several storeys.
        generated: Additional generated homes, from --seed on.
        tx_per_plan: Transmitters in each building.
        grid: Step between receivers [m].
        seed: Seed of places, phases and noise, and of the first generated home.
        estimator: Path estimator: sage, maximum likelihood of all paths together, or pca, the reference's, faster and
            less accurate.
        transmitter: Antennas of the transmitter; gnb are those of the published base station.
        receiver: Antennas of the receiver; ue are those of the published robot.
        headings: Headings of receivers: fixed, as published, or random, as of a moving robot.
        format: Additional formats: CSV files of mmwRobotNav or DeepMIMO v4 scenarios; can be given several times.
        radio: Which paths are traced.
        reading: How to read the plans.
        work: Worker processes.
        out: Output folder, also of a run to resume; by default a new one under runs/.
    """
    from robosim.datasets.link_units import LinkSetConfig
    from robosim.datasets.links import make_dataset
    from robosim.generator.generate import generate_plan
    from robosim.plans.files import find_plans

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
        radio=radio.config(),
    )
    folder = output_folder(out, "dataset")
    with console.status("reading plans ..."):
        buildings = [read_place(str(plan), reading) for plan in find_plans(plans)]
        buildings += [generate_plan(number) for number in range(seed, seed + generated)]
    with resume_hint(folder):
        made = make_dataset(
            buildings, config, folder, workers=work.count, cluster=work.cluster, console=console
        )
    emit_result(made, folder)
    rows, timing = made["rows"], made["timing"]
    shares = ", ".join(f"{name} {100 * n / rows:.1f} %" for name, n in made["states"].items())
    details = f": {shares}; {timing['links']} made in {timing['seconds']:.1f} s ({timing['links_per_s']:.0f} links/s)"
    console.print(Text.assemble((counted(rows, "link"), "bold"), details))
    console.print(
        f"Wrote {counted(len(made['units']), 'table')} in {folder / 'links'}, and manifest.json, which describes them"
    )
    read_all = f"import pyarrow.parquet as p; print(p.read_table({json.dumps(str(folder / 'links'))}))"
    console.print(f"Next: python -c {quote(read_all)}", soft_wrap=True)
