"""`robosim doctor`."""

import sys
from dataclasses import asdict

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
