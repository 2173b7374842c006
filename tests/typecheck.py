"""Type checker of annotated functions in tests: an int is a float too (PEP 484).

Checking every call doubles the time of the tests. Each function is therefore checked for its first calls in each test.
"""

import inspect
import sys
from collections import Counter
from collections.abc import Callable
from functools import wraps
from typing import Any

from beartype import BeartypeConf, beartype

#: Checks per function and test; a call makes two, of its arguments and of its result.
ENOUGH = 60

_beartyped = beartype(conf=BeartypeConf(is_pep484_tower=True))
_checks: Counter[tuple[str, str]] = Counter()
_trusted: list[Callable[..., Any]] = []


def check(function: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a function with checks of its arguments and result, as jaxtyping's type checker."""
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
    """Check every function again."""
    _checks.clear()
    while _trusted:
        vars(_trusted.pop()).pop("__no_type_check__", None)


def _trust(module: str, qualified_name: str) -> None:
    """Disable the check of a function, if it can be found under its name."""
    found: Any = sys.modules.get(module)
    for name in qualified_name.split("."):
        found = inspect.getattr_static(found, name, None)
    found = getattr(found, "__func__", getattr(found, "fget", found))
    if found is not None:
        function = inspect.unwrap(found)
        if inspect.isfunction(function):
            function.__no_type_check__ = True  # type: ignore[attr-defined]
            _trusted.append(function)
