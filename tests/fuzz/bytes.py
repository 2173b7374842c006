"""Damage to any bytes: cut, flipped, overwritten, repeated, whole numbers and numbers as text made senseless."""

import random
import re
import struct
from collections.abc import Callable

import numpy as np

from tests.fuzz.trees import CANARY

Method = Callable[[bytes, random.Random], bytes]


#: Numbers as text.
TEXT_NUMBERS = [
    b"0", b"-1", b"1", b"2", b"255", b"256", b"65536", b"2147483648", b"99999999999999999999", b"9" * 400, b"1e308",
    b"-1e308", b"1e999", b"nan", b"inf", b"-inf", b"1e-300", b"0.0000001", b"1e30", b"0x7f", b"1_000", b"true", b"",
    b"x",
]  # fmt: skip


def cut(content: bytes, rng: random.Random) -> bytes:
    return content[: rng.choice([0, 1, rng.randrange(40), rng.randrange(len(content) + 1), len(content) - 1])]


def flipped(content: bytes, rng: random.Random) -> bytes:
    new = bytearray(content)
    for _ in range(rng.choice([1, 1, 2, 8, 64]) if new else 0):
        # Headers are where it hurts.
        at = rng.randrange(min(len(new), rng.choice([64, 1024, len(new)])))
        new[at] ^= 1 << rng.randrange(8)
    return bytes(new)


def overwritten(content: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(content) + 1)
    length = rng.choice([1, 2, 4, 8, 64, 1000])
    filling = rng.choice([b"\0", b"\xff", b"\x7f", bytes([rng.randrange(256)])]) * length
    return content[:start] + filling + content[start + length :]


def removed(content: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(content) + 1)
    return content[:start] + content[start + rng.choice([1, 2, 4, 40, 400]) :]


def _repeated(content: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(content) + 1)
    part = content[start : start + rng.choice([1, 4, 40, 4000])]
    return (
        content[:start]
        + part * rng.choice([2, 3, 1000 if len(part) < 400 else 3])
        + content[start + len(part) :]
    )


def _inserted(content: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(content) + 1)
    return content[:start] + rng.randbytes(rng.choice([1, 3, 30])) + content[start:]


def _longer(content: bytes, rng: random.Random) -> bytes:
    return content + rng.choice([b"\0" * 1000, rng.randbytes(100), content, b"\n" * 100])


def _garbage(content: bytes, rng: random.Random) -> bytes:
    return (
        rng.randbytes(rng.choice([1, 30, 3000])) if rng.random() < 0.7 else b"[" * rng.choice([100, 100_000])
    )


def length(content: bytes, rng: random.Random) -> bytes:
    """A whole number in the header made huge, negative or nothing."""
    kind = rng.choice(["<H", ">H", "<I", ">I", "<Q", ">Q", "<f"])
    size = struct.calcsize(kind)
    at = rng.randrange(max(1, min(len(content), rng.choice([32, 128, 1024, len(content) + 1]))))
    top = (1 << 8 * size) - 1
    value = rng.choice([0, 1, top, top >> 1, (top >> 1) + 1, top // 3, 1 << 20])
    packed = (
        struct.pack(kind, rng.choice([np.nan, np.inf, 1e30, -1e30]))
        if kind == "<f"
        else struct.pack(kind, value)
    )
    return content[:at] + packed + content[at + size :]


def number(content: bytes, rng: random.Random) -> bytes:
    """A number written as text, replaced."""
    found = list(re.finditer(rb"[-+]?[0-9][-+0-9.eE]*", content[:200_000]))
    if not found:
        return length(content, rng)
    some = rng.choice(found[: rng.choice([3, 30, len(found)])])
    return content[: some.start()] + rng.choice(TEXT_NUMBERS) + content[some.end() :]


def named_code(content: bytes, rng: random.Random) -> bytes:
    """A word replaced by code."""
    found = list(re.finditer(rb"[A-Za-z_][A-Za-z_0-9.]*", content[:200_000])) or [None]
    word = rng.choice(found[: rng.choice([3, 30, len(found)])])
    start, end = word.span() if word else (0, 0)
    return content[:start] + CANARY.encode() + content[end:]


def corner(content: bytes, rng: random.Random) -> bytes:
    if content[:5] == b"solid":
        return number(content, rng)
    at = 84 + 4 * rng.randrange((len(content) - 84) // 4)
    return (
        content[:at]
        + struct.pack("<f", rng.choice([np.nan, np.inf, 1e30, -1e30, 3e38, 1e6]))
        + content[at + 4 :]
    )


def step(content: bytes, rng: random.Random) -> bytes:
    """A file of ISO 10303-21 with a line of its data changed: an argument, a reference, its type, or left out."""
    lines = content.split(b"\n")
    places = [i for i, line in enumerate(lines) if line.startswith(b"#")]
    at, other = rng.choice(places), lines[rng.choice(places)]
    name, _, rest = lines[at].partition(b"=")
    arguments = list(re.finditer(rb"(?<=[(,])[^(),]*(?=[),])", rest))
    fillings = [
        other.partition(b"=")[0],
        name,
        b"$",
        b"*",
        b"()",
        b"'\\X2\\D800\\X0\\'",
        b".T.",
        *TEXT_NUMBERS,
    ]
    kind = rng.choice(["argument", "argument", "argument", "type", "content", "left out", "twice"])
    if kind == "argument" and arguments:
        argument = rng.choice(arguments)
        rest = rest[: argument.start()] + rng.choice(fillings) + rest[argument.end() :]
    elif kind == "type":
        rest = other.partition(b"=")[2].partition(b"(")[0] + b"(" + rest.partition(b"(")[2]
    elif kind == "content":
        rest = other.partition(b"=")[2]
    lines[at : at + 1] = {"left out": [], "twice": [lines[at], name + b"=" + rest]}.get(
        kind, [name + b"=" + rest]
    )
    return b"\n".join(lines)


BYTES: dict[str, Method] = {
    "cut": cut, "flipped": flipped, "overwritten": overwritten, "removed": removed, "repeated": _repeated,
    "inserted": _inserted, "code": named_code, "longer": _longer, "garbage": _garbage, "length": length,
    "number": number,
}  # fmt: skip
