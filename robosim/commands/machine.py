"""`robosim doctor`."""

import sys
from dataclasses import asdict
from importlib.metadata import version

from robosim.commands.speaking import console, tell


def doctor() -> None:
    """Check this machine: what works, how fast, and what to install where something does not."""
    from robosim.doctor import examine, report

    with console.status("looking ..."):
        findings = examine()
    works = report(findings, console)
    told = [asdict(finding) for finding in findings]
    tell({"robosim": version("robosim"), "works": works, "findings": told})
    if not works:
        sys.exit(1)
