"""Arrays that take long to compute and depend on little, cached on disk under a digest of all that they depend on.

Files lie next to compiled loops (`wireless.support.compiled_files`) and hold a checksum; damaged ones are made again.
If no folder can be written, each process computes the array. The digest covers the processor and the versions of the
libraries too, since last bits depend on them.
"""

import hashlib
import io
import logging
from collections.abc import Callable, Iterable
from pathlib import Path

import llvmlite.binding
import numba
import numpy as np

from wireless.support.compiled_files import first_writable, folders_of, read_checked, write_checked

logger = logging.getLogger(__name__)

#: Most arrays of one name on disk, for different values, processors and states of the source.
MAX_FILES = 16


def cached_array(
    name: str, made_of: Iterable[bytes], code: Iterable[Path], make: Callable[[], np.ndarray]
) -> np.ndarray:
    """An array from disk, or computed and stored there.

    Args:
        name: Beginning of the file's name.
        made_of: All values that the array depends on.
        code: Files of Python whose text it depends on.
        make: Computes it.
    """
    looks = hashlib.sha256()
    machine = (np.__version__, numba.__version__, llvmlite.binding.get_host_cpu_name())
    for part in (*made_of, *(file.read_bytes() for file in code), repr(machine).encode()):
        looks.update(hashlib.sha256(part).digest())
    folders = folders_of(Path(__file__))
    file = f"{name}-{looks.hexdigest()[:32]}.cached"
    for folder in folders:
        content = read_checked(folder / file)
        if content is not None:
            found: np.ndarray = np.load(io.BytesIO(content), allow_pickle=False)
            return found
    made = make()
    writable, _ = first_writable(folders)
    if writable is not None:
        packed = io.BytesIO()
        np.save(packed, made)
        try:
            write_checked(writable / file, packed.getvalue())
            for old in sorted(writable.glob(f"{name}-*.cached"), key=lambda path: path.stat().st_mtime)[
                :-MAX_FILES
            ]:
                old.unlink(missing_ok=True)
        except OSError as error:  # a full disk costs the next process a second
            logger.info("%s cannot be cached: %s", writable / file, error)
    return made
