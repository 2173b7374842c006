"""Arrays that take long to compute and depend on little, cached on disk under a digest of all that they depend on.

Files are in the folder of compiled loops (`robosim.support.compiled`). A checksum detects damaged ones.
If no folder is writable, each process computes the array. The digest covers the processor and the versions of the
libraries too, since last bits depend on them.
"""

import hashlib
import io
import logging
import os
import uuid
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from itertools import accumulate
from pathlib import Path

import numpy as np

from robosim.support.compiled import cache_folders, writable_folder

logger = logging.getLogger(__name__)

#: Most arrays of one name on disk, for different values, processors and states of the source.
MAX_FILES = 16
#: Most bytes of the files of one name; larger arrays are computed each time.
MAX_BYTES = 256_000_000


def cached_array(
    name: str, made_of: Iterable[bytes], code: Iterable[Path], make: Callable[[], np.ndarray]
) -> np.ndarray:
    """An array from disk, or computed and stored there."""
    return cached_arrays(name, made_of, code, lambda: [make()])[0]


def cached_arrays(
    name: str, made_of: Iterable[bytes], code: Iterable[Path], make: Callable[[], Sequence[np.ndarray]]
) -> Sequence[np.ndarray]:
    """Arrays that are computed together, from disk, or computed and stored there in one file."""
    import llvmlite.binding
    import numba

    key = hashlib.sha256()
    machine = ("npz", np.__version__, numba.__version__, llvmlite.binding.get_host_cpu_name())
    for source in (*made_of, *(file.read_bytes() for file in code), repr(machine).encode()):
        key.update(hashlib.sha256(source).digest())
    folder = writable_folder(cache_folders())
    if folder is None:
        return make()
    file = folder / f"{name}-{key.hexdigest()[:32]}.cached"
    with suppress(OSError):
        content = file.read_bytes()
        if hashlib.sha256(content[32:]).digest() == content[:32]:
            os.utime(file)
            with np.load(io.BytesIO(content[32:]), allow_pickle=False) as arrays:
                return list(arrays.values())
    made = make()
    packed = io.BytesIO()
    np.savez(packed, *made)
    data = packed.getvalue()
    if len(data) > MAX_BYTES:
        return made
    partial = file.with_name(f".{file.name}.{uuid.uuid4().hex[:8]}.partial")
    try:
        partial.write_bytes(hashlib.sha256(data).digest() + data)
        partial.replace(file)
        files = sorted(folder.glob(f"{name}-*.cached"), key=lambda path: -path.stat().st_mtime)
        sizes = accumulate(path.stat().st_size for path in files)
        for number, (old, size) in enumerate(zip(files, sizes, strict=True)):
            if number >= MAX_FILES or size > MAX_BYTES:
                old.unlink(missing_ok=True)
    except OSError as error:  # a full disk costs the next process a second
        partial.unlink(missing_ok=True)
        logger.info(f"{file} cannot be cached: {error}")
    return made
