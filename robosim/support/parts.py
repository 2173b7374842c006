"""Parts that somebody may want to replace: by name, as an object, or as `module:Name`.

Each kind of part has one `Kind` (they are listed in `robosim.parts`). From its names the choices of the command line,
checks and messages are made. Whatever a configuration holds for a part may be

- the name of one that comes with this package;
- `module:Name`, which is looked for in the current folder and wherever Python looks;
- in Python, an object: the part itself, or a class or function that makes one.

A class or function is called with the inputs of its kind, and must return a part with the methods of its kind.

`module:Name` counts where a person types it. Data files (maps, furnishings, storeys, layers of walls) name registered
parts only: their readers use `Kind.name_in_data`. Suites and configurations may name code, which is imported within
`code_allowed()` only, the option `--allow-code`.
"""

import dataclasses
import importlib.util
import inspect
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import tyro

from robosim.support.checks import shown
from robosim.support.reading import PACKAGES, FileError

#: A part in a configuration: a name, `module:Name`, or an object.
Part = Any
_CODE = re.compile(r"[^\W\d][\w.]*:[^\W\d][\w.]*")
#: Whether suites and configurations may name code.
_allowed = False
#: Files and folders of the modules that persons named.
_persons = set[Path]()


@dataclasses.dataclass(frozen=True, eq=False)
class Kind:
    """Kind of part."""

    name: str
    """Name in messages, such as "goal policy"."""
    shipped: Mapping[str, str]
    """Parts that come with this package, each as `module:Name` or a file."""
    has: tuple[str, ...]
    """Methods and attributes that a part of this kind must have."""
    made_from: str
    """Arguments that a class or function is called with, in words."""
    suffixes: tuple[str, ...] = ()
    """Endings of files that stand for a part, too."""
    from_file: str = ""
    """Function that makes a part of such a file, as `module:Name`; it is called with the file's path first."""
    protocol: str = ""
    """Class, as `module:Name`, whose attributes and methods are the defaults of those that a part lacks."""

    def is_name(self, part: Part) -> bool:
        """Whether a part is given by a name, right or wrong, and not by `module:Name` or a file."""
        return isinstance(part, str) and not names_code(part) and not self._is_file(part)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the shipped parts."""
        return tuple(self.shipped)

    def check(self, field: str, part: Part) -> None:
        """Raise ValueError, naming `field`, if there is no such part; `module:Name` is imported."""
        if not isinstance(part, str):
            self._check_object(field, part)
        elif names_code(part):
            self._check_object(field, imported(field, part))
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

    def name_in_data(self, field: str, value: Any, folder: Path) -> str:
        """A registered part, or a file relative to `folder`, that a data file names. Nothing is imported.

        Raises:
            ValueError: If there is none of that name, or it is `module:Name`.
        """
        if not isinstance(value, str):
            raise ValueError(f"{field} is {shown(value)}, expected a name. Known: {', '.join(self.shipped)}.")
        if names_code(value):
            files = "".join(f" or a {suffix} file" for suffix in self.suffixes[:1])
            raise ValueError(
                f"{field} is {shown(value)}, which names code, and data files run none. Name a registered part"
                f"{files}: {', '.join(self.shipped)}."
            )
        part = str(folder / value) if self._is_file(value) else value
        self.check(field, part)
        return part

    @property
    def choices(self) -> str:
        """Return the possible values, in words."""
        files = [f"a {suffix} file" for suffix in self.suffixes]
        return f"{', '.join(self.shipped)}, {', '.join([*files, 'or module:Name of your own'])}"

    def make(self, part: Part, *made_from: Any, field: str = "", **options: Any) -> Any:
        """The part of a name, `module:Name` or file, or an object; classes and functions are called with `made_from`.

        Raises:
            ValueError: If there is none, or the result is no such part; the message begins with the name `field`.
        """
        field = field or self.name
        if isinstance(part, str):
            self.check(field, part)
        target, before = part, made_from
        if isinstance(part, str):
            place = self.shipped.get(part, part)
            if self._is_file(place):
                target, before = imported(field, self.from_file), (Path(place), *made_from)
            else:
                target = imported(field, place)
        if self._is_one(target):
            return self._completed(target)
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
                f"{field} is {part_name(part)}, but making it from {self.made_from} fails: {error!r}{_in_file(error)}."
            ) from error
        if missing := self._missing(made):
            raise ValueError(
                f"{field} is {part_name(part)}, which made a {type(made).__name__} without {missing[0]}. A {self.name} "
                f"has {', '.join(self.has)}."
            )
        return self._completed(made)

    def _completed(self, part: Any) -> Any:
        """The part, with the defaults of its protocol for what it lacks: users' parts need not derive from it."""
        defaults = vars(imported(self.name, self.protocol)) if self.protocol else {}
        for name, default in defaults.items():
            if not name.startswith("_") and not hasattr(part, name):
                setattr(part, name, default.__get__(part) if callable(default) else default)
        return part

    def option(self, *more: str, metavar: str = "") -> tyro.constructors.PrimitiveConstructorSpec[Any]:
        """How the command line takes such a part, or one of the words `more`: an annotation of a field.

        `metavar` replaces the list of all names in the help, where another option lists them.
        """
        shown_names = [*more, *self.shipped, *(f"FILE{suffix}" for suffix in self.suffixes), "MODULE:NAME"]
        return tyro.constructors.PrimitiveConstructorSpec(
            nargs=1,
            metavar=metavar or f"{{{','.join(shown_names)}}}",
            instance_from_str=lambda words: words[0],
            is_instance=lambda value: True,
            str_from_instance=lambda value: [part_name(value)],
            # As choices these names would exclude all others; a shell that completes words still needs them.
            choices=tuple(shown_names) if any(word.startswith("--tyro-") for word in sys.argv) else None,
        )

    def _is_file(self, part: str) -> bool:
        return Path(part).suffix in self.suffixes and not names_code(part)

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


