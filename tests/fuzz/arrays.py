"""Damage to NumPy's files and to pictures, check sums set right: other kinds, shapes, values, headers, members."""

import io
import json
import os
import random
import re
import struct
import zipfile
import zlib
from typing import Any

import numpy as np

from tests.fuzz.bytes import cut, flipped, length, overwritten, removed
from tests.fuzz.trees import CANARY, MARKER, changed, dumped


def _npz_arrays(content: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(content)) as file:
        return {name: file[name] for name in file.files}


def _other_array(array: np.ndarray, rng: random.Random) -> np.ndarray:
    array = array.copy()
    how = rng.choice(["kind", "rank", "length", "value", "value", "values", "empty", "transposed", "order"])
    if how == "kind":
        kind = rng.choice(
            ["?", "i1", "u1", "<i8", ">i8", "u2", "f2", "<f8", ">f4", "c16", "U3", "S4", "M8[s]"]
        )
        return (
            array.astype(kind)
            if array.dtype.kind not in "US" or kind in ("U3", "S4")
            else np.zeros(array.shape, kind)
        )
    if how == "rank":
        return rng.choice(
            [array.reshape(-1), array[None], array.reshape(-1)[:1].reshape(()), array[..., None]]
        )
    if how == "length":
        return (
            np.concatenate([array, array])
            if array.ndim and rng.random() < 0.5
            else array[: len(array) // 2]
            if array.ndim
            else array
        )
    if how == "empty":
        return array[:0] if array.ndim else np.empty((0, 0), array.dtype)
    if how == "transposed":
        return np.asfortranarray(array.T)
    if how == "order":
        return array[::-1] if array.ndim else array
    if array.dtype.kind in "US":
        text = str(array.reshape(-1)[0]) if array.size else ""
        other = rng.choice(["", "\n", "x" * 9, CANARY])
        if text.startswith("{"):
            other = dumped(changed(json.loads(text), rng)).decode("utf-8", "replace")
        return np.array(other) if not array.ndim else np.full(array.shape, other)
    extreme = {
        "f": [np.nan, np.inf, -np.inf, 1e300, -1e300, 1e7, 1e-300, 0.0], "b": [True],
        "u": [0, 1, 255, 2**16 - 1, 2**31], "i": [0, -1, 127, 2**31 - 1, 2**62, -(2**63)],
    }.get(array.dtype.kind, [0])  # fmt: skip
    flat = array.reshape(-1)
    if flat.size:
        with np.errstate(all="ignore"):
            value = np.array(rng.choice(extreme)).astype(array.dtype, casting="unsafe")
        flat[rng.randrange(flat.size) if how == "value" else slice(None)] = value
    return array


def _saved(arrays: dict[str, np.ndarray], rng: random.Random) -> bytes:
    file = io.BytesIO()
    (np.savez if rng.random() < 0.5 else np.savez_compressed)(file, **arrays)
    return file.getvalue()


def npz_array(content: bytes, rng: random.Random) -> bytes:
    arrays = _npz_arrays(content)
    name = rng.choice(list(arrays))
    how = rng.choice(["change", "change", "change", "change", "remove", "rename", "swap", "pickle"])
    if how == "remove":
        del arrays[name]
    elif how == "rename":
        arrays[rng.choice(["", "x", f"{name}/..", "é"])] = arrays.pop(name)
    elif how == "swap":
        other = rng.choice(list(arrays))
        arrays[name], arrays[other] = arrays[other], arrays[name]
    elif how == "pickle":
        arrays[name] = np.array([Evil()], object)
    else:
        arrays[name] = _other_array(arrays[name], rng)
    return _saved(arrays, rng)


class Evil:
    """Makes the marker when it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (f"touch {MARKER}",)


def npz_member(content: bytes, rng: random.Random) -> bytes:
    """The bytes of one member changed, the archive's check sum right; or the archive itself bent."""
    out, how = (
        io.BytesIO(),
        rng.choice(["bytes", "bytes", "bytes", "twice", "bomb", "lzma", "many", "encrypted"]),
    )
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(out, "w") as new:
        names = old.namelist()
        chosen = rng.choice(names)
        for name in names:
            data = old.read(name)
            if name == chosen and how == "bytes":
                data = rng.choice([flipped, cut, overwritten, removed, length])(data, rng)
            if name == chosen and how == "bomb":
                data += bytes(30_000_000)
            packing = (
                zipfile.ZIP_LZMA
                if how == "lzma"
                else zipfile.ZIP_DEFLATED
                if how == "bomb"
                else zipfile.ZIP_STORED
            )
            new.writestr(name, data, packing)
        for i in range(3000 if how == "many" else 1 if how == "twice" else 0):
            new.writestr(chosen if how == "twice" else f"{i}", b"")
    bent = bytearray(out.getvalue())
    if how == "encrypted":
        for found in re.finditer(rb"PK\x01\x02", bytes(bent)):
            bent[found.start() + 8] |= 1
    return bytes(bent)


_SHAPES = [
    "(888888888888888888,)",
    "(-1,)",
    "()",
    "(0,)",
    "(1, 999999999)",
    "(True,)",
    "'x'",
    "(1e9,)",
    "(2,) * 99",
    "((3,),)",
]


_KINDS = [
    "'|O'",
    "'<f8'",
    "'<U999999999'",
    "'<U0'",
    "[('a', '<f8')]",
    "('<f8', (1000, 1000))",
    "'<M8[s]'",
    "'|V8'",
    "None",
    "'x'",
    "'>c32'",
]


def _forged(content: bytes, rng: random.Random) -> bytes:
    """An array's header rewritten."""
    end = content.index(b"}") + 1
    header = content[10:end].decode("latin1")
    how = rng.choice(["shape", "kind", "order", "text"])
    if how == "shape":
        header = re.sub(r"'shape': \([^)]*\)", f"'shape': {rng.choice(_SHAPES)}", header)
    elif how == "kind":
        header = re.sub(r"'descr': '[^']*'", f"'descr': {rng.choice(_KINDS)}", header)
    elif how == "order":
        header = header.replace("False", rng.choice(["True", "3", "None", "__import__('os')"]))
    else:
        header = rng.choice(
            ["{}", "(" * 3000, "{'a': 1}", f"__import__('os').system('touch {MARKER}')", "", "{" * 200]
        )
    text = header.encode("latin1") + b"\n"
    version = rng.choice([b"\x01\x00", b"\x01\x00", b"\x02\x00", b"\x03\x00", b"\x09\x09"])
    size = struct.pack("<H" if version == b"\x01\x00" else "<I", len(text))
    rest = content[content.index(b"\n", end) + 1 :]
    return content[:6] + version + size + text + rest


def npy_header(content: bytes, rng: random.Random) -> bytes:
    return _forged(content, rng)


def npy_array(content: bytes, rng: random.Random) -> bytes:
    file = io.BytesIO()
    np.save(file, _other_array(np.load(io.BytesIO(content)), rng))
    return file.getvalue()


def npz_header(content: bytes, rng: random.Random) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(out, "w") as new:
        chosen = rng.choice(old.namelist())
        for name in old.namelist():
            data = old.read(name)
            new.writestr(name, _forged(data, rng) if name == chosen else data, zipfile.ZIP_DEFLATED)
    return out.getvalue()


def npz_picture(content: bytes, rng: random.Random) -> bytes:
    """A picture inside of a log changed, its check sums right; another member where there is none."""
    arrays = _npz_arrays(content)
    pictures = [name for name in ("rgb", "depth", "belief") if f"{name}_count" in arrays]
    if not pictures:
        return npz_array(content, rng)
    name = rng.choice(pictures)
    counts = arrays[f"{name}_count"].copy()
    parts = np.split(arrays[name], np.cumsum(counts)[:-1])
    i = rng.choice([k for k, part in enumerate(parts) if len(part)])
    parts[i] = np.frombuffer(chunk(parts[i].tobytes(), rng), np.uint8)
    counts[i] = len(parts[i])
    return _saved({**arrays, name: np.concatenate(parts), f"{name}_count": counts}, rng)


def chunk(content: bytes, rng: random.Random) -> bytes:
    """A chunk of a PNG changed, its check sum right."""
    chunks, at = [], 8
    while at + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, at)
        chunks.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + length]))
        at += 12 + length
    i = rng.choice([0, rng.randrange(len(chunks))])
    kind, data = chunks[i]
    how = rng.choice(["size", "depth", "bytes", "remove", "twice", "kind", "inflated"])
    if how == "size" and kind == b"IHDR":
        side = rng.choice([0, 1, 17, 5000, 100_000, 2**31 - 1])
        data = (
            struct.pack(">I", side)
            + (data[4:8] if rng.random() < 0.5 else struct.pack(">I", side))
            + data[8:]
        )
    elif how == "depth" and kind == b"IHDR":
        data = (
            data[:8] + bytes([rng.choice([1, 2, 4, 8, 16, 77]), rng.choice([0, 2, 3, 4, 6, 9])]) + data[10:]
        )
    elif how == "inflated" and kind == b"IDAT":
        data = zlib.compress(flipped(zlib.decompress(data), rng))
    elif how == "kind":
        kind = rng.choice([b"tEXt", b"zTXt", b"iCCP", b"PLTE", b"tRNS", b"acTL", b"IEND", b"\0\0\0\0"])
    else:
        data = flipped(data, rng) if data else rng.randbytes(5)
    new = [(kind, data)] * (2 if how == "twice" else 0 if how == "remove" else 1)
    chunks[i : i + 1] = new
    joined = (struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)
    return content[:8] + b"".join(joined)
