"""Reads shards of `robosim.datasets.collect`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from robosim.datasets.collect import SHARD
from robosim.support.arrays_in import read_npz
from robosim.support.reading import reading

#: Bytes of a shard, packed and unpacked.
_MOST_BYTES = 400_000_000
#: Least and largest height or width of a depth image.
_SIDES = (8, 4096)


def read_shard(path: Path, names: Sequence[str]) -> list[np.ndarray]:
    """Arrays of a shard; FileError if the file is not one."""
    with reading(path, "a shard of `robosim collect`", "Collect it again.", most_bytes=_MOST_BYTES) as file:
        arrays = read_npz(file, {name: SHARD[name] for name in names}, most_bytes=_MOST_BYTES)
        frames, *size = arrays["depth"].shape if "depth" in arrays else (1, *_SIDES)
        if not (frames and _SIDES[0] <= min(size) and max(size) <= _SIDES[1]):
            raise ValueError(f"it has {frames} frames of {size[0]} x {size[1]} pixels")
    return [arrays[name] for name in names]
