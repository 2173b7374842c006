"""The doctor reports what is missing and what is used, and how to mend it, without falling ill itself."""

import io
import subprocess
import sys

import pytest
from rich.console import Console

from robosim import doctor
from robosim.camera.rendering.gl_systems import INSTALL, OpenGLError
from robosim.doctor import Finding, _camera, _check, _system, _systems, remedy, report
from robosim.support.installation import EXTRAS, install_command


def _printed(findings, markup: bool = True) -> tuple[bool, str]:
    sink = io.StringIO()
    able = report(findings, Console(file=sink, width=200, markup=markup))
    return able, sink.getvalue()


GOOD = [Finding("python", True, "3.11"), Finding("camera", True, "draws on OSMesa")]
DRAWS = Finding("", True, "2000 frames/s", needed=False)
FAILS = Finding("", False, "no device", "install a driver", needed=False)


@pytest.mark.parametrize("error", [ImportError("libOSMesa.so.8 not found\nmore"), OSError(""), KeyError("x")])
def test_a_probe_that_fails_is_a_finding(error):
    def probe() -> str:
        raise error

    finding = _check("camera", "pyrender", probe)
    assert not finding.works
    assert "\n" not in finding.detail
    assert finding.detail
    assert "pyrender==" in finding.fix


def test_something_needed_is_missing():
    able, text = _printed([*GOOD, Finding("embree", False, "no module", "pip install embreex")])
    assert not able
    assert "pip install embreex" in text
    assert "Mend first: embree." in text


def test_something_optional_is_missing():
    able, text = _printed([*GOOD, Finding("pyrender on EGL", False, "no EGL", INSTALL["egl"], needed=False)])
    assert able
    assert INSTALL["egl"] in text


def test_every_extra_is_listed(monkeypatch):
    """Installed with its version, or absent with what to type; no extra is needed for the main job."""
    monkeypatch.setitem(sys.modules, "minari", None)
    findings = {module: doctor._extra(module) for module in EXTRAS}
    assert findings["torch"].works and findings["torch"].detail.startswith("torch ")
    assert findings["minari"].fix == install_command("minari")
    able, text = _printed([*GOOD, *findings.values()])
    assert able
    assert all(f"extra {extra} " in text for extra in ("train", "live", "minari", "cluster", "bags"))
    assert "absent  minari is not installed." in text


def test_no_renderer_at_all_names_the_fallback():
    able, text = _printed([GOOD[0], Finding("camera", False, "no OSMesa", INSTALL["osmesa"])])
    assert not able
    assert "--camera embree" in text


def test_brackets_in_an_error_are_shown():
    """Square brackets are rich's markup: unescaped, '[X11]' would vanish."""
    _, text = _printed([Finding("embree", False, "no [X11]", "pip install '.[cluster]'")])
    assert "no [X11]" in text
    assert ".[cluster]" in text


def test_what_it_says_does_not_depend_on_markup():
    """The command line's console prints brackets as they are: a state is "works", not "[green]works"."""
    finding = Finding("embree", False, "no [X11]", "pip install '.[cluster]'")
    _, text = _printed([*GOOD, finding], markup=False)
    assert "[green]" not in text
    assert "[red]" not in text
    assert "no [X11]" in text
    assert ".[cluster]" in text
    assert "\\" not in text


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        # Any probe meets this first, and no package helps.
        (ModuleNotFoundError("No module named 'nosuch'", name="nosuch.part"), ["pip install 'nosuch'"]),
        # Installed but broken: to install it changes nothing.
        (ImportError("cannot import name 'nn'", name="torch"), ["--force-reinstall", "'torch"]),
        (ImportError("file too short", name="_C"), ["--force-reinstall", "'mujoco>=4"]),
        (
            ImportError("libGL.so.1: cannot open shared object file: No such file", name="cv2"),
            ["the system's package that has libGL.so.1", "'opencv-contrib-python-headless"],
        ),
        (PermissionError(13, "Permission denied", "/opt/python"), ["permission to use /opt/python"]),
        (OpenGLError("EGL has no device.", "plug one in"), ["plug one in"]),
        (ValueError("strange"), ["not known", "'mujoco>=4"]),
    ],
)
def test_the_remedy_follows_from_the_error(error, expected):
    """Whatever the part is called in which it comes up: here it is always MuJoCo's."""
    output = remedy(error, "mujoco")
    assert all(piece in output for piece in expected), output


