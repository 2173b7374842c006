"""The type checker that the tests run annotated functions under: a whole number is a float too (PEP 484).

Looking at every argument doubles what the tests take. So each function is looked at until it was called often enough
in a test, and again in the next.
"""

import inspect
import sys
from collections import Counter
from collections.abc import Callable
from functools import wraps
from typing import Any

from beartype import BeartypeConf, beartype

#: Checks of a function in a test, of which a call makes two: of what is given and of what is returned.
ENOUGH = 60

_beartyped = beartype(conf=BeartypeConf(is_pep484_tower=True))
_checks: Counter[tuple[str, str]] = Counter()
_trusted: list[Callable[..., Any]] = []


def check(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that looks at what it is called with, for jaxtyping to call beside the one it is made after."""
    checked = _beartyped(function)
    name = (function.__module__, function.__qualname__)

    @wraps(function)
    def counted(*args: Any, **kwargs: Any) -> Any:
        _checks[name] += 1
        if _checks[name] == ENOUGH:
            _trust(*name)
        return checked(*args, **kwargs)

    return counted


def check_all_again() -> None:
    """Look at every function again."""
    _checks.clear()
    while _trusted:
        vars(_trusted.pop()).pop("__no_type_check__", None)


def _trust(module: str, qualified_name: str) -> None:
    """Let jaxtyping pass a function by, if it can be found under its name."""
    found: Any = sys.modules.get(module)
    for name in qualified_name.split("."):
        found = inspect.getattr_static(found, name, None)
    found = getattr(found, "__func__", getattr(found, "fget", found))
    if found is not None:
        function = inspect.unwrap(found)
        if inspect.isfunction(function):
            function.__no_type_check__ = True  # type: ignore[attr-defined]
            _trusted.append(function)
