"""Tables whose headers declare rows and columns: what is too large is rejected before it is read."""

from types import SimpleNamespace

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from robosim.support.reading import FileError, reading
from wireless.support.columns import parquet_table


def read(path, names=None):
    with reading(path, "links", "Trace them again.") as file:
        return parquet_table(file, names)


@pytest.mark.parametrize(("rows", "columns"), [(10**12, 3), (5, 10**6)])
def test_a_declared_size_is_bounded_before_anything_is_read(tmp_path, monkeypatch, rows, columns):
    path = tmp_path / "links.parquet"
    pq.write_table(pa.table({"tx": [1, 2]}), path)
    schema = pq.read_schema(path)
    footer = SimpleNamespace(
        num_rows=rows, num_columns=columns, schema=SimpleNamespace(to_arrow_schema=lambda: schema)
    )
    monkeypatch.setattr(pq, "read_metadata", lambda file: footer)
    monkeypatch.setattr(pq, "read_table", lambda *given, **named: pytest.fail("read"))
    with pytest.raises(FileError) as rejected:
        read(path)
    assert str(path) in str(rejected.value)
    assert f"it declares {rows} rows and {columns} columns" in str(rejected.value)


def test_a_missing_column_is_named_with_those_that_are_there(tmp_path):
    path = tmp_path / "links.parquet"
    pq.write_table(pa.table({"tx": [1, 2], "rx": [3, 4]}), path)
    assert read(path, ["rx"]).column_names == ["rx"]
    with pytest.raises(FileError, match="column snr is missing; there are tx, rx"):
        read(path, ["tx", "snr"])