@pytest.mark.parametrize(
    ("setting", "default", "osmesa", "egl", "expected", "fix"),
    [
        ("", "osmesa", DRAWS, FAILS, "draws on OSMesa: the first choice", ""),
        ("", "egl", FAILS, DRAWS, "draws on EGL: OSMesa, the first choice, is not installed", ""),
        ("EGL", "egl", DRAWS, DRAWS, "draws on EGL: PYOPENGL_PLATFORM=EGL selects it", ""),
        ("x11", "osmesa", DRAWS, FAILS, "PYOPENGL_PLATFORM=x11 is neither osmesa nor egl", ""),
        ("egl", "egl", DRAWS, FAILS, "would draw on EGL", "unset PYOPENGL_PLATFORM: OSMesa works"),
        ("", "osmesa", FAILS, DRAWS, "would draw on OSMesa", "set PYOPENGL_PLATFORM=egl, which works"),
        ("", "osmesa", FAILS, FAILS, "would draw on OSMesa", "install a driver"),
    ],
)
def test_the_system_that_is_used_and_why(monkeypatch, setting, default, osmesa, egl, expected, fix):
    """What a camera takes, in the words of the finding; and the shortest fix where that one does not draw."""
    monkeypatch.setenv("PYOPENGL_PLATFORM", setting)
    monkeypatch.setattr(doctor, "default_system", lambda: default)
    finding = _camera({"osmesa": osmesa, "egl": egl})
    assert finding.needed
    assert finding.works == (fix == "")
    assert expected in finding.detail
    assert finding.fix == fix


@pytest.mark.parametrize(("egl", "expected"), [(DRAWS, "nothing: EGL draws"), (FAILS, INSTALL["osmesa"])])
def test_a_system_that_is_not_installed_is_not_needed_if_another_draws(monkeypatch, egl, expected):
    lack = OpenGLError("OSMesa is not installed.", INSTALL["osmesa"])
    monkeypatch.setattr(doctor, "missing", {"osmesa": lack, "egl": None}.get)
    monkeypatch.setattr(
        doctor, "_system", {"osmesa": Finding("", False, lack.trouble, lack.remedy), "egl": egl}.get
    )
    findings = _systems()
    assert findings["osmesa"].fix == expected
    assert findings["egl"] is egl


def test_no_system_to_use(monkeypatch):
    """PYOPENGL_PLATFORM selects EGL, which is not there, but OSMesa is: it is to be unset."""
    nothing = OpenGLError("PYOPENGL_PLATFORM=egl, but EGL is not installed.", INSTALL["egl"])

    def default() -> str:
        raise nothing

    monkeypatch.setattr(doctor, "default_system", default)
    finding = _camera({"osmesa": DRAWS, "egl": FAILS})
    assert finding.fix == "unset PYOPENGL_PLATFORM: OSMesa works"
    assert _camera({"osmesa": FAILS, "egl": FAILS}).fix == INSTALL["egl"]


def test_a_driver_that_crashes_is_a_finding(monkeypatch):
    """The camera is tried in a process of its own; here it ends by SIGSEGV without a word on standard output."""
    monkeypatch.setattr(doctor, "missing", lambda _: None)
    crash = subprocess.CompletedProcess([], -11, stdout="", stderr="Mesa: error: no memory\n")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: crash)
    finding = _system("egl")
    assert not finding.works
    assert "status -11. Mesa: error: no memory" in finding.detail
    assert INSTALL["egl"] in finding.fix
