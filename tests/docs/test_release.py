"""The release has the same version, title and date in the files that state them."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

REPOSITORY = Path(__file__).parents[2]
CITATION = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text())


def test_version_of_the_package_is_cited_and_in_the_changelog():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    heading = re.search(r"^## (.*)$", (REPOSITORY / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert project["version"] == CITATION["version"]
    assert heading is not None
    assert heading[1] == f"{CITATION['version']}, {CITATION['date-released']}"


@pytest.mark.parametrize("key", ["title", "version"])
def test_page_how_to_cite_agrees_with_the_citation(key: str):
    page = (REPOSITORY / "docs/cite.md").read_text()
    assert re.search(rf"^ +{key} += {{{re.escape(CITATION[key])}}},$", page, re.MULTILINE)


def test_paper_has_the_title_of_the_citation():
    header = (REPOSITORY / "paper.md").read_text().split("---")[1]
    assert yaml.safe_load(header)["title"] == CITATION["title"]
