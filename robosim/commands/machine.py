"""`robosim doctor` and `robosim warm-up`."""

import sys
from dataclasses import asdict
from time import perf_counter

from rich.table import Table

from robosim.commands.output import console, emit_result
from robosim.support.installation import package_version


def doctor(*, speed: bool = False) -> None:
    """Check this machine: what works, how fast, and how to fix the rest.

    Args:
        speed: Whether to measure rates of camera, tracing, estimation and a search, in half a minute.
    """
    from robosim.doctor import examine, report

    with console.status("checking ..."):
        findings = examine()
    works = report(findings, console)
    rates = _rates() if speed and works else []
    rows = [asdict(finding) for finding in findings]
    emit_result({"robosim": package_version(), "works": works, "findings": rows, "rates": rates})
    if not works:
        sys.exit(1)


def warm_up(*, episode: bool = False) -> None:
    """Compile all loops, once for each version and machine.

    Args:
        episode: Compile only the loops of an episode with the default robot, sensors and radio, in a third of the time.
    """
    from robosim.warm_up import warm_up

    begin = perf_counter()
    with console.status("compiling loops ...") as status:
        count = warm_up(
            lambda done: status.update(f"compiling loops: {done}, {perf_counter() - begin:.0f} s"),
            episode=episode,
        )
    seconds = round(perf_counter() - begin, 1)
    console.print(f"Compiled {count} loops in {seconds} s." if count else "All loops were compiled before.")
    emit_result({"compiled": count, "seconds": seconds})


def _rates() -> list[dict[str, object]]:
    """Rates of this machine, printed and as they go into JSON."""
    from robosim.rates import measure_rates

    with console.status("measuring ..."):
        rates = list(measure_rates())
    table = Table(title="One core of this machine, by processor time", box=None, pad_edge=False)
    table.add_column("")
    table.add_column("a second", justify="right")
    table.add_column("")
    for rate in rates:
        table.add_row(rate.name, f"{rate.per_s:,.0f}", rate.unit)
    console.print(table)
    return [rate._asdict() for rate in rates]
