"""Memory and time that a scene takes to be prepared for tracing in space, before the work begins.

Measured at 100,000, 300,000 and 1,000,000 triangles: a terrain of random heights, which has a facet per triangle, takes
4,100 bytes and 90 to 120 us per triangle; houses of 12 triangles with their bottoms in one plane 2,400 bytes and 80,
120 and 520 us, as that plane's outline grows.
"""

import logging
import os
from multiprocessing import parent_process

from robosim.support.reading import FileError

logger = logging.getLogger(__name__)

#: Most memory per triangle that was measured [bytes], and most time of one core [s].
BYTES_PER_TRIANGLE, SECONDS_PER_TRIANGLE = 4200, 5e-4
#: Larger scenes are prepared only if that is confirmed, as are those that take more than this share of all memory.
MOST_TRIANGLES, MOST_MEMORY = 2_000_000, 0.5
#: Memory and time are reported from so many triangles on.
_REPORTED = 100_000


def check_size(n_triangles: int) -> None:
    """Raise FileError for a scene whose preparation takes too much memory or time."""
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if n_triangles > min(MOST_TRIANGLES, MOST_MEMORY * memory / BYTES_PER_TRIANGLE):
        raise FileError(
            f"it has {n_triangles} triangles, whose preparation takes up to {size_text(n_triangles)} per process, on a "
            f"machine of {memory / 1e9:.3g} GB: expected at most {MOST_TRIANGLES} triangles and half of the memory. "
            "Simplify its meshes, or confirm it by --allow-large (allow_large=True)."
        )


def report_size(n_triangles: int) -> None:
    """Report memory and time of the preparation of a large scene, in the first of several processes."""
    if n_triangles >= _REPORTED and parent_process() is None:
        text = size_text(n_triangles)
        logger.warning(f"Preparing {n_triangles} triangles for tracing takes up to {text} per process.")


def size_text(n_triangles: int) -> str:
    """Memory and time that the preparation of triangles takes, in words."""
    seconds = n_triangles * SECONDS_PER_TRIANGLE
    time = f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
    return f"{n_triangles * BYTES_PER_TRIANGLE / 1e9:.1f} GB and {time}"
