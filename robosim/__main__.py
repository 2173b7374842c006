"""`python -m robosim` is the `robosim` command."""

from robosim.cli import main

main()
