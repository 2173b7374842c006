"""Columns of tables from files: each as expected, without empty places, its numbers within bounds.

For use inside of `robosim.support.reading.reading`, which adds the file's name to what is raised.
"""

from collections.abc import Sequence
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

#: Rows of a table, and its columns.
_MOST_ROWS, _MOST_COLUMNS = 200_000_000, 10_000
#: Positions and whatever else is of that order are at most so large [m].
FAR = 1e7


def parquet_table(
    file: BinaryIO,
    names: Sequence[str] | None = None,
    filters: list[tuple[str, str, Any]] | None = None,
    rows: range | None = None,
) -> pa.Table:
    """A table from a Parquet file; of `rows`, only the groups that hold them are read.

    Raises:
        ValueError: If a column or a row is missing, or there are more rows than any table has.
        Exception: Whatever damage makes its reader raise.
    """
    metadata = pq.read_metadata(file)
    if metadata.num_rows > _MOST_ROWS or metadata.num_columns > _MOST_COLUMNS:
        raise ValueError(f"it declares {metadata.num_rows} rows and {metadata.num_columns} columns")
    # FileMetaData.schema is not used: it makes a cycle of objects, each 100 kB until Python looks for them.
    parquet = pq.ParquetFile(file, metadata=metadata)
    there = parquet.schema_arrow.names
    if missing := [name for name in names or () if name not in there]:
        raise ValueError(f"column {missing[0]} is missing; there are {', '.join(there[:20])}")
    if filters is not None:
        file.seek(0)
        return pq.read_table(file, columns=names, filters=filters)
    if rows is None:
        return parquet.read(columns=names)
    if rows.stop > metadata.num_rows:
        raise ValueError(f"it has {metadata.num_rows} rows, expected {rows.stop} or more")
    ends = np.cumsum([metadata.row_group(i).num_rows for i in range(metadata.num_row_groups)])
    first, last = np.searchsorted(ends, (rows.start, rows.stop - 1), side="right")
    before = int(ends[first - 1]) if first else 0
    return parquet.read_row_groups(list(range(first, last + 1)), columns=names).slice(
        rows.start - before, len(rows)
    )


def values(table: pa.Table, name: str, kind: pa.DataType) -> np.ndarray:
    """A column as an array of a type, or of texts.

    Raises:
        ValueError: If it is missing, has empty places, or cannot be of the type.
    """
    return _plain(table, name, pa.string() if pa.types.is_dictionary(kind) else kind).to_numpy()


def numbers(
    table: pa.Table, name: str, kind: pa.DataType, low: float = -FAR, high: float = FAR
) -> np.ndarray:
    """A column of numbers within bounds; raises as `values` does, and of the first number beyond them."""
    column = values(table, name, kind)
    check_within(column, name, low, high)
    return column


def lists(table: pa.Table, name: str, kind: pa.DataType) -> tuple[np.ndarray, np.ndarray]:
    """All entries of a column of lists, one list after the other, and the lengths of the lists.

    Raises:
        ValueError: As `values` does.
    """
    import pyarrow.compute as pc  # takes 0.1 s, required for lists only

    column = _plain(table, name, kind).combine_chunks()
    column = pa.concat_arrays(column.chunks) if isinstance(column, pa.ChunkedArray) else column
    entries = column.flatten()
    if entries.null_count:
        raise ValueError(f"column {name} has empty places in its lists")
    return entries.to_numpy(zero_copy_only=False), pc.list_value_length(column).to_numpy(zero_copy_only=False)


def check_within(column: np.ndarray, name: str, low: float, high: float) -> None:
    """Reject numbers outside bounds, NaN and infinities.

    Raises:
        ValueError: Of the first.
    """
    wrong = ~((column >= low) & (column <= high))
    if wrong.any():
        row = np.argwhere(wrong)[0]
        raise ValueError(f"{name} of row {row[0] + 1} is {column[tuple(row)]}, expected {low:g} to {high:g}")


def _plain(table: pa.Table, name: str, kind: pa.DataType) -> pa.ChunkedArray:
    if name not in table.column_names:
        raise ValueError(f"column {name} is missing; there are {', '.join(table.column_names[:20])}")
    column = table[name]
    if column.null_count:
        row = int(np.argmax(column.is_null().to_numpy())) + 1
        raise ValueError(f"column {name} is empty in row {row}")
    try:
        return column if column.type == kind else column.cast(kind)
    except pa.ArrowException as error:
        raise ValueError(f"column {name} is {column.type}, expected {kind}") from error
