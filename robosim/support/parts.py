"""Parts that somebody may want to replace: by name, as an object, or as `module:Name`.

Each kind of part has one `Kind` (they are listed in `robosim.parts`). From its names the choices of the command line,
checks and messages are made. Whatever a configuration holds for a part may be

- the name of one that comes with this package;
- `module:Name`, which is looked for in the current folder and wherever Python looks;
- in Python, an object: the part itself, or a class or function that makes one.

A class or function is called with what that kind is made from, and has to give what is asked of a part of that kind.
"""

import dataclasses
import importlib
import os
import sys
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import tyro

from robosim.support.checks import check_choice, shown

#: A part in a configuration: a name, `module:Name`, or an object.
Part = Any


@dataclasses.dataclass(frozen=True, eq=False)
class Kind:
    """One kind of part."""

    name: str
    """What messages call it, such as "goal policy"."""
    shipped: Mapping[str, str]
    """Those that come with this package, each as `module:Name` or a file."""
    has: tuple[str, ...]
    """Methods and attributes that a part of this kind must have."""
    made_from: str
    """What a class or function is called with, in words."""
    suffixes: tuple[str, ...] = ()
    """Endings of files that stand for a part, too."""
    from_file: str = ""
    """What makes a part of such a file, as `module:Name`; it is called with the file's path first."""

    def is_name(self, part: Part) -> bool:
        """Whether a part is told by a name, right or wrong, and not by `module:Name` or a file."""
        return isinstance(part, str) and ":" not in part and not self._is_file(part)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the shipped ones."""
        return tuple(self.shipped)

    def check(self, field: str, part: Part) -> None:
        """See that there is such a part; `module:Name` is imported.

        Args:
            field: What the message calls the value.
            part: What was given.

        Raises:
            ValueError: If there is none.
        """
        if not isinstance(part, str):
            self._check_object(field, part)
        elif ":" in part:
            self._check_object(field, _imported(field, part))
        elif part in self.shipped:
            return
        elif not self._is_file(part):
            near = get_close_matches(part, self.shipped, n=1)
            hint = f"Did you mean {near[0]!r}? " if near else ""
            raise ValueError(f"{field} is {shown(part)}. {hint}Known: {self.choices}.")
        elif not Path(part).is_file():
            raise ValueError(
                f"{field} is {shown(part)}, but there is no such file. Known without a file: "
                f"{', '.join(self.shipped)}."
            )

    @property
    def choices(self) -> str:
        """What may be given, in words."""
        files = [f"a {suffix} file" for suffix in self.suffixes]
        return f"{', '.join(self.shipped)}, {', '.join([*files, 'or module:Name of your own'])}"

    def make(self, part: Part, *made_from: Any, field: str = "", **options: Any) -> Any:
        """The part itself.

        Args:
            part: A name, `module:Name`, file or object.
            made_from: What a class or function is called with.
            field: What a message calls the value; that of the kind if not given.
            options: The same by keyword.

        Raises:
            ValueError: If there is none, or what was made is no such part.
        """
        field = field or self.name
        if isinstance(part, str):
            self.check(field, part)
        target, before = part, made_from
        if isinstance(part, str):
            place = self.shipped.get(part, part)
            if self._is_file(place):
                target, before = _imported(field, self.from_file), (Path(place), *made_from)
            else:
                target = _imported(field, place)
        if self._is_one(target):
            return target
        if not callable(target):
            self._check_object(field, target)
        try:
            made = target(*before, **options)
        except (ValueError, OSError):
            raise
        except Exception as error:
            if isinstance(part, str) and part in self.shipped:
                raise
            raise ValueError(
                f"{field} is {told(part)}, but making it from {self.made_from} fails: {error!r}."
            ) from error
        if missing := self._missing(made):
            raise ValueError(
                f"{field} is {told(part)}, which made a {type(made).__name__} without {missing[0]}. A {self.name} "
                f"has {', '.join(self.has)}."
            )
        return made

    def option(self, *more: str, metavar: str = "") -> tyro.constructors.PrimitiveConstructorSpec[Any]:
        """How the command line takes such a part: what a field that holds one is annotated with.

        Args:
            more: Other words that the field may hold.
            metavar: What the help shows instead of all names, where another option shows them.
        """
        shown_names = [*more, *self.shipped, *(f"FILE{suffix}" for suffix in self.suffixes), "MODULE:NAME"]
        return tyro.constructors.PrimitiveConstructorSpec(
            nargs=1,
            metavar=metavar or f"{{{','.join(shown_names)}}}",
            instance_from_str=lambda words: words[0],
            is_instance=lambda value: True,
            str_from_instance=lambda value: [told(value)],
            # They would be all that may be given; a shell that completes words is to know them all the same.
            choices=tuple(shown_names) if any(word.startswith("--tyro-") for word in sys.argv) else None,
        )

    def _is_file(self, part: str) -> bool:
        return Path(part).suffix in self.suffixes

    def _missing(self, made: Any) -> list[str]:
        return [name for name in self.has if not hasattr(made, name)]

    def _is_one(self, target: Any) -> bool:
        return not isinstance(target, type) and not self._missing(target)

    def _check_object(self, field: str, target: Any) -> None:
        if not self._is_one(target) and not callable(target):
            missing = self._missing(target)
            raise ValueError(
                f"{field} is {shown(target)}, a {type(target).__name__} without {missing[0]}. A {self.name} has "
                f"{', '.join(self.has)}; a class or function that makes one from {self.made_from} does too. Known: "
                f"{self.choices}."
            )


def told(part: Part) -> str:
    """A part as text: the name that it was given by, or `module:Name` where its class or itself is to be found."""
    if isinstance(part, str):
        return part
    known = part if hasattr(part, "__qualname__") else type(part)
    return f"{known.__module__}:{known.__qualname__}"


def _imported(field: str, name: str) -> Any:
    """What `module:Name` stands for."""
    module, _, path = name.partition(":")
    here = os.getcwd()
    if here not in sys.path and "" not in sys.path:
        sys.path.insert(0, here)  # a console script looks beside itself only
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ValueError(
            f"{field} is {shown(name)}, but there is no module {error.name!r} in {here}, nor where Python looks. "
            "Start in the folder where it lies, or install it."
        ) from error
    except Exception as error:  # whatever somebody's module raises
        raise ValueError(f"{field} is {shown(name)}, but importing {module!r} fails: {error!r}.") from error
    for attribute in path.split("."):
        if not hasattr(found, attribute):
            near = get_close_matches(attribute, dir(found), n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"{field} is {shown(name)}, but {module!r} has no {attribute!r}.{hint}")
        found = getattr(found, attribute)
    return found


def is_part(field: "dataclasses.Field[Any]") -> bool:
    """Whether a field of a configuration holds a part."""
    return get_origin(field.type) is Annotated and Any in get_args(field.type)


def described(config: Any) -> dict[str, Any]:
    """A configuration in plain values, as `dataclasses.asdict` gives it; parts by their names.

    Args:
        config: A dataclass. A part that is an object is told by its class, and by its fields if it is a dataclass.
    """
    plain = {}
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if is_part(field) and not isinstance(value, str):
            of_its_own = described(value) if dataclasses.is_dataclass(value) else {}
            plain[field.name] = {"part": told(value), **of_its_own}
        else:
            plain[field.name] = _described(value)
    return plain


def _described(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return described(value)
    return [_described(item) for item in value] if isinstance(value, (tuple, list)) else value


def restored(kind: type, values: Mapping[str, Any]) -> Any:
    """A configuration from what `described` told of it; what is not told is as by default.

    Raises:
        ValueError: If a field is unknown, or a value none that the field may have.
    """
    hints = get_type_hints(kind)
    known = [field.name for field in dataclasses.fields(kind)]
    for name in values:
        check_choice(f"a setting of {kind.__name__}", name, known)
    return kind(**{name: _restored(hints[name], value) for name, value in values.items()})


def _restored(hint: Any, value: Any) -> Any:
    if hint is Any and isinstance(value, dict) and "part" in value:
        found = _imported("part", str(value["part"]))
        rest = {name: one for name, one in value.items() if name != "part"}
        return restored(found, rest) if rest else found
    if isinstance(value, dict):
        # A field that may be None has its class among its arguments.
        for one in (hint, *get_args(hint)):
            if dataclasses.is_dataclass(one):
                return restored(one, value)  # type: ignore[arg-type]
    if isinstance(value, list):
        for kind in (hint, *get_args(hint)):
            if get_origin(kind) is tuple:
                inner = get_args(kind)
                several = inner[:1] * len(value) if inner[-1] is ... else inner
                if len(several) != len(value):
                    raise ValueError(f"{value} has {len(value)} values, expected {len(several)}.")
                return tuple(_restored(one, each) for one, each in zip(several, value, strict=True))
    return value
