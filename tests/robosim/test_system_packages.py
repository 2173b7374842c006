"""What `make` installs of the system's packages: on many machines, none of them real."""

import importlib.util
import io
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "system_packages.py"
VENV = f"python{sys.version_info[0]}.{sys.version_info[1]}-venv"
EGL = {"libegl1", "libopengl0", "libgl1-mesa-dri"}


@dataclass
class Machine:
    """A machine with apt, by what it has and what its distribution offers."""

    installed: set[str]
    offered: set[str]
    root: bool = True
    sudo: bool = False
    """Whether sudo works without a password."""
    lists: bool = True
    """Whether the lists of packages have been fetched."""
    commands: list[list[str]] = field(default_factory=list)

    def run(self, command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        """Stand for `subprocess.run`."""
        command = list(command)
        self.commands.append(command)
        status, words = 0, ""
        if command[:2] == ["sudo", "-n"]:
            if not self.sudo:
                return subprocess.CompletedProcess(command, 1, "", "a password is required")
            command = command[2:]
        if "policy" in command:
            known = command[-1] in self.installed or (self.lists and command[-1] in self.offered)
            words = f"{command[-1]}:\n  Candidate: {'1.0' if known else '(none)'}\n"
        elif "update" in command:
            self.lists = True
        elif "install" in command:
            assert self.root or self.sudo
            assert "DEBIAN_FRONTEND=noninteractive" in command
            packages = set(command[command.index("--no-install-recommends") + 1 :])
            status = 0 if self.lists and packages <= self.offered else 100
            self.installed |= packages if status == 0 else set()
        return subprocess.CompletedProcess(command, status, words, "")

    def missing(self, system: str) -> str:
        """Stand for `gl_systems.missing`."""
        needs = {"libosmesa6"} if system == "osmesa" else EGL
        return "" if needs <= self.installed else f"{system} is not installed."


@pytest.fixture
def make_needs(monkeypatch) -> Callable[..., int]:
    """Run the script on a machine, and return its exit status."""
    monkeypatch.setattr(sys, "path", list(sys.path))  # the script adds to it

    def run(machine: Machine, *arguments: str, apt: bool = True) -> int:
        spec = importlib.util.spec_from_file_location("system_packages", SCRIPT)
        script = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(script)
        programs = ("apt-get", "sudo") if apt else ()
        monkeypatch.setattr(script.shutil, "which", lambda name: name if name in programs else None)
        monkeypatch.setattr(script.subprocess, "run", machine.run)
        monkeypatch.setattr(script.os, "geteuid", lambda: 0 if machine.root else 1000)
        monkeypatch.setattr(script.sys, "stdin", io.StringIO())
        monkeypatch.setattr(script, "missing", machine.missing)
        monkeypatch.setattr(script, "has_venv", lambda: VENV in machine.installed)
        monkeypatch.setattr(script, "_lists_are_there", lambda: machine.lists)
        return script.main(arguments)

    return run


@pytest.mark.parametrize("before", [set(), EGL], ids=["bare", "with EGL"])
@pytest.mark.parametrize("lists", [False, True], ids=["no lists", "lists"])
def test_osmesa_is_installed_wherever_it_is_offered(make_needs, before, lists):
    """Also where EGL is there already; a slim container has no lists of packages, and they are fetched."""
    machine = Machine(installed=set(before), offered={"libosmesa6", *EGL}, lists=lists)
    assert make_needs(machine) == 0
    assert machine.installed == {"libosmesa6", *before}


def test_egl_is_installed_where_osmesa_is_not_offered(make_needs, capsys):
    """As on distributions with Mesa 25.1 or later, which has no OSMesa; that is said, and is no error."""
    machine = Machine(installed=set(), offered=set(EGL), lists=False)
    assert make_needs(machine) == 0
    assert machine.installed == EGL
    assert "This distribution does not offer libosmesa6" in capsys.readouterr().err


def test_for_the_tests_both_are_installed(make_needs, capsys):
    """And a browser; where the distribution has none, as Ubuntu, that is said, and is no error."""
    machine = Machine(installed={"libosmesa6"}, offered={"libosmesa6", "chromium", *EGL})
    assert make_needs(machine, "--all") == 0
    assert machine.installed == {"libosmesa6", "chromium", *EGL}
    assert "browser" not in capsys.readouterr().err
    machine = Machine(installed={"libosmesa6"}, offered={"libosmesa6", *EGL})
    assert make_needs(machine, "--all") == 0
    assert machine.installed == {"libosmesa6", *EGL}
    output = capsys.readouterr().err
    assert "This distribution does not offer chromium. Tests in a browser are skipped." in output


def test_nothing_is_asked_of_a_machine_that_has_it(make_needs):
    """No command at all, so that `make demo` works offline and without rights."""
    machine = Machine(installed={"libosmesa6", VENV}, offered=set(), root=False)
    assert make_needs(machine, "--venv") == 0
    assert machine.commands == []


def test_a_user_installs_with_sudo(make_needs):
    """Only where it is needed, and with the settings that keep apt from asking."""
    machine = Machine(installed=set(), offered={"libosmesa6", VENV}, root=False, sudo=True)
    assert make_needs(machine, "--venv") == 0
    assert machine.installed == {"libosmesa6", VENV}
    assert all(command[:3] == ["sudo", "-n", "env"] for command in machine.commands if "install" in command)


def test_without_rights_it_goes_on_with_what_is_there(make_needs, capsys):
    """EGL is there, OSMesa would be better, and no one is there to type a password."""
    machine = Machine(installed=set(EGL), offered={"libosmesa6"}, root=False)
    assert make_needs(machine) == 0
    assert "OSMesa is missing (libosmesa6). It takes root or sudo" in capsys.readouterr().err


@pytest.mark.parametrize("apt", [False, True], ids=["no apt", "no rights"])
def test_without_rights_and_renderer_it_says_what_to_ask_for(make_needs, capsys, apt):
    """Both options to have a renderer, and the one to do without."""
    assert make_needs(Machine(installed=set(), offered={"libosmesa6"}, root=False), apt=apt) == 1
    output = capsys.readouterr().err
    assert "apt-get install libosmesa6\n" in output
    assert "apt-get install libegl1 libopengl0 libgl1-mesa-dri\n" in output
    assert "--camera embree" in output


def test_without_venv_and_rights_its_package_is_named(make_needs, capsys):
    """`python3 -m venv` of Debian ends in a half-made folder without it."""
    assert make_needs(Machine(installed={"libosmesa6"}, offered={VENV}, root=False), "--venv") == 1
    assert f"apt-get install {VENV}" in capsys.readouterr().err


def test_a_failing_apt_is_quoted(make_needs, capsys):
    """Here a mirror lacks what the lists say; another renderer is there, so that work goes on."""
    machine = Machine(installed=set(EGL), offered={"libosmesa6"})
    fetch = machine.run

    def run(command: list[str], **options: object) -> subprocess.CompletedProcess[str]:
        if "install" in command:
            return subprocess.CompletedProcess(command, 100, "", "E: Failed to fetch\n  404 Not Found\n")
        return fetch(command, **options)

    machine.run = run
    assert make_needs(machine) == 0
    assert "apt-get says: E: Failed to fetch 404 Not Found" in capsys.readouterr().err
