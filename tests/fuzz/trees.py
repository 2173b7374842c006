"""Damage to trees of values in JSON and YAML, and in headers that hold them: types, keys, nesting, aliases, tags."""

import copy
import json
import random
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import yaml

#: What a pickle, a tag or an expression makes if its code is run.
MARKER = "code-was-run"
#: Code that a file may name; its module makes the marker when it is imported, and its function when it is called.
CANARY = "canary:sing"
CANARY_MODULE = (
    f"from pathlib import Path\n\n\ndef sing(*given, **named):\n    Path({MARKER!r}).touch()\n\n\nsing()\n"
)


VALUES: list[Any] = [
    None, True, False, 0, 1, -1, 2**31, 2**63, 2**64, 10**400, -(10**30), 0.5, -0.0, 1e308, -1e308, 1e30, 1e-300,
    float("nan"), float("inf"), "", "x", "\x00", "[/b][red]", "\x1b[31m", "\ud800", "a\nb", "../../etc/passwd",
    "/dev/zero", "y" * 70_000, [], {}, [[]], [1, 2, 3], [None], {"a": 1}, [[0, 0], [1, 1]], [1e308, -1e308],
    [[1, 2], [3]], CANARY, {"part": CANARY},
]  # fmt: skip


def _value(rng: random.Random) -> Any:
    """One that is no one else's: the next damage may change what is in it."""
    return copy.deepcopy(rng.choice(VALUES))


def _deep(rng: random.Random) -> Any:
    value = _value(rng)
    for _ in range(rng.choice([3, 60, 300])):
        value = [value] if rng.random() < 0.5 else {"a": value}
    return value


def _places(tree: Any) -> list[tuple[Any, Any]]:
    """Each list or dictionary in a tree with each of its indices or keys."""
    places: list[tuple[Any, Any]] = []
    stack = [tree]
    while stack:
        node = stack.pop()
        keys = node if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
        places += [(node, key) for key in keys]
        stack += [node[key] for key in keys if isinstance(node[key], (dict, list))]
    return places


def with_canaries(tree: Any) -> Iterator[Any]:
    """Copies of a tree, each with code in place of one value or one key."""
    for i, (of, _) in enumerate(_places(tree)):
        for as_key in (False, True)[: 1 + isinstance(of, dict)]:
            one = copy.deepcopy(tree)
            node, key = _places(one)[i]
            if as_key:
                node[CANARY] = node.pop(key)
            else:
                node[key] = CANARY
            yield one


def changed(tree: Any, rng: random.Random) -> Any:
    """A tree of lists and dictionaries with one place changed: its value, its key, its neighbours."""
    places = _places(tree)
    if not places or rng.random() < 0.03:
        return _value(rng) if rng.random() < 0.97 else _deep(rng)
    # The outermost are few, and matter most.
    node, key = rng.choice(places[: rng.choice([4, 40, len(places)])])
    how = rng.choice(["value", "value", "value", "canary", "remove", "rename", "deep", "many", "other"])
    if how == "remove":
        del node[key]
    elif how == "rename" and isinstance(node, dict):
        node[rng.choice([f"{key}x", "", "a/b", "z" * 300, "\n"])] = node.pop(key)
    elif how == "deep":
        node[key] = _deep(rng)
    elif how == "many":
        node[key] = [node[key]] * rng.choice([2, 5, 3000])
    elif how == "canary":
        node[key] = CANARY
    elif how == "other":
        other = rng.choice(list(node) if isinstance(node, dict) else range(len(node)))
        node[key] = copy.deepcopy(node[other])
    else:
        node[key] = _value(rng)
    return tree


def dumped(tree: Any) -> bytes:
    return json.dumps(tree).encode("utf-8", "surrogatepass")


def json_tree(content: bytes, rng: random.Random) -> bytes:
    return dumped(changed(json.loads(content), rng))


def yaml_tree(content: bytes, rng: random.Random) -> bytes:
    tree = changed(yaml.safe_load(content), rng)
    return (
        yaml.safe_dump(tree, sort_keys=False, allow_unicode=False).encode()
        if rng.random() < 0.7
        else dumped(tree)
    )


_TAGS = [
    b"!!int ''", b"!!int x", b"!!float ''", b"!!bool 3", b"!!null 7", b"!!timestamp 2020-99-99",
    b"!!binary '%'", b"!!set {a, b}",
    b"!!omap [a]", b"!!python/object/apply:os.system ['touch " + MARKER.encode() + b"']", b"!!python/name:os.system",
    b"!!python/object/new:os.system ['touch " + MARKER.encode() + b"']", b"&a [*a]", b"*nothing", b"!<x> 3",
    b"|\n  text",
    b"1:2:3", b"0b1", b"0o8", b"0x", b"._", b"<<", b"=", b"? [a]\n: b", b"2001-12-14t21:59:43.10-05:00",
    b"{<<: [a]}", b"@", b"%TAG",
]  # fmt: skip


def tag(content: bytes, rng: random.Random) -> bytes:
    lines = content.split(b"\n")
    keyed = [i for i, line in enumerate(lines) if b":" in line]
    i = rng.choice(keyed)
    lines[i] = lines[i].split(b":")[0] + b": " + rng.choice(_TAGS)
    return b"\n".join(lines)


def aliases(content: bytes, rng: random.Random) -> bytes:
    wide, deep = rng.choice([(9, 12), (1, 300), (2, 40), (100, 3), (5, 2)])
    levels = b"".join(
        b"k%d: &k%d [%s]\n" % (i, i, b",".join([b"*k%d" % (i - 1)] * wide)) for i in range(1, deep)
    )
    bomb = b"k0: &k0 [x]\n" + levels
    key = rng.choice([b"image", b"tasks", b"plans", b"resolution", b"seed", b"other"])
    return content + b"\n" + bomb + key + b": *k%d\n" % (deep - 1)


def glb_tree(content: bytes, rng: random.Random) -> bytes:
    (length,) = struct.unpack_from("<I", content, 12)
    text = json_tree(content[20 : 20 + length], rng)
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + content[16:20] + text + content[20 + length :]
    return content[:8] + struct.pack("<I", 12 + len(chunks)) + chunks


def safetensors_header(content: bytes, rng: random.Random) -> bytes:
    (length,) = struct.unpack_from("<Q", content)
    header = dumped(changed(json.loads(content[8 : 8 + length]), rng))
    size = len(header) if rng.random() < 0.9 else rng.choice([0, 2**63, 2**31, len(header) + 1])
    return struct.pack("<Q", size) + header + content[8 + length :]


def tensor_values(content: bytes, rng: random.Random) -> bytes:
    (length,) = struct.unpack_from("<Q", content)
    start = 8 + length + 4 * rng.randrange((len(content) - length - 8) // 4)
    value = struct.pack("<f", rng.choice([np.nan, np.inf, -np.inf, 3e38, 1e-40]))
    return (
        content[:start]
        + value * rng.choice([1, 50])
        + content[start + 4 * (1 if rng.random() < 0.5 else 50) :]
    )
