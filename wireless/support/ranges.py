"""Ranges and choices that a configuration declares in its annotations, checked when one is made.

    @dataclass(frozen=True, kw_only=True)
    @checked
    class Receiver:
        height_m: Annotated[float, Range(0, 100, "m")] = 1.5
        law: Literal["bisector", "nearer_face"] = "bisector"

`Receiver(height_m=-1)` raises "height_m is -1, expected 0 to 100 m."
"""

from dataclasses import dataclass
from functools import cache
from numbers import Integral, Real
from types import NoneType
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

T = TypeVar("T")


# Not a tuple: early Python 3.11 returns an equal annotation made before, whose range may be that of another package.
@dataclass(frozen=True, repr=False)
class Range:
    """Smallest and largest value of a number, and its unit."""

    least: float
    most: float
    unit: str = ""
    hint: str = ""
    """Sentence that ends the message: what to do."""

    def __str__(self) -> str:
        bounds = (str(bound) if isinstance(bound, int) else f"{bound:g}" for bound in (self.least, self.most))
        return f"{' to '.join(bounds)} {self.unit}".rstrip()

    def __repr__(self) -> str:
        return repr(str(self))  # for signatures in the documentation


class _Rule(NamedTuple):
    """What the annotation of a field declares."""

    whole: bool
    optional: bool
    bounds: Range | None
    choices: tuple[str, ...]

    def allows(self, value: Any) -> bool:
        if value is None:
            return self.optional
        if self.bounds is None:
            return isinstance(value, str) and value in self.choices
        is_number = isinstance(value, Integral if self.whole else Real) and not isinstance(value, bool)
        return is_number and bool(self.bounds.least <= value <= self.bounds.most)

    def __str__(self) -> str:
        expected = f"one of {', '.join(self.choices)}" if self.bounds is None else str(self.bounds)
        expected = (
            f"{'a whole number from ' if self.whole else ''}{expected}{', or None' if self.optional else ''}."
        )
        return f"{expected} {self.bounds.hint}" if self.bounds and self.bounds.hint else expected


def checked(cls: type[T]) -> type[T]:
    """Decorate a class, below `@dataclass`: check what its fields declare, then run its own `__post_init__`."""
    own = getattr(cls, "__post_init__", None)

    def __post_init__(self: Any) -> None:
        for name, rule in _rules(self.__class__).items():
            value = getattr(self, name)
            if not rule.allows(value):
                shown = repr(value) if isinstance(value, str) else str(value)
                shown = shown if len(shown) <= 60 else f"{shown[:60]}..."
                raise ValueError(f"{name} is {shown}, expected {rule}")
        if own is not None:
            own(self)

    cls.__post_init__ = __post_init__  # type: ignore[attr-defined]
    return cls


@cache
def _rules(cls: type) -> dict[str, _Rule]:
    """What the fields of a class declare."""
    rules = {}
    for name, hint in get_type_hints(cls, include_extras=True).items():
        bounds = next((one for one in getattr(hint, "__metadata__", ()) if isinstance(one, Range)), None)
        kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
        kinds = (kind,) if get_origin(kind) is Literal else get_args(kind) or (kind,)
        choices = next((get_args(one) for one in kinds if get_origin(one) is Literal), ())
        if bounds or choices:
            rules[name] = _Rule(int in kinds, NoneType in kinds, bounds, choices)
    return rules
