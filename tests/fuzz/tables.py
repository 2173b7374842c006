"""Damage to tables and to checkpoints: empty places, other types, names, structures, code."""

import io
import random
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.fuzz.arrays import Evil
from tests.fuzz.bytes import TEXT_NUMBERS
from tests.fuzz.trees import CANARY, changed


def column_of_table(content: bytes, rng: random.Random) -> bytes:
    table = pq.read_table(io.BytesIO(content))
    i = rng.randrange(table.num_columns)
    name, column = table.column_names[i], table.column(i)
    how = rng.choice(["null", "nulls", "cast", "drop", "rename", "value", "rows", "none", "twice", "nested"])
    if how in ("null", "nulls"):
        mask = pa.array([how == "nulls" or k == 0 for k in range(len(column))])
        table = table.set_column(i, name, pa.compute.if_else(mask, pa.scalar(None, column.type), column))
    elif how == "cast":
        kind = rng.choice(
            [
                pa.int8(),
                pa.int64(),
                pa.float32(),
                pa.float64(),
                pa.string(),
                pa.bool_(),
                pa.large_string(),
                pa.date32(),
                pa.null(),
            ]
        )
        fresh = (
            column.cast(kind, safe=False)
            if not pa.types.is_nested(column.type) and kind != pa.null()
            else pa.nulls(len(column), kind)
        )
        table = table.set_column(i, name, fresh)
    elif how == "drop":
        table = table.drop_columns([name])
    elif how == "rename":
        table = table.rename_columns([f"{n}x" if n == name else n for n in table.column_names])
    elif how == "value" and pa.types.is_primitive(column.type):
        extreme = [np.nan, np.inf, 1e30, -1e30] if pa.types.is_floating(column.type) else [0, 1, 100, 127]
        table = table.set_column(
            i, name, pa.array([rng.choice(extreme)] * len(column)).cast(column.type, safe=False)
        )
    elif how == "value" and pa.types.is_string(column.type):
        table = table.set_column(i, name, pa.array([CANARY] * len(column)))
    elif how == "rows":
        table = pa.concat_tables([table] * rng.choice([2, 50]))
    elif how == "twice":
        table = table.append_column(name, column)
    elif how == "nested":
        table = table.set_column(i, name, pa.array([[1, 2]] * len(column)))
    else:
        table = table.slice(0, 0)
    return _parquet(table, rng)


def metadata_of_table(content: bytes, rng: random.Random) -> bytes:
    table = pq.read_table(io.BytesIO(content))
    output = dict(table.schema.metadata or {})
    for key in list(output)[: rng.choice([1, 3])]:
        if key != b"ARROW:schema":
            output[key] = rng.choice(
                [
                    b"",
                    b"nan",
                    b"-1",
                    CANARY.encode(),
                    b"x" * 7,
                    output[key][:-3],
                    output[key] * 2,
                    b"\xff" * 48,
                ]
            )
    return _parquet(table.replace_schema_metadata(output if rng.random() < 0.8 else None), rng)


def _parquet(table: pa.Table, rng: random.Random) -> bytes:
    out = io.BytesIO()
    pq.write_table(table, out, compression=rng.choice(["zstd", "snappy", "gzip", "NONE"]))
    return out.getvalue()


def cell(content: bytes, rng: random.Random) -> bytes:
    rows = [line.split(b",") for line in content.split(b"\n")]
    i = rng.choice([0, rng.randrange(len(rows))])
    j = rng.randrange(len(rows[i]))
    how = rng.choice(["value", "value", "value", "drop", "add", "quote", "column"])
    if how == "drop":
        del rows[i][j]
    elif how == "add":
        rows[i].append(rng.choice(TEXT_NUMBERS))
    elif how == "quote":
        rows[i][j] = b'"' + rows[i][j]
    elif how == "column":
        for row in rows[1:]:
            if j < len(row):
                row[j] = rng.choice([b"", b"x", b"nan", b"1e300", b"true"])
    else:
        rows[i][j] = rng.choice(
            [*TEXT_NUMBERS, b"\xff\xfe", b"a b", b"3.5", CANARY.encode(), b"z" * 2_000_000]
        )
    return b"\n".join(b",".join(row) for row in rows)


def state(content: bytes, rng: random.Random) -> bytes:
    """A checkpoint whose structure is changed, or the shape or kind of one of its tensors."""
    import torch

    stored = torch.load(io.BytesIO(content), weights_only=True)
    if rng.random() < 0.5:
        stored = changed(stored, rng)
    else:
        tensors: list[tuple[Any, Any]] = []
        stack = [stored]
        while stack:
            node = stack.pop()
            for key, value in node.items() if isinstance(node, dict) else enumerate(node):
                if isinstance(value, torch.Tensor):
                    tensors.append((node, key))
                elif isinstance(value, (dict, list)):
                    stack.append(value)
        node, key = rng.choice(tensors)
        value = node[key]
        node[key] = rng.choice(
            [value.reshape(-1)[:1], value.double(), value * np.nan, value[None], torch.zeros(0), 3, None]
        )
    out = io.BytesIO()
    torch.save(stored, out)
    return out.getvalue()


def pickled(content: bytes, rng: random.Random) -> bytes:
    """A checkpoint with code in it."""
    import torch

    out = io.BytesIO()
    torch.save({"recipe": Evil(), "for": Evil()}, out)
    return out.getvalue()
