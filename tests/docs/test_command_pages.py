"""Pages of the command line have an entry for every option of the printed help."""

import importlib
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from robosim.cli import main
from robosim.commands.command_table import COMMANDS

EXTENSIONS = Path(__file__).resolve().parents[2] / "docs" / "_ext"


@pytest.fixture(scope="module")
def pages() -> ModuleType:
    """The extension that writes them."""
    sys.path.insert(0, str(EXTENSIONS))
    try:
        return importlib.import_module("commands")
    finally:
        sys.path.remove(str(EXTENSIONS))


def printed(words: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> str:
    """Output of --help-all in one column."""
    monkeypatch.setenv("COLUMNS", "100")
    with pytest.raises(SystemExit):
        main([*words, "--help-all"])
    return re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_page_has_every_option(name, pages, capsys, monkeypatch):
    """Each option at the beginning of a line of the printed help is an explained term; there are no drawn boxes."""
    page = pages.page(name, 1)
    terms = dict(re.findall(r"^`(--[\w.-]+)[^`]*`\n: (.+)$", page, re.MULTILINE))
    both = set(re.findall(r"--[\w.-]+", " ".join(re.findall(r"^`(--[^`]*)`$", page, re.MULTILINE))))
    begun = set(
        re.findall(r"^\W+ (--[a-z][\w.-]*)", printed(name.split(), capsys, monkeypatch), re.MULTILINE)
    )
    assert begun - {"--json", "--quiet", "--debug", "--figures"} == set(terms) <= both
    assert all(terms.values())
    assert not re.search("[│╭╰─]", page)


def test_an_entry_says_type_choices_and_default(pages):
    """For a number, a choice, a switch, a required and an optional argument."""
    page = pages.page("trace", 1)
    assert "`PLAN`\n: Floor plan:" in page and "scene (.xml). Required." in page
    assert "`--frequency-ghz FLOAT`\n: Carrier frequency \\[GHz\\]. Default: `28.0`." in page
    assert "`--resolution FLOAT`" in page and "Range: 0.001 to 10 m." in page
    assert "`--up`\n: Axis" in page and "One of `auto`, `y`, `z`. Default: `auto`." in page
    assert "`--plots, --no-plots`\n: Whether to draw pictures. On by default." in page
    assert "`--storey INT`" in page and "`--tx X,Y[,Z]`" in page
    assert "Default: `None`" not in page and "{None}" not in page
    assert "`LOGS ...`" in pages.page("slam", 1)
