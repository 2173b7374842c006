"""`robosim evaluate`."""

import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional

from robosim.commands.episode_config import AS_PUBLISHED, DEFAULTS, Base, Settings, words_of
from robosim.commands.speaking import console, tell, tell_file
from robosim.commands.terminal import (
    ALL_CORES,
    WorkOptions,
    folder_for,
    going_on,
)
from robosim.evaluation.evaluate import check_policies, find_suite, summary_table
from robosim.evaluation.evaluate import evaluate as run
from robosim.evaluation.suite import SUFFIXES, write_suite
from robosim.parts import READER
from robosim.support.checks import PLANS, SEED, TASKS, check_number, check_some


def evaluate(
    plans: Positional[tuple[str, ...]],
    *,
    targets: int | None = None,
    policies: tuple[str, ...] = (),
    seeds: int = 1,
    seed: int | None = None,
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    reader: Annotated[str, READER.option("auto")] = "auto",
    base: Base = AS_PUBLISHED,
    settings: Settings = DEFAULTS,
    suite_out: Path | None = None,
    out: Path | None = None,
) -> None:
    """Compare goal policies: the same searches by all of them, and how often and how fast they arrive.

    Writes episodes.parquet (one row an episode), timing.parquet, summary.json, report.html with its pictures,
    and suite.yaml, which can be given instead of floor plans. A run that was stopped or killed goes on when the
    same command is given again; policies, targets and seeds can be added. The results do not depend on the
    number of workers. The last lines are the summary.

    Example: robosim evaluate flat office --targets 5 --policies los-or-first visual --out out/evaluation

    Args:
        plans: Floor plans by file or name, folders of them, or one suite file.
        targets: Tasks of each plan; 10 if not given, or what the suite has.
        policies: Who chooses the goals, as in `robosim episode`; all but explore and variants of fused if not
            given, module:Name for your own. The oracle always runs: difficulty and times go by its steps.
        seeds: Episodes of each task and policy, with other noise.
        seed: What tasks and noise are drawn from; 0 if not given, or what the suite has.
        work: Who does the work.
        reader: Who reads the plans: auto goes by their ending; module:Name is one of your own.
        base: What the options below start from.
        settings: How the episodes are run.
        suite_out: Where to write the suite beside the results, as .yaml or .json.
        out: Folder for the results, and to go on from; a new one under runs/ if not given.
    """
    check_some("plans", plans, f"{PLANS}, or a suite file")
    for name, value, bounds in (("targets", targets, TASKS), ("seeds", seeds, TASKS), ("seed", seed, SEED)):
        if value is not None:
            check_number(name, value, *bounds, whole=True)
    if suite_out is not None and suite_out.suffix.lower() not in SUFFIXES:
        raise ValueError(
            f"suite_out is {str(suite_out)!r}, expected a name that ends in {', '.join(SUFFIXES)}."
        )
    names, config = check_policies(policies), settings
    folder = folder_for(out, "evaluate")
    with going_on(folder):
        suite = find_suite(
            plans,
            config,
            targets=targets,
            seed=seed,
            reader=reader,
            workers=work.count,
            cluster=work.cluster,
            console=console,
        )
        if suite_out is not None:
            write_suite(suite, suite_out)
        result = run(
            suite,
            folder,
            config=config,
            policies=names,
            repeats=seeds,
            workers=work.count,
            cluster=work.cluster,
            console=console,
            options=words_of(settings),
        )
    if result.rows:
        tell_file(folder / "summary.json", warnings=result.warnings)
    else:
        tell({"summary": [], "warnings": result.warnings}, folder)
    for line in result.warnings:
        console.print(line, style="yellow", highlight=False, soft_wrap=True)
    if result.rows:
        console.print(f"Wrote report.html, episodes.parquet and summary.json in {folder}")
        console.print(summary_table(result.summaries))
    if result.errors:
        sys.exit(1)
