"""Refuse configurations that make no sense where they are made, in one line: what, got, expected, what to do."""

from collections.abc import Iterable
from dataclasses import fields
from difflib import get_close_matches
from functools import cache
from numbers import Integral, Real
from types import NoneType
from typing import Any, get_args, get_origin

#: Longer values are cut in messages.
_SHOWN = 60


def check_number(
    name: str, value: Any, least: float, most: float, unit: str = "", *, whole: bool = False
) -> None:
    """See that a value is a number between two bounds, which count in.

    Args:
        name: What the message calls it.
        value: What was given; not-a-number and infinities lie within no bounds.
        least: Lower bound.
        most: Upper bound.
        unit: Unit of the number, or what it counts, such as "m" or "steps"; further sentences may follow it.
        whole: Whether it must be an integer.

    Raises:
        ValueError: If it is none.
    """
    is_number = isinstance(value, Integral if whole else Real) and not isinstance(value, bool)
    if is_number and least <= value <= most:
        return
    bounds = f"{_plain(least)} to {_plain(most)}"
    expected = f"a whole number from {bounds}" if whole else bounds
    after = f" {unit}" if unit else ""
    raise ValueError(f"{name} is {shown(value)}, expected {expected}{after}.")


def check_numbers(config: Any, **bounds: tuple[float, float] | tuple[float, float, str]) -> None:
    """See that fields of a dataclass are numbers within bounds; in fields of several numbers, each of them.

    What is annotated as `int` must be whole, and what may be None is not checked if it is.

    Args:
        config: An instance.
        bounds: Least and most of each field, and its unit.

    Raises:
        ValueError: If one is not.
    """
    kinds: dict[str, Any] = {field.name: field.type for field in fields(config)}
    for name, limits in bounds.items():
        value, parts = getattr(config, name), _parts(kinds[name])
        if value is None and NoneType in parts:
            continue
        several = any(get_origin(part) is tuple for part in parts) and isinstance(value, (tuple, list))
        for one in value if several else (value,):
            check_number(name, one, *limits, whole=int in parts and float not in parts)


def check_choice(name: str, value: Any, known: Iterable[str], also: str = "") -> None:
    """See that a value is one of some names.

    Args:
        name: What the message calls it.
        value: What was given.
        known: The names.
        also: What else would do, such as "a .safetensors file".

    Raises:
        ValueError: If it is none of them; the message says which was perhaps meant.
    """
    known = tuple(known)
    if isinstance(value, str) and value in known:
        return
    near = get_close_matches(value, known, n=1) if isinstance(value, str) else []
    hint = f"Did you mean {near[0]!r}? " if near else ""
    others = f", or {also}" if also else ""
    raise ValueError(f"{name} is {shown(value)}. {hint}Known: {', '.join(known)}{others}.")


def shown(value: Any) -> str:
    """A value as messages show it."""
    text = repr(value) if isinstance(value, str) else str(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


@cache
def _parts(kind: Any) -> frozenset[Any]:
    """A type, and all that its alternatives and items may be."""
    return frozenset((kind, *(part for inner in get_args(kind) for part in _parts(inner))))


def _plain(bound: float) -> str:
    return str(bound) if isinstance(bound, int) else f"{bound:g}"
