"""Help of options: the ranges that they declare, and a short help without advanced options.

`--help` leaves out options that are marked as `ADVANCED` and groups such as `--radio.*`, and names them at the end of
the description. `--help-all` shows every option.
"""

import inspect
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args, get_type_hints

import tyro
from tyro.conf import OmitArgPrefixes, Suppress, UseAppendAction
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructTypeInfo

from robosim.support.checks import ADVANCED, Range
from wireless.support.counting import counted

#: Options that print the help of a command, and the help with all its options.
HELP, HELP_ALL = {"-h", "--help"}, "--help-all"
#: Class of what `tyro.conf.arg` returns.
_ARG: Any = type(tyro.conf.arg(name="x"))
_METAVARS: dict[Any, str] = {int: "INT", float: "FLOAT", str: "STR", Path: "PATH"}


def option_registry(*, brief: bool) -> ConstructorRegistry:
    """Make the registry for `tyro.cli` by which fields of configurations become options as in `option_type`."""
    registry, inside = ConstructorRegistry(), False

    @registry.struct_rule
    def of_dataclass(info: StructTypeInfo) -> StructConstructorSpec | None:
        nonlocal inside
        if inside or not is_dataclass(info.type):
            return None
        inside = True  # so that the other rules apply
        try:
            spec = ConstructorRegistry.get_struct_spec(info)
        finally:
            inside = False
        if not isinstance(spec, StructConstructorSpec):
            return None
        return replace(
            spec,
            fields=tuple(replace(field, type=option_type(field.type, brief=brief)) for field in spec.fields),
        )

    return registry


def option_type(kind: Any, *, brief: bool) -> Any:
    """The type of an option with its range in the help; hidden from a brief help if it is advanced.

    Args:
        kind: Type of a field or an argument.
        brief: Whether the help is brief.
    """
    base, marks = _split(kind)
    if Suppress in marks:
        return kind
    if brief and (ADVANCED in marks or (is_dataclass(base) and not _is_flat(marks))):
        return Annotated[(base, *marks, Suppress)]
    if is_dataclass(base) or UseAppendAction in marks:
        return kind
    bounds = next((mark for mark in marks if isinstance(mark, Range)), None)

    def hint(default: str) -> str:
        parts = [f"default: {default}"] if default not in ("", "None") else []
        if bounds is not None:
            parts.append(f"range: {bounds}")
        return f"({'; '.join(parts)})" if parts else ""

    optional = [arg for arg in get_args(base) if arg is not NoneType] if NoneType in get_args(base) else []
    metavar = _METAVARS.get(optional[0]) if len(optional) == 1 else None
    return Annotated[(base, tyro.conf.arg(metavar=metavar, help_behavior_hint=hint), *marks)]


def brief_description(command: Callable[..., Any]) -> str:
    """The docstring of a command, with the options that `--help` leaves out at the end of its description."""
    text, sections, arguments = (inspect.getdoc(command) or "").partition("\n\nArgs:")
    hidden = list(_hidden(get_type_hints(command, include_extras=True).items()))
    if not hidden:
        return f"{text}{sections}{arguments}"
    return "\n".join([f"{text}\n\nMore options, which --help-all explains:", *hidden]) + sections + arguments


def option_name(field: str, kind: Any) -> str:
    """The name of the option of a field, by its annotation or else as in Python."""
    names = [mark.name for mark in _split(kind)[1] if isinstance(mark, _ARG) and mark.name]
    return f"--{names[0] if names else field.replace('_', '-')}"


def _hidden(options: Iterable[tuple[str, Any]]) -> Iterator[str]:
    """A line for each group of options that a brief help leaves out, and for each single one."""
    for name, kind in options:
        base, marks = _group(kind)
        option = option_name(name, kind)
        if Suppress in marks:
            continue
        if not is_dataclass(base):
            if ADVANCED in marks:
                yield option
            continue
        types = get_type_hints(base, include_extras=True)
        of_fields = [(setting.name, types[setting.name]) for setting in fields(base)]
        if _is_flat(marks) and ADVANCED not in marks:
            yield from _hidden(of_fields)
            continue
        names = ", ".join(option_name(*field) for field in of_fields if Suppress not in _split(field[1])[1])
        about = (base.__doc__ or "").splitlines()[0]
        yield f"{names if _is_flat(marks) else f'{option}.*'} ({counted(_count(base), 'option')}): {about}"
        for name_inside, kind_inside in of_fields:
            if _is_apart(kind_inside):
                inside = (name_inside, kind_inside)
                is_group = is_dataclass(_group(kind_inside)[0])
                yield from _hidden([inside]) if is_group else [option_name(*inside)]


def _count(config: Any) -> int:
    """Options of a group and of the groups in it, without those that are named apart."""
    types = [kind for kind in get_type_hints(config, include_extras=True).values() if not _is_apart(kind)]
    return sum(
        _count(base) if is_dataclass(base) else 1
        for base, marks in map(_group, types)
        if Suppress not in marks
    )


def _is_apart(kind: Any) -> bool:
    """Whether an option in a group is named without the names of the groups around it."""
    return any(isinstance(mark, _ARG) and mark.prefix_name is False for mark in _split(kind)[1])


def _group(kind: Any) -> tuple[Any, tuple[Any, ...]]:
    """A type without its annotations and without None, if it is a group then, and its annotations."""
    base, marks = _split(kind)
    return next((each for each in get_args(base) if is_dataclass(each)), base), marks


def _split(kind: Any) -> tuple[Any, tuple[Any, ...]]:
    """A type without its annotations, and these."""
    marks = getattr(kind, "__metadata__", ())
    return (get_args(kind)[0] if marks else kind), marks


def _is_flat(marks: tuple[Any, ...]) -> bool:
    """Whether options of a group are named without the group's name."""
    return OmitArgPrefixes in marks or any(getattr(mark, "name", None) == "" for mark in marks)
