"""Data sets of links and of frames for PyTorch: one dictionary of tensors per example, for any `DataLoader`.

Examples are in the order of files and of their rows. Split them by building or home rather than by example, since
neighbouring links and frames are alike.
"""

from collections import OrderedDict
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from robosim.datasets.collect import SHARD, read_shard
from robosim.support.installation import missing_extra
from robosim.support.reading import FileError, shown
from wireless.linkstate.data import read_links
from wireless.linkstate.tokens import COLUMNS, is_path

try:
    import torch
    from torch import Tensor
    from torch.utils.data import Dataset
except ImportError as error:
    raise missing_extra("torch", "A data set for PyTorch") from error


class LinkDataset(Dataset[dict[str, Tensor]]):
    """Links of a data set: estimated paths and true state.

    | key | shape, type | meaning |
    |---|---|---|
    | paths | (5, k) float32 | estimated paths, the strongest first, by `columns`; 0 where there is none |
    | mask | (5,) bool | whether there is a path |
    | state | () int64 | true `wireless.LinkState`: 0 outage, 1 line of sight, 2 first order, 3 higher order |
    | building | () int64 | number of the building, index into `buildings` |
    | position, tx_position | (2,) float32 | places of receiver and transmitter [m] |
    """

    def __init__(self, data: str | Path, *, buildings: Collection[str] | None = None) -> None:
        """Read all links: a million of them take a quarter of a gigabyte.

        Args:
            data: Folder of `robosim dataset`, or of the public measurements.
            buildings: Names of the buildings; None for all.

        Raises:
            ValueError: If a file is missing or damaged, or there is no such building.
        """
        links = read_links(Path(data))
        self.buildings = links.names
        if buildings is not None:
            if unknown := sorted(set(buildings) - set(links.names)):
                raise ValueError(
                    f"buildings has {shown(unknown[0])}, which {shown(data)} has not. It has {', '.join(links.names)}."
                )
            links = links[links.within(tuple(links.names.index(name) for name in buildings))]
        self.columns = links.measured
        """Quantities of a path: aoa and aod [rad], snr [dB], delay [s], peak; only measured ones."""
        tokens = links.tokens[..., [COLUMNS.index(name) for name in self.columns]]
        self._columns = {
            "paths": torch.from_numpy(np.nan_to_num(tokens)),
            "mask": torch.from_numpy(is_path(links.tokens)),
            "state": torch.from_numpy(links.state.astype(np.int64)),
            "building": torch.from_numpy(links.building.astype(np.int64)),
            "position": torch.from_numpy(links.position),
            "tx_position": torch.from_numpy(links.tx_position),
        }

    def __len__(self) -> int:
        return len(self._columns["state"])

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        """Return the tensors of a link."""
        return {name: column[index] for name, column in self._columns.items()}


class FrameDataset(Dataset[dict[str, Tensor]]):
    """Frames of an exploring robot, with the ground truth.

    | key | shape, type | meaning |
    |---|---|---|
    | depth | (1, h, w) float32 | measured depth [m]; 0 without a return |
    | rgb | (3, h, w) uint8 | picture |
    | action | () int64 | last `slam.Action`; -1 at the first frame of an episode |
    | odometry | (3,) float32 | measured motion since the last frame: x, y [m], yaw [rad] |
    | pose, estimate | (3,) float64 | true pose, and that of the classical mapper: x, y [m], yaw [rad] in `map` |
    | belief | (1, 64, 64) float32 | classical map ahead of the estimated pose: probability of an obstacle |
    | truth | (3, 64, 64) bool | channels of `robosim.datasets.true_patch` |
    | home | () int64 | number of the home, index into `shards` |
    """

    def __init__(
        self,
        data: str | Path | Sequence[Path],
        *,
        keys: Collection[str] = tuple(SHARD),
        cached_homes: int = 8,
    ) -> None:
        """Count the frames. They are read on demand, a home at a time.

        Args:
            data: Folder of `robosim collect`, or some of its files.
            keys: Keys of each frame, in addition to home; by default all.
            cached_homes: Homes that are cached in memory, 17 MB of 120 frames each. In order, each is read once.

        Raises:
            ValueError: If there is no such file, one is damaged, or a key is unknown.
        """
        if unknown := [key for key in keys if key not in SHARD]:
            raise ValueError(f"keys has {shown(unknown[0])}, expected some of {', '.join(SHARD)}.")
        self.shards = (
            sorted(Path(data).glob("home-*.npz"))
            if isinstance(data, str | Path)
            else [Path(path) for path in data]
        )
        if not self.shards:
            raise FileError(f"{shown(str(data))}: no home-*.npz. Collect some with `robosim collect`.")
        self._keys = tuple(key for key in SHARD if key in keys)
        self._ends = np.cumsum([len(read_shard(path, ("action",))[0]) for path in self.shards])
        self._most = max(cached_homes, 1)
        self._cached: OrderedDict[int, dict[str, Tensor]] = OrderedDict()

    def __len__(self) -> int:
        return int(self._ends[-1])

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        """Return the tensors of a frame."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        index %= len(self)
        home = int(np.searchsorted(self._ends, index, side="right"))
        row = index - (int(self._ends[home - 1]) if home else 0)
        return {**{key: column[row] for key, column in self._home(home).items()}, "home": torch.tensor(home)}

    def _home(self, home: int) -> dict[str, Tensor]:
        """All frames of a home, from the cache if they are there."""
        if home not in self._cached:
            arrays = read_shard(self.shards[home], self._keys)
            self._cached[home] = {
                key: _tensor(key, array) for key, array in zip(self._keys, arrays, strict=True)
            }
            if len(self._cached) > self._most:
                self._cached.popitem(last=False)
        self._cached.move_to_end(home)
        return self._cached[home]


def _tensor(key: str, array: np.ndarray) -> Tensor:
    """A column of a shard in the layout of networks."""
    if key == "depth":
        array = array[:, None].astype(np.float32) / 1000
    elif key == "rgb":
        array = np.ascontiguousarray(array.transpose(0, 3, 1, 2))
    elif key == "action":
        array = array.astype(np.int64)
    elif key == "belief":
        array = array[:, None].astype(np.float32) / 255
    elif key == "truth":
        array = np.unpackbits(array, axis=-1).astype(bool)
    return torch.from_numpy(array)
