"""Results as JSON, as tables and in pages; the README's numbers are those of the files."""

import json
import re

import pytest

from tests.benchmarks.harness import command_of
from tests.benchmarks.readme import ROOT, with_numbers
from tests.benchmarks.results import DATA, Results, markdown, read_results, resolved, text


def some() -> Results:
    results = Results()
    results.add("speed", "flat", "links a second", 11_912.3, digits=0, cases=400)
    results.add("speed", "flat", "steps", 0.972, digits=2, spread=(0.84, 1.07))
    results.add("speed", "office", "links a second", None, spread=(6800, 7100))
    results.add("speed", "office", "share", float("nan"), "%")
    return results


def test_a_table_has_a_line_for_each_row_and_a_dash_where_there_is_no_number():
    assert some().table("speed") == [
        ["", "links a second", "steps", "share [%]"],
        ["flat", "11,912", "0.97 (0.84 to 1.07)", ""],
        ["office", "6,800 to 7,100", "", "-"],
    ]
    assert list(markdown([["", "a"], ["x", "1"]])) == ["|  | a |", "|---|---:|", "| x | 1 |"]


def test_what_is_written_is_read_again(tmp_path, monkeypatch):
    monkeypatch.setattr("tests.benchmarks.results.DATA", tmp_path)
    some().write(tmp_path / "speed.json", "python -m tests.benchmarks tracing flat")
    again = read_results("speed")
    assert again.rows == some().rows
    assert again.about["command"].endswith("tracing flat")
    assert resolved("{speed/speed/flat/steps} and more") == "0.97 (0.84 to 1.07) and more"
    with pytest.raises(KeyError, match="no result speed / villa / steps"):
        resolved("{speed/speed/villa/steps}")


def test_a_command_names_no_folders_of_a_machine(tmp_path):
    """Paths become names; options of the output are left out."""
    words = ["plans", str(tmp_path), "--count", "5", "--out", str(tmp_path), "--publish"]
    assert command_of(words) == f"python -m tests.benchmarks plans {tmp_path.name} --count 5"


@pytest.mark.parametrize("path", sorted(DATA.glob("*.json")), ids=lambda path: path.stem)
def test_published_files_say_how_they_were_measured(path):
    """Command, commit, date and processor; each result has a place of its own and a number or a range."""
    about = json.loads(path.read_text())
    assert {"command", "commit", "date", "processor"} <= set(about)
    places = [(row["table"], row["row"], row["name"]) for row in about["results"]]
    assert len(set(places)) == len(places) > 0
    assert all(text(row) for row in about["results"])


def test_the_readme_is_up_to_date():
    """`python -m tests.benchmarks readme` changes nothing."""
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    assert with_numbers(page) == page


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*/*.md")), ids=lambda page: page.stem)
def test_pages_name_tables_and_numbers_that_exist(page):
    """Files, tables, rows, columns and numbers of the directive `measured` and the role `number`."""
    written = page.read_text(encoding="utf-8")
    for name, table, options in re.findall(r"```\{measured\} (\S+) (.*)\n((?::.*\n)*)```", written):
        cells = read_results(name).table(table)
        for kind, words in re.findall(r":(rows|columns): (.*)", options):
            known = (
                [line[0] for line in cells] if kind == "rows" else [word.split(" [")[0] for word in cells[0]]
            )
            assert {word.strip() for word in words.split(";")} <= set(known)
    for number in re.findall(r"\{number\}`([^`]+)`", written):
        assert "{" not in resolved(f"{{{number}}}")
