"""JSON, YAML and rows of numbers from files, bounded in nesting, digits and number of values.

YAML has the types of JSON, and neither aliases, of which small files of exponential content are made, nor tags. For use
inside of `robosim.support.reading.reading`, which adds the name of the file to errors.
"""

import csv
import io
import json
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import yaml
from jaxtyping import Float

from robosim.support.reading import reading

#: Largest files [bytes]. YAML is parsed by Python at 100 kB per second.
MOST_JSON, MOST_YAML = 16_000_000, 600_000
#: Lists and dictionaries within each other.
MOST_DEEP = 40
MOST_DIGITS = 40
_TOO_LONG = re.compile(rb"(?<![0-9.])[0-9]{%d}" % (MOST_DIGITS + 1))
#: Angles of a table, which may count turns but are not in degrees [rad].
_MOST_RAD = 100.0
#: Values of a YAML file: so many take ten seconds.
_MOST_VALUES = 150_000


def parse_json(content: bytes, *, numbers: str = "finite") -> Any:
    """The value of a JSON text in UTF-8; `numbers="any"` accepts NaN and Infinity too, which JSON lacks."""
    if _TOO_LONG.search(content):
        raise ValueError(f"a whole number of more than {MOST_DIGITS} digits")
    constant, real = (None, None) if numbers == "any" else (_no_number, _real)
    value = json.loads(
        content.decode("utf-8-sig"), parse_constant=constant, parse_float=real, object_pairs_hook=_unique_keys
    )
    _check_depth(value)
    return value


def read_json(
    path: str | Path,
    what: str,
    remedy: str = "Copy or export it again.",
    *,
    keys: tuple[str, ...] = (),
    most_bytes: int = MOST_JSON,
) -> dict[str, Any]:
    """The dictionary of a JSON file with some `keys`; `what`, `remedy` and `most_bytes` as in `reading`."""
    with reading(path, what, remedy, most_bytes=most_bytes) as file:
        return check_object(parse_json(file.read()), keys)


def parse_yaml(content: bytes, *, as_text: bool = False) -> Any:
    """The value of a YAML text; `as_text` leaves numbers and truth values as text."""
    try:
        value = yaml.load(content, Loader=_TextLoader if as_text else _ValueLoader)
        _check_depth(value)
        return value
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = "" if mark is None else f" in line {mark.line + 1}, column {mark.column + 1}"
        raise ValueError(f"{error.problem or error.context}{where}") from error


def number_rows(content: bytes) -> tuple[list[int], list[list[float]]]:
    """Numbers of lines, from 1, and of their values; empty lines and lines that begin with # are left out.

    Raises:
        ValueError: With the line, if a word in it is not a number.
    """
    lines, rows = [], []
    for number, line in enumerate(content.decode("utf-8-sig").splitlines(), 1):
        words = line.replace(",", " ").split()
        if words and not words[0].startswith("#"):
            lines.append(number)
            rows.append(line_numbers(words, number))
    return lines, rows


def csv_rows(
    content: bytes, needed: Sequence[str]
) -> tuple[Iterator[tuple[int, dict[str, str]]], Sequence[str]]:
    """Rows of a CSV table, each with its line, and its columns.

    ValueError if a column is there twice, or is `needed` and missing.
    """
    table = csv.DictReader(io.StringIO(content.decode("utf-8-sig")))
    columns = table.fieldnames or ()
    if missing := [name for name in needed if name not in columns]:
        raise ValueError(f"column {missing[0]!r} is missing")
    if twice := [name for name in columns if name and columns.count(name) > 1]:
        raise ValueError(f"column {twice[0]!r} is there twice, expected once")
    return ((table.line_num, _whole_row(row, table.line_num, columns)) for row in table), columns


def _whole_row(row: dict[Any, Any], line: int, columns: Sequence[str]) -> dict[str, str]:
    """A row without empty cells after the last column; ValueError if there is a value in them."""
    if any(text.strip() for text in row.pop(None, ())):
        raise ValueError(
            f"line {line} has more than {len(columns)} values; decimals have a point, not a comma"
        )
    return row


