"""`robosim doctor`."""

import sys
from dataclasses import asdict

from robosim.commands.speaking import console, tell
from robosim.support.installation import package_version


def doctor() -> None:
    """Check this machine: what works, how fast, and what to install where something does not."""
    from robosim.doctor import examine, report

    with console.status("looking ..."):
        findings = examine()
    works = report(findings, console)
    told = [asdict(finding) for finding in findings]
    tell({"robosim": package_version(), "works": works, "findings": told})
    if not works:
        sys.exit(1)
