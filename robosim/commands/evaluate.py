"""`robosim evaluate`."""

import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from robosim.commands.episode_config import DEFAULT_START, DEFAULTS, Base, Settings, command_options
from robosim.commands.output import console, emit_result, emit_result_file
from robosim.commands.shared_options import ALL_CORES, Work, output_folder, resume_hint
from robosim.evaluation.evaluate import check_policies, find_suite, summary_table
from robosim.evaluation.evaluate import evaluate as run
from robosim.evaluation.suite import SUFFIXES, write_suite
from robosim.parts import READER
from robosim.support.checks import PLANS, SEED, TASKS, check_some


def evaluate(
    plans: Positional[tuple[str, ...]],
    *,
    targets: Annotated[int | None, TASKS] = None,
    policies: tuple[str, ...] = (),
    seeds: Annotated[int, TASKS] = 1,
    seed: Annotated[int | None, SEED] = None,
    work: Work = ALL_CORES,
    reader: Annotated[str, READER.option("auto")] = "auto",
    base: Base = DEFAULT_START,
    settings: Settings = DEFAULTS,
    suite_out: Path | None = None,
    out: Path | None = None,
) -> None:
    """Compare goal policies by how often and how fast they arrive, in the same searches.

    Writes episodes.parquet (one row per episode), timing.parquet, summary.json, report.html with its pictures, and
    suite.yaml, which can be given instead of floor plans. The same command resumes an interrupted run; policies,
    targets and seeds can be added. The results do not depend on the number of workers. The last lines are the summary.

    Example: robosim evaluate flat office --targets 5 --policies los-or-first visual --out out/evaluation

    Args:
        plans: Floor plans by file or name, folders of them, or one suite file.
        targets: Tasks of each plan; by default 10, or those of the suite.
        policies: Goal policies as in `robosim episode`; by default all but explore; module:Name
            is your own. The oracle always runs: difficulty and times are relative to its steps.
        seeds: Episodes of each task and policy, with different noise.
        seed: Seed of tasks and noise; by default 0, or that of the suite.
        work: Worker processes.
        reader: Reader of the plans: auto chooses by the ending; module:Name is your own.
        base: Values that the options below start from.
        settings: How the episodes are run.
        suite_out: Additional file for the suite, .yaml or .json.
        out: Output folder, also of a run to resume; by default a new one under runs/.
    """
    check_some("plans", plans, f"{PLANS}, or a suite file")
    if suite_out is not None and suite_out.suffix.lower() not in SUFFIXES:
        raise ValueError(
            f"suite_out is {str(suite_out)!r}, expected a name that ends in {', '.join(SUFFIXES)}."
        )
    names, config = check_policies(policies), settings
    folder = output_folder(out, "evaluate")
    with resume_hint(folder):
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
            options=command_options(settings),
        )
    if result.rows:
        emit_result_file(folder / "summary.json", warnings=result.warnings)
    else:
        emit_result({"summary": [], "warnings": result.warnings}, folder)
    for line in result.warnings:
        console.print(line, style="yellow", highlight=False, soft_wrap=True)
    if result.rows:
        console.print(f"Wrote report.html, episodes.parquet and summary.json in {folder}")
        console.print(summary_table(result.summaries))
    if result.errors:
        sys.exit(1)
