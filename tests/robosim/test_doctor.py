"""The doctor tells what is missing, and how to mend it, without falling ill itself."""

import io

import pytest
from rich.console import Console

from robosim.doctor import Finding, _check, report


def _printed(findings) -> tuple[bool, str]:
    sink = io.StringIO()
    able = report(findings, Console(file=sink, width=200))
    return able, sink.getvalue()


GOOD = [Finding("python", True, "3.11"), Finding("pyrender on OSMesa", True, "2000 frames/s", needed=False)]


@pytest.mark.parametrize("error", [ImportError("libOSMesa.so.8 not found\nmore"), OSError(""), KeyError("x")])
def test_a_probe_that_fails_is_a_finding(error):
    def probe() -> str:
        raise error

    finding = _check("camera", probe, "apt-get install libosmesa6")
    assert not finding.works
    assert "\n" not in finding.detail
    assert finding.detail


def test_something_needed_is_missing():
    able, text = _printed([*GOOD, Finding("embree", False, "no module", "pip install embreex")])
    assert not able
    assert "pip install embreex" in text


def test_something_optional_is_missing():
    able, text = _printed([*GOOD, Finding("torch", False, "no module", "pip install torch", needed=False)])
    assert able
    assert "pip install torch" in text


def test_no_renderer_at_all_names_the_way_round():
    able, text = _printed([GOOD[0], Finding("pyrender on EGL", False, "no EGL", needed=False)])
    assert not able
    assert "--camera embree" in text
