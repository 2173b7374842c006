"""Data sets of links and of frames for PyTorch: dictionaries of tensors, for any `DataLoader`.

Links come in batches, read from their tables as a stream; frames one by one, in the order of files. Split them by
building or home rather than by example, since neighbouring links and frames are alike.
"""

from collections import OrderedDict
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Int

from robosim.datasets.collect import SHARD, read_shard
from robosim.support.checks import SEED, check_number
from robosim.support.installation import missing_extra
from robosim.support.reading import FileError, shown
from wireless.linkstate.data import link_tables
from wireless.linkstate.tokens import COLUMNS, is_path

try:
    import torch
    from torch import Tensor
    from torch.utils.data import Dataset, IterableDataset, get_worker_info
except ImportError as error:
    raise missing_extra("torch", "A data set for PyTorch") from error

#: Parts of a shuffled data set that take turns; many numbers of workers divide it.
_STREAMS = 12


class LinkDataset(IterableDataset[dict[str, Tensor]]):
    """Batches of links of a data set, estimated paths and true state, read from its tables when they are needed.

    | key | shape, type | meaning |
    |---|---|---|
    | paths | (n, 5, k) float32 | estimated paths, the strongest first, by `columns`; 0 where there is none |
    | mask | (n, 5) bool | whether there is a path |
    | state | (n,) int64 | true `wireless.LinkState`: 0 outage, 1 line of sight, 2 first order, 3 higher order |
    | building | (n,) int64 | number of the building, index into `buildings` |
    | position, tx_position | (n, 2) float32 | places of receiver and transmitter [m] |

    With a seed, tables are shuffled and then divided into 12 streams, which take turns: each gives batches of its
    buffer, that is shuffled too. The order depends on seed and epoch alone, not on the workers of a `DataLoader`, which
    needs `batch_size=None`. Each worker reads its streams; only if their number does not divide 12, or there is no
    seed, are tables read by several. All links come once an epoch, and the last batch may be smaller.
    """

    def __init__(
        self,
        data: str | Path,
        *,
        buildings: Collection[str] | None = None,
        batch_size: int = 256,
        seed: int | None = None,
        buffer: int = 32_768,
    ) -> None:
        """List the tables. Public measurements are read once to count them.

        Args:
            data: Folder of `robosim dataset`, or of the public measurements.
            buildings: Names of the buildings; None for all.
            batch_size: Links of a batch.
            seed: Seed of the order; None for the order of the files.
            buffer: Links that each stream holds and shuffles, 170 bytes each.

        Raises:
            ValueError: If a file is missing or damaged, there is no such building, or a number is out of range.
        """
        for name, value in (("batch_size", batch_size), ("buffer", buffer)):
            check_number(name, value, 1, 10_000_000, "links", whole=True)
        if seed is not None:
            check_number("seed", seed, *SEED, whole=True)
        tables = link_tables(Path(data))
        self.buildings = tuple(sorted({table.building for table in tables}))
        if buildings is not None:
            if unknown := sorted(set(buildings) - set(self.buildings)):
                raise ValueError(
                    f"buildings has {shown(unknown[0])}, which {shown(data)} has not. It has "
                    f"{', '.join(self.buildings)}."
                )
            chosen = set(buildings)
            tables = [table for table in tables if table.building in chosen]
        self._tables = tables
        self._batch_size, self._seed = batch_size, seed
        self._buffer_batches = max(1, buffer // batch_size)
        self.epoch = 0
        """Number of the epoch, which changes the order; set it before each one."""
        self.links = sum(table.rows for table in tables)
        """Number of links."""
        # Tables whose links have no path at all do not say what was measured.
        measured = (table.read(range(table.rows)).measured for table in tables)
        self.columns = next(filter(None, measured), ())
        """Quantities of a path: aoa and aod [rad], snr [dB], delay [s], peak; only measured ones."""

    def __len__(self) -> int:
        """Return the number of batches."""
        return -(-self.links // self._batch_size)

    def __iter__(self) -> Iterator[dict[str, Tensor]]:
        worker = get_worker_info()
        first, step = (worker.id, worker.num_workers) if worker else (0, 1)
        streams = 1 if self._seed is None else _STREAMS
        order = self._order(len(self._tables))
        ends = np.cumsum([self._tables[table].rows for table in order])
        # Streams have as many batches as turns; the one of the last batch has the last rows, which may be fewer.
        places = (np.arange(streams) - len(self)) % streams
        turns = -(-(len(self) - np.arange(streams)) // streams)
        begins = np.array([turns[places < place].sum() for place in places])
        buffers: dict[int, tuple[int, dict[str, Tensor]]] = {}
        for number in range(first, len(self), step):
            turn, stream = divmod(number, streams)
            fill, batch = divmod(turn, self._buffer_batches)
            if stream not in buffers or buffers[stream][0] != fill:
                buffers.pop(stream, None)
                begin = begins[stream] + fill * self._buffer_batches
                end = min(begin + self._buffer_batches, begins[stream] + turns[stream])
                rows = range(begin * self._batch_size, min(end * self._batch_size, self.links))
                buffers[stream] = fill, self._read(order, ends, rows, stream, fill)
            chosen = slice(batch * self._batch_size, (batch + 1) * self._batch_size)
            # Clones, since a loader's worker shares the whole memory of a tensor with the process that it sends it to.
            yield {name: column[chosen].clone() for name, column in buffers[stream][1].items()}

    def _order(self, count: int, *key: int) -> Int[np.ndarray, " n"]:
        """Numbers from 0, in an order of the seed, the epoch and a key; rising without a seed."""
        if self._seed is None:
            return np.arange(count)
        return np.random.default_rng([self._seed, self.epoch, *key]).permutation(count)

    def _read(
        self, order: Int[np.ndarray, " n"], ends: Int[np.ndarray, " n"], rows: range, *key: int
    ) -> dict[str, Tensor]:
        """Links by their rows in all tables, one after the other in an order; shuffled if there is a seed."""
        blocks = []
        first, last = np.searchsorted(ends, (rows.start, rows.stop - 1), side="right")
        for table, end in zip((self._tables[k] for k in order[first : last + 1]), ends[first:], strict=False):
            begin = int(end) - table.rows
            links = table.read(range(max(rows.start - begin, 0), min(rows.stop - begin, table.rows)))
            if links.measured not in ((), self.columns):
                raise FileError(
                    f"{shown(table.file)}: it has {', '.join(links.measured)} of paths, other files of the data set "
                    f"{', '.join(self.columns)}. Make the data set again."
                )
            blocks.append((self.buildings.index(table.building), links))
        tokens = np.concatenate([links.tokens for _, links in blocks])
        shuffled = self._order(len(tokens), *key)
        columns = {
            "paths": np.nan_to_num(tokens[..., [COLUMNS.index(name) for name in self.columns]]),
            "mask": is_path(tokens),
            "state": np.concatenate([links.state.astype(np.int64) for _, links in blocks]),
            "building": np.repeat(
                [number for number, _ in blocks], [len(links.state) for _, links in blocks]
            ),
            "position": np.concatenate([links.position for _, links in blocks]),
            "tx_position": np.concatenate([links.tx_position for _, links in blocks]),
        }
        return {name: torch.from_numpy(column[shuffled]) for name, column in columns.items()}


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
