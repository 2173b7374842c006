"""`robosim doctor`."""

import sys

from robosim.commands.terminal import console


def doctor() -> None:
    """Check this machine: what works, how fast, and what to install where something does not."""
    from robosim.doctor import examine, report

    with console.status("looking ..."):
        findings = examine()
    if not report(findings, console):
        sys.exit(1)
