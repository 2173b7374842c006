"""Damage done to a copy of a good file, by a seed: bits and lengths, fields and types, numbers and nesting.

`damage` picks a method that fits the file: any file can be cut, flipped, swapped, or be something else than a file;
formats with fields have these changed by their own rules, check sums set right, so that damage gets past the first
door.
"""

import os
import random
import stat
from pathlib import Path

from tests.fuzz.arrays import chunk, npy_array, npy_header, npz_array, npz_header, npz_member, npz_picture
from tests.fuzz.bytes import BYTES, Method, corner, flipped, number, step
from tests.fuzz.tables import cell, column_of_table, metadata_of_table, pickled, state
from tests.fuzz.trees import aliases, glb_tree, json_tree, safetensors_header, tag, tensor_values, yaml_tree


def damage(path: Path, others: list[Path], rng: random.Random) -> str:
    """Damage a file in place; what was done, in a word.

    Args:
        path: The file.
        others: Other files, whose content may be put into it.
        rng: What everything is drawn from.
    """
    draw = rng.random()
    if draw < 0.08:
        return _no_file(path, rng)
    if draw < 0.11:
        path.write_bytes(rng.choice(others).read_bytes())
        return "swapped"
    content = path.read_bytes()
    methods = {**BYTES, **_of_format(path.suffix.lower(), content)}
    own = [name for name in methods if name not in BYTES]
    name = rng.choice(own if own and rng.random() < 0.6 else list(methods))
    try:
        damaged = methods[name](content, rng)
        for _ in range(rng.choice([0, 0, 0, 0, 1, 2])):
            damaged = methods[name](damaged, rng)
    except Exception:  # what is damaged already may be beyond its format's own rules
        name, damaged = "flipped", flipped(content, rng)
    path.write_bytes(damaged)
    return name


def _no_file(path: Path, rng: random.Random) -> str:
    """Put a special file in place of a file."""
    if rng.random() < 0.2:
        content = path.rename(path.with_name(f"linked-{path.name}"))
        path.symlink_to(content.name)  # a link to a good file is as good as the file
        return "linked"
    path.unlink()
    kind = rng.choice(
        [
            "missing", "folder", "pipe", "socket", "loop", "ring", "dangling", "link to the folder", "zero", "full",
            "null", "random", "huge", "empty", "deep",
        ]
    )  # fmt: skip
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "socket":
        os.mknod(path, stat.S_IFSOCK | 0o600)
    elif kind == "huge":
        with path.open("wb") as file:
            file.truncate(1 << rng.choice([31, 33, 40]))
    elif kind == "empty":
        path.touch()
    elif kind == "deep":
        (path / "inside").mkdir(parents=True)
    elif kind != "missing":
        other = path.with_name("ring")
        targets = {"loop": path.name, "ring": other.name, "dangling": "nowhere", "link to the folder": "."}
        path.symlink_to(targets.get(kind, f"/dev/{kind}"))
        if kind == "ring":
            other.symlink_to(path.name)
    return kind


def _of_format(suffix: str, content: bytes) -> dict[str, Method]:
    methods: dict[str, dict[str, Method]] = {
        ".json": {"tree": json_tree, "text-number": number},
        ".gltf": {"tree": json_tree},
        ".yaml": {"tree": yaml_tree, "tag": tag, "alias": aliases, "text-number": number},
        ".npz": {"array": npz_array, "member": npz_member, "header": npz_header, "picture": npz_picture},
        ".npy": {"array": npy_array, "header": npy_header},
        ".parquet": {"column": column_of_table, "metadata": metadata_of_table},
        ".safetensors": {"header": safetensors_header, "values": tensor_values},
        ".csv": {"cell": cell, "cells": cell, "text-number": number},
        ".out": {"cell": cell, "text-number": number},
        ".glb": {"tree": glb_tree},
        ".png": {"chunk": chunk},
        ".stl": {"corner": corner},
        ".ifc": {"step": step, "steps": step, "text-number": number},
        ".pt": {"member": npz_member, "state": state, "pickle": pickled},
    }
    return methods.get(suffix, {"text-number": number} if content[:200].isascii() else {})
