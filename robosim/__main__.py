"""`python -m robosim` is the `robosim` command.

Ctrl-C while this program is still being loaded, or as Python shuts down, ends it without a word too.
"""

import gc
import os
import signal
import sys


def main() -> None:
    """Entry point of the `robosim` command as a program of its own."""
    # The program takes a second to load, in which there is nothing to clean up: Ctrl-C ends it without a traceback.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, lambda number, frame: os._exit(128 + number))
    # Imports create many objects and little garbage: by default, searches for it take a sixth of a start.
    gc.set_threshold(200_000, 20, 50)
    try:
        import robosim

        if not hasattr(robosim, "__getattr__"):  # another project's files have replaced this one's
            from robosim.support.installation import namesake

            sys.exit(
                f"robosim: {namesake() or 'another project replaced files of it. Install robosim-wireless again'}"
            )
        from robosim.cli import main as command

        if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        command()
    except KeyboardInterrupt:
        sys.exit(128 + signal.SIGINT)
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)


# Processes that commands spawn may import this module again.
if __name__ == "__main__":
    main()
