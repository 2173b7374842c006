"""Looking for garbage, put off while a process loads what it keeps until its end.

Python would look through all of it again and again, which takes a seventh of a start.
"""

import gc


def look_for_garbage() -> None:
    """From now on, if that was put off (`gc.disable`), and not in what is loaded by now."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()