def part_name(part: Part) -> str:
    """A part as text: the name that it was given by, or `module:Name` where its class or itself is to be found."""
    if isinstance(part, str):
        return part
    known = part if hasattr(part, "__qualname__") else type(part)
    return f"{known.__module__}:{known.__qualname__}"


def accepted(function: Callable[..., Any], names: Sequence[str]) -> tuple[str, ...]:
    """Names of keyword arguments that a function accepts: a part is given those inputs that it has arguments for."""
    parameters = inspect.signature(function).parameters
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values()):
        return tuple(names)
    return tuple(name for name in names if name in parameters)


def names_code(part: Part) -> bool:
    """Whether a part is `module:Name`."""
    return isinstance(part, str) and _CODE.fullmatch(part) is not None


@contextmanager
def code_allowed(allowed: bool = True) -> Iterator[None]:
    """Within the block, code that suites and configurations name is imported."""
    global _allowed
    before, _allowed = _allowed, allowed
    try:
        yield
    finally:
        _allowed = before


def check_code_allowed(field: str, part: Part) -> None:
    """Raise FileError if a suite or configuration names code and may not."""
    if names_code(part) and not _allowed:
        raise FileError(
            f"{field} is {shown(part)}, which names code to be run. Give --allow-code if you trust the file "
            "(in Python: robosim.support.parts.code_allowed)."
        )


def imported(field: str, name: str) -> Any:
    """The object that `module:Name` names; ValueError, whose message begins with the name `field`, if there is none.

    The name comes from a person or from this project; names in files go through `check_code_allowed` first.
    """
    module, _, path = name.partition(":")
    ours = module.partition(".")[0] in PACKAGES
    try:
        if not ours:
            _add_current_folder(module)
        target = importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ValueError(
            f"{field} is {shown(name)}, but there is no module {error.name!r} in {os.getcwd()}, nor where Python "
            "looks. Start in the folder where it lies, or install it."
        ) from error
    except Exception as error:  # whatever somebody's module raises
        raise ValueError(
            f"{field} is {shown(name)}, but importing {module!r} fails: {error!r}{_in_file(error)}."
        ) from error
    for attribute in path.split("."):
        if not hasattr(target, attribute):
            near = get_close_matches(attribute, dir(target), n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"{field} is {shown(name)}, but {module!r} has no {attribute!r}.{hint}")
        target = getattr(target, attribute)
    return target


def _add_current_folder(module: str) -> None:
    """Search for modules in the current folder too, and note where the files of a user's part are."""
    here = os.getcwd()
    if here not in sys.path and "" not in sys.path:
        sys.path.append(here)
    with suppress(ValueError):  # modules without a file, such as __main__
        spec = importlib.util.find_spec(module.partition(".")[0])
        places = () if spec is None else (spec.origin, *(spec.submodule_search_locations or ()))
        _persons.update(Path(place) for place in places if place)


def place_in_part(error: BaseException) -> str:
    """Where in a person's own part an error was raised: "FILE, line N, in FUNCTION"; empty if not there."""
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        file = Path(frame.filename)
        if not _persons.isdisjoint((file, *file.parents)):
            return f"{file}, line {frame.lineno}, in {frame.name}"
    return getattr(error, "place_in_part", "")  # of an error in another process


def _in_file(error: Exception) -> str:
    place = place_in_part(error)
    return place and f" ({place})"


def is_part(field: "dataclasses.Field[Any]") -> bool:
    """Whether a field of a configuration holds a part."""
    return get_origin(field.type) is Annotated and Any in get_args(field.type)


def to_dict(config: Any) -> dict[str, Any]:
    """A configuration in plain values, as `dataclasses.asdict` gives it, with the names of parts.

    A part that is an object is given by its class, and by its fields if it is a dataclass.
    """
    plain = {}
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if is_part(field) and not isinstance(value, str):
            of_its_own = to_dict(value) if dataclasses.is_dataclass(value) else {}
            plain[field.name] = {"part": part_name(value), **of_its_own}
        else:
            plain[field.name] = _plain_value(value)
    return plain


def _plain_value(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return to_dict(value)
    return [_plain_value(item) for item in value] if isinstance(value, (tuple, list)) else value
