"""Dataclasses from the keys and values of a file, each value checked against the type of its field.

The command line is made from the same annotations, so that a file takes what the command line takes.
"""

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from robosim.support.checks import check_choice, shown
from robosim.support.parts import check_code_allowed, imported, names_code
from robosim.support.reading import FileError

T = TypeVar("T")
#: Types of values that a field may be annotated with: what a file may hold for them, and what they are called.
_PLAIN: dict[Any, tuple[tuple[type, ...], str]] = {
    bool: ((bool,), "true or false"),
    int: ((int,), "a whole number"),
    float: ((int, float), "a number"),
    str: ((str,), "text"),
    Path: ((str,), "a path"),
}


def from_dict(kind: type[T], values: Any, name: str = "") -> T:
    """A dataclass from keys and values; fields without a key keep their defaults.

    `name` is the name of the value in messages; it is empty for the content of a whole file.

    Raises:
        ValueError: If a key is unknown or missing, a value is of another type than its field, or the dataclass rejects
            it.
        FileError: If it names code that may not be run.
    """
    if not isinstance(values, dict):
        raise _error(name or "it", values, "keys and values")
    hints = get_type_hints(kind, include_extras=True)
    of_name = f" of {name}" if name else ""
    for key in values:
        check_choice(f"a key{of_name}", key, hints)
    for field in fields(kind):  # type: ignore[arg-type]
        if field.name not in values and field.default is field.default_factory is MISSING:
            raise ValueError(f"the key {field.name!r}{of_name} is missing")
    made = {key: _value(f"{name}.{key}" if name else key, hints[key], value) for key, value in values.items()}
    try:
        return kind(**made)
    except ValueError as error:
        if not name or isinstance(error, FileError):
            raise
        raise ValueError(f"{name}: {error}") from error


def _value(name: str, hint: Any, value: Any) -> Any:
    """A value as its field has it."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _part(name, value) if inner[0] is Any else _value(name, inner[0], value)
    if origin in (Union, UnionType):
        (kind,) = (kind for kind in inner if kind is not NoneType)
        return None if value is None else _value(name, kind, value)
    if origin is Literal:
        check_choice(name, value, inner)
        return value
    if origin is tuple:
        return _tuple(name, inner, value)
    if origin is Mapping:
        if not isinstance(value, dict):
            raise _error(name, value, "keys and values")
        for key in value:
            _value(f"a key of {name}", str, key)
        return {key: _value(f"{name}.{key}", inner[1], each) for key, each in value.items()}
    if is_dataclass(hint):
        return from_dict(hint, value, name)  # type: ignore[arg-type]
    kinds, words = _PLAIN[hint]
    if not isinstance(value, kinds) or (isinstance(value, bool) and hint is not bool):
        raise _error(name, value, words)
    if isinstance(value, float) and not math.isfinite(value):
        raise _error(name, value, words)
    return value if hint is float else hint(value)


def _tuple(name: str, inner: tuple[Any, ...], value: Any) -> tuple[Any, ...]:
    """A list of values of one type, or of one for each."""
    several = isinstance(value, list) and inner[-1] is ...
    hints = inner[:1] * len(value) if several else inner
    if not isinstance(value, list) or len(value) != len(hints):
        count = "" if inner[-1] is ... else f" of {len(hints)} values"
        raise _error(name, value, f"a list{count}")
    return tuple(
        _value(f"{name}[{i}]", hint, each) for i, (hint, each) in enumerate(zip(hints, value, strict=True))
    )


def _part(name: str, value: Any) -> Any:
    """A part by its name, or as `robosim.support.parts.to_dict` writes an object."""
    if isinstance(value, str):
        check_code_allowed(name, value)
        return value
    if not isinstance(value, dict) or not names_code(value.get("part")):
        raise _error(name, value, "the name of a part")
    check_code_allowed(name, value["part"])
    target = imported(name, value["part"])
    rest = {key: each for key, each in value.items() if key != "part"}
    if rest and not is_dataclass(target):
        raise ValueError(f"{name} is {value['part']}, which has no settings")
    return from_dict(target, rest, name) if rest else target


def _error(name: str, value: Any, expected: str) -> ValueError:
    return ValueError(f"{name} is {shown(value)}, expected {expected}.")
