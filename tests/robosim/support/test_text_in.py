"""JSON and YAML whose nesting, aliases and numbers are bounded."""

import time

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
def test_json_that_grows_without_end_is_refused(text, words):
    with pytest.raises(ValueError, match=words):
        parse_json(text)


def test_json_nested_beyond_the_stack_ends_in_an_error():
    with pytest.raises((ValueError, RecursionError)):
        parse_json(b"[" * 1_000_000)


def test_numbers_that_are_none_can_be_asked_for():
    assert parse_json(b"[Infinity, 1e999]", numbers="any") == [float("inf"), float("inf")]


def test_yaml_is_read_as_by_the_safe_loader_but_for_dates():
    text = b"a: &x [1, 0x1F, 1_000, .5, -1e+3, yes, ~, no date, 'it''s']\nb: *x\nc: {<<: {d: 1}, e: 2}\n"
    assert parse_yaml(text) == yaml.safe_load(text)
    assert parse_yaml(b"2024-02-31: 2020-01-01") == {"2024-02-31": "2020-01-01"}
    assert parse_yaml(b"a: 1e-5\nb: [no, 2]", as_text=True) == {"a": "1e-5", "b": ["no", "2"]}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"a: !!int ''", "tagged as what it is not in line 1, column 4"),
        (b"a: !!int 0x", "tagged as what it is not"),
        (b"a: !!bool maybe", "tagged as what it is not"),
        (b"a: !!float x", "tagged as what it is not"),
        (b"a: " + b"9" * 400, "a whole number of 400 digits"),
        (b"a: !!python/object/apply:os.system ['exit 1']", "constructor"),
        (b"a: !!timestamp 2020-99-99", "constructor"),
        (b"a: !!binary aGVsbG8=", "constructor"),
        (b"&a [*a]", r"\*a stands for nothing before it"),
        (b"[" * 100, "nested more than 40 deep"),
        (b"- " * 100_000, "nested more than 40 deep"),
        (b"{a: " * 100, "nested more than 40 deep"),
        (b"? [a]\n: b", "unhashable"),
        (b"a: [", "expected"),
        (b"a: 1\n--- 2", "but found another document|single document"),
    ],
)
@pytest.mark.parametrize("as_text", [False, True])
def test_damaged_yaml_is_said_with_its_place(text, words, as_text):
    if as_text and text.startswith((b"a: !", b"a: 9")):
        return
    with pytest.raises(ValueError, match=words):
        parse_yaml(text, as_text=as_text)


def test_aliases_count_for_what_they_stand_for():
    """A billion laughs end at once, and so does a chain of aliases deeper than nesting may be; a few are fine."""
    laughs = b"a0: &a0 [x]\n" + b"".join(
        b"a%d: &a%d [%s]\n" % (i, i, b", ".join([b"*a%d" % (i - 1)] * 9)) for i in range(1, 12)
    )
    begin = time.perf_counter()
    with pytest.raises(ValueError, match="counting what aliases stand for"):
        parse_yaml(laughs)
    chain = b"a0: &a0 []\n" + b"".join(b"a%d: &a%d [*a%d]\n" % (i, i, i - 1) for i in range(1, 100))
    with pytest.raises((ValueError, RecursionError)):
        parse_yaml(chain)
    assert time.perf_counter() - begin < 5
    assert parse_yaml(b"a: &a [1]\nb: [*a, *a]") == {"a": [1], "b": [[1], [1]]}


def test_a_document_of_many_values_is_refused(monkeypatch):
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
