"""Ranges, choices and parts that a configuration declares in its annotations, checked when one is made.

    @dataclass(frozen=True, kw_only=True)
    @checked
    class CameraConfig:
        width: Annotated[int, Range(8, 4096, "pixels")] = 128
        engine: Literal["fast", "exact"] = "fast"

`CameraConfig(width=0)` raises "width is 0, expected a whole number from 8 to 4096 pixels."
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from numbers import Integral, Real
from types import NoneType
from typing import (
    Any,
    Literal,
    NamedTuple,
    Protocol,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
    runtime_checkable,
)

T = TypeVar("T")
#: Longer values are cut in messages.
_SHOWN = 60


@dataclass(frozen=True, repr=False)
class Range:
    """Smallest and largest value of a number, and its unit; in a field of several numbers, of each of them."""

    least: float
    greatest: float
    unit: str = ""
    """Unit of the number, or what it counts, such as "m" or "steps"."""
    hint: str = ""
    """Sentence that ends the message: what to do."""

    def __iter__(self) -> Iterator[Any]:
        """Arguments of `check_number` after the value."""
        return iter((self.least, self.greatest, self.unit, self.hint))

    def __str__(self) -> str:
        bounds = (
            str(bound) if isinstance(bound, int) else f"{bound:g}" for bound in (self.least, self.greatest)
        )
        return f"{' to '.join(bounds)} {self.unit}".rstrip()

    def __repr__(self) -> str:
        return repr(str(self))  # for signatures in the documentation


#: Marks the type of an option, or of a group of options, that only `--help-all` shows.
ADVANCED = "advanced"
#: Seeds of random numbers.
SEED = Range(0, 2**63 - 1)
#: Expectation of a command of the plans that it goes through.
PLANS = "floor plans, or folders of them"
#: Levels of noise.
LEVEL = Range(0, 100, "times what was published", "0 is no noise.")
#: Carrier frequencies that the models of materials and antennas are meant for.
FREQUENCY_HZ = Range(1e8, 1e12, "Hz", "28 GHz are 28e9.")
#: Coordinates beyond lie on no plan of a building [m].
FARTHEST = 1e7
#: Radii of robots' hulls.
RADIUS_M = Range(0.001, 5, "m")
#: Actions of an episode, decisions of a walk.
STEPS = Range(1, 1_000_000)
#: Tasks of a plan, and episodes of a task.
TASKS = Range(1, 10_000)
#: Sides of square pictures.
SIZE_PX = Range(8, 4096, "pixels", "Try 128.")


@runtime_checkable
class Check(Protocol):
    """Anything else in an annotation that checks values itself, such as a registry of parts."""

    def check(self, name: str, value: Any) -> None:
        """See that a value will do; ValueError if it does not."""


class _Rule(NamedTuple):
    """Rule that the annotation of a field declares."""

    bounds: Range | None
    choices: tuple[Any, ...]
    part_check: Check | None
    whole: bool
    optional: bool
    several: bool
    size: int | None
    """How many values a field of several has; None for any number."""

    def check(self, name: str, value: Any) -> None:
        if value is None and self.optional:
            return
        values = value if self.several else (value,)
        if not isinstance(values, (tuple, list)) or self.size not in (None, len(values)):
            raise ValueError(f"{name} is {shown(value)}, expected {self.size or 'several'} values.")
        for item in values:
            if self.part_check is not None:
                self.part_check.check(name, item)
            elif self.bounds is not None:
                check_number(name, item, *self.bounds, whole=self.whole)
            else:
                check_choice(name, item, self.choices)


def checked(cls: type[T]) -> type[T]:
    """Decorate a class, below `@dataclass`: check what its fields declare, then run its own `__post_init__`."""
    post_init = getattr(cls, "__post_init__", None)

    def __post_init__(self: Any) -> None:
        for name, rule in _rules(self.__class__).items():
            rule.check(name, getattr(self, name))
        if post_init is not None:
            post_init(self)

    cls.__post_init__ = __post_init__  # type: ignore[attr-defined]
    return cls


def check_arguments(function: Any, arguments: Mapping[str, Any]) -> None:
    """See that arguments of a function lie within what its annotations declare; ValueError if one does not."""
    for name, rule in _rules(function).items():
        if name in arguments:
            rule.check(name, arguments[name])


@cache
def _rules(declared_by: Any) -> dict[str, _Rule]:
    """Return the rules that fields of a class or arguments of a function declare."""
    rules = {}
    for name, hint in get_type_hints(declared_by, include_extras=True).items():
        declared = getattr(hint, "__metadata__", ())
        bounds = next((note for note in declared if isinstance(note, Range)), None)
        part_check = next((note for note in declared if isinstance(note, Check)), None)
        kind = get_args(hint)[0] if declared else hint
        kinds = _alternatives(kind)
        items = next((get_args(member) for member in kinds if get_origin(member) is tuple), ())
        optional, size = NoneType in kinds, len(items) if items and items[-1] is not ... else None
        kinds = (*kinds, *(each for item in items for each in _alternatives(item)))
        choices = next((get_args(member) for member in kinds if get_origin(member) is Literal), ())
        if bounds or part_check or choices:
            whole = int in kinds and float not in kinds
            rules[name] = _Rule(bounds, choices, part_check, whole, optional, bool(items), size)
    return rules


def _alternatives(kind: Any) -> tuple[Any, ...]:
    """The members of a union; any other type alone."""
    return (kind,) if isinstance(kind, type) or get_origin(kind) in (Literal, tuple) else get_args(kind)


def check_number(
    name: str,
    value: Any,
    least: float,
    greatest: float,
    unit: str = "",
    hint: str = "",
    *,
    whole: bool = False,
) -> None:
    """See that a value is a number between two bounds, which count in; ValueError if it is not."""
    is_number = isinstance(value, Integral if whole else Real) and not isinstance(value, bool)
    if is_number and least <= value <= greatest:
        return
    bounds = f"{'a whole number from ' if whole else ''}{Range(least, greatest, unit)}"
    raise ValueError(f"{name} is {shown(value)}, expected {bounds}.{' ' if hint else ''}{hint}")


def check_choice(name: str, value: Any, known: Iterable[str]) -> None:
    """See that a value is one of some names.

    Raises:
        ValueError: If it is none of them; the message says which was perhaps meant.
    """
    known = tuple(known)
    if isinstance(value, str) and value in known:
        return
    near = get_close_matches(value, known, n=1) if isinstance(value, str) else []
    hint = f"Did you mean {near[0]!r}? " if near else ""
    raise ValueError(f"{name} is {shown(value)}. {hint}Known: {', '.join(known)}.")


def check_some(name: str, values: Collection[object], expected: str) -> None:
    """Raise ValueError if there is none of several values."""
    if not values:
        raise ValueError(f"{name} is empty, expected {expected}.")


def shown(value: Any) -> str:
    """A value as messages show it."""
    text = repr(value) if isinstance(value, str) else str(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