def csv_number(row: dict[str, str], column: str, line: int, low: float, high: float) -> float:
    """A number of a row of `csv_rows` within bounds; ValueError with the line if it is none, or in degrees."""
    text = row[column] or ""
    if column.endswith("_rad"):
        low, high = max(low, -_MOST_RAD), min(high, _MOST_RAD)
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise ValueError(
            f"line {line}: {column} is {text[:40]!r}, expected a number from {low:g} to {high:g}"
        )
    return value


def line_numbers(words: list[str], line: int) -> list[float]:
    """Numbers from the words of a line; ValueError with the line for a word that is none."""
    try:
        return [float(word) for word in words]
    except ValueError as error:
        raise ValueError(f"line {line}: {error}") from error


def check_rising(lines: list[int], times: Float[np.ndarray, " n"]) -> None:
    """Raise ValueError for the first line whose time is not finite or does not rise."""
    wrong = ~np.isfinite(times) | (np.diff(times, prepend=-np.inf) <= 0)
    if wrong.any():
        k = int(wrong.argmax())
        before = f", after {times[k - 1]:.16g} s" if k else ""
        raise ValueError(f"line {lines[k]} has the time {times[k]:.16g} s{before}; times have to rise")


def check_object(value: Any, keys: tuple[str, ...] = ()) -> dict[str, Any]:
    """The value, if it is a dictionary with these keys; else ValueError."""
    if not isinstance(value, dict):
        raise ValueError(f"a {type(value).__name__}, expected keys and values")
    if missing := [key for key in keys if key not in value]:
        raise ValueError(f"{missing[0]!r} is missing")
    return value


def _check_depth(value: Any) -> None:
    level = [value]
    for _ in range(MOST_DEEP):
        level = [
            item
            for each in level
            if isinstance(each, (dict, list))
            for item in (each.values() if isinstance(each, dict) else each)
            if isinstance(item, (dict, list))
        ]
        if not level:
            return
    raise ValueError(f"nested more than {MOST_DEEP} deep")


def _unique_keys(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    """A dictionary of keys and values; ValueError if a key is there twice."""
    value = dict(pairs)
    if len(value) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key {twice[:80]!r} is there twice, expected once")
    return value


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number of JSON")


def _real(digits: str) -> float:
    number = float(digits)
    if math.isinf(number):
        raise ValueError(f"{digits[:MOST_DIGITS]} is beyond all numbers")
    return number


def _problem(what: str, at: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(None, None, what, at.start_mark)


class _TextLoader(yaml.BaseLoader):
    """Text, lists and dictionaries, of bounded depth and number, without aliases and tags."""

    def __init__(self, stream: bytes) -> None:
        super().__init__(stream)
        self._depth = self._values = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
            raise _problem("anchors and aliases are not supported", event)
        if event.tag is not None:
            raise _problem("tags are not supported", event)
        self._values, self._depth = self._values + 1, self._depth + 1
        if self._values > _MOST_VALUES:
            raise _problem(f"more than {_MOST_VALUES} values", event)
        if self._depth > MOST_DEEP + 1:
            raise _problem(f"nested more than {MOST_DEEP} deep", event)
        node = super().compose_node(parent, index)
        self._depth -= 1
        if isinstance(node, yaml.MappingNode):
            _unique_keys([(key.value, key) for key, _ in node.value if isinstance(key, yaml.ScalarNode)])
        return node


class _ValueLoader(_TextLoader, yaml.SafeLoader):
    """JSON's types; dates stay text."""

    def construct_yaml_int(self, node: Any) -> int:
        if len(node.value) > MOST_DIGITS:
            raise _problem(f"a whole number of {len(node.value)} digits", node)
        return super().construct_yaml_int(node)


_ValueLoader.yaml_implicit_resolvers = {
    letter: [(tag, pattern) for tag, pattern in resolvers if not tag.endswith(":timestamp")]
    for letter, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_ValueLoader.add_constructor("tag:yaml.org,2002:int", _ValueLoader.construct_yaml_int)
