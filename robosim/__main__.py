"""`python -m robosim` is the `robosim` command."""

from robosim.cli import main

# Processes that commands spawn import this module again.
if __name__ == "__main__":
    main()
