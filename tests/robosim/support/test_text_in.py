"""JSON and YAML whose nesting and numbers are bounded."""

import pytest
import yaml

from robosim.support import text_in
from robosim.support.text_in import MOST_DEEP, check_object, parse_json, parse_yaml


def test_json_is_read():
    text = b'\xef\xbb\xbf{"a": [1, -2.5, true, null, "\\u00e9"], "b": {}}'
    assert parse_json(text) == {"a": [1, -2.5, True, None, "é"], "b": {}}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b'{"a": NaN}', "NaN is no number"),
        (b"[-Infinity]", "-Infinity is no number"),
        (b"[1e999]", "1e999 is beyond all numbers"),
        (b"[" + b"9" * 400 + b"]", "a whole number of more than 40 digits"),
        (b"[" * 41 + b"]" * 41, "nested more than 40 deep"),
        (b'{"a":' * 900 + b"1" + b"}" * 900, "nested more than 40 deep"),
        (b"[1,]", "Expecting value|Illegal trailing comma"),
    ],
)
def test_json_that_grows_without_end_is_an_error(text, words):
    with pytest.raises(ValueError, match=words):
        parse_json(text)


def test_json_nested_beyond_the_stack_ends_in_an_error():
    with pytest.raises((ValueError, RecursionError)):
        parse_json(b"[" * 1_000_000)


def test_infinite_numbers_can_be_allowed():
    assert parse_json(b"[Infinity, 1e999]", numbers="any") == [float("inf"), float("inf")]


def test_yaml_is_read_as_by_the_safe_loader_but_for_dates():
    text = b"a: [1, 0x1F, 1_000, .5, -1e+3, yes, ~, no date, 'it''s']\nc: {<<: {d: 1}, e: 2}\n"
    assert parse_yaml(text) == yaml.safe_load(text)
    assert parse_yaml(b"2024-02-31: 2020-01-01") == {"2024-02-31": "2020-01-01"}
    assert parse_yaml(b"a: 1e-5\nb: [no, 2]", as_text=True) == {"a": "1e-5", "b": ["no", "2"]}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"a: !!int ''", "tags are not supported in line 1, column 4"),
        (b"a: !!bool maybe", "tags are not supported"),
        (b"a: " + b"9" * 400, "a whole number of 400 digits"),
        (b"a: !!python/object/apply:os.system ['exit 1']", "tags are not supported"),
        (b"&a [*a]", "aliases are not supported in line 1, column 1"),
        (b"[" * 100, "nested more than 40 deep"),
        (b"- " * 100_000, "nested more than 40 deep"),
        (b"{a: " * 100, "nested more than 40 deep"),
        (b"? [a]\n: b", "unhashable"),
        (b"a: [", "expected"),
        (b"a: 1\n--- 2", "but found another document|single document"),
    ],
)
@pytest.mark.parametrize("as_text", [False, True])
def test_damaged_yaml_is_an_error_with_its_place(text, words, as_text):
    if as_text and text.startswith(b"a: 9"):
        return
    with pytest.raises(ValueError, match=words):
        parse_yaml(text, as_text=as_text)


def test_a_document_of_many_values_is_an_error(monkeypatch):
    """Values, not bytes, take the time: 150,000 of them ten seconds."""
    monkeypatch.setattr(text_in, "_MOST_VALUES", 100)
    with pytest.raises(ValueError, match="more than 100 values"):
        parse_yaml(b"[" + b"a," * 100 + b"]")
    assert len(parse_yaml(b"[" + b"a," * 99 + b"]")) == 99


def test_the_deepest_content_can_be_written_again():
    deepest = b"[" * MOST_DEEP + b"1" + b"]" * MOST_DEEP
    assert parse_json(deepest) == parse_yaml(deepest)


def test_objects_are_checked():
    assert check_object({"a": 1}, ("a",)) == {"a": 1}
    with pytest.raises(ValueError, match="'b' is missing"):
        check_object({"a": 1}, ("a", "b"))
    with pytest.raises(ValueError, match="a list, expected keys"):
        check_object([])
