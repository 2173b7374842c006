"""`robosim doctor` and `robosim warm-up`."""

import sys
from dataclasses import asdict
from time import perf_counter

from robosim.commands.output import console, emit_result
from robosim.support.installation import package_version


def doctor() -> None:
    """Check this machine: what works, how fast, and how to fix the rest."""
    from robosim.doctor import examine, report

    with console.status("checking ..."):
        findings = examine()
    works = report(findings, console)
    rows = [asdict(finding) for finding in findings]
    emit_result({"robosim": package_version(), "works": works, "findings": rows})
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
