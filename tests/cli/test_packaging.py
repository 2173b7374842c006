"""What is built of the project: a wheel that runs from anywhere, and an archive that makes the same wheel."""

import json
import os
import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]


def built(target: str, source: Path, folder: Path) -> Path:
    """What hatchling builds of a source tree: "wheel" or "sdist"."""
    command = [sys.executable, "-m", "hatchling", "build", "--target", target, "--directory", str(folder)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (file,) = folder.iterdir()
    return file


def contents(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    return built("wheel", ROOT, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def site(wheel, tmp_path_factory) -> Path:
    """A folder with the wheel unpacked, as installers do it."""
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


@pytest.fixture
def runs(site, tmp_path):
    """Runs Python in a folder of its own with the unpacked wheel before anything else that is installed."""

    def run(*arguments: str) -> str:
        env = {**os.environ, "PYTHONPATH": str(site)}
        done = subprocess.run(
            [sys.executable, *arguments], cwd=tmp_path, env=env, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


def test_the_wheel_has_what_is_needed_to_run_and_no_more(wheel):
    """All modules, marks of types, plans and weights; no tests, scripts or pictures of the README."""
    names = set(contents(wheel))
    packages = {"robosim", "slam", "wireless"}
    modules = {
        path.relative_to(ROOT).as_posix()
        for package in packages
        for path in (ROOT / package).rglob("*.py*")
        if path.suffix in (".py", ".pyi")
    }
    assets = {
        f"robosim/{path.relative_to(ROOT).as_posix()}"
        for kind in ("plans", "weights")
        for path in (ROOT / "assets" / kind).iterdir()
    }
    about = {name for name in names if ".dist-info/" in name}
    assert len(assets) > 20
    assert names - about == modules | assets | {f"{package}/py.typed" for package in packages}
    assert {Path(name).name for name in about} == {
        "METADATA",
        "WHEEL",
        "entry_points.txt",
        "LICENSE",
        "LICENSES.md",
        "RECORD",
    }


def test_the_archive_of_the_sources_makes_the_same_wheel(wheel, tmp_path):
    """Unpacked in another folder, outside of any repository: byte-identical files. Tests and Makefile are included."""
    sdist = built("sdist", ROOT, tmp_path / "dist")
    with tarfile.open(sdist) as archive:
        # Without the filter newer Pythons warn; Debian 12's knows none.
        archive.extractall(tmp_path, **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))
    source = tmp_path / sdist.name.removesuffix(".tar.gz")
    for name in ("Makefile", "README.md", "LICENSE", "tests/conftest.py", "scripts/system_packages.py"):
        assert (source / name).read_bytes() == (ROOT / name).read_bytes()
    assert contents(built("wheel", source, tmp_path / "again")) == contents(wheel)


def test_an_unpacked_wheel_runs_from_another_folder(runs, site, wheel):
    """Its own code, version, plans and weights are found, not those of this source tree."""
    version = wheel.name.split("-")[1]
    assert runs("-m", "robosim", "--version") == f"robosim {version}\n"
    output = json.loads(runs("-m", "robosim", "plan", "cottage", "--json", "--out", "shown"))
    assert output["plan"] == "cottage" and output["parts"] >= 1
    code = (
        "import robosim, slam, wireless; from robosim.support.installation import assets_dir, shipped_network; "
        "print(robosim.__file__, slam.__file__, wireless.__file__, assets_dir()); "
        "slam.load_mapper(shipped_network('mapper'))"
    )
    assert all(Path(place).is_relative_to(site) for place in runs("-c", code).split())


def test_the_command_is_installed(wheel):
    """`robosim` is the entry point that `python -m robosim` has."""
    (points,) = (text for name, text in contents(wheel).items() if name.endswith("entry_points.txt"))
    assert "robosim = robosim.__main__:main" in points.decode()


@pytest.mark.parametrize(
    "file", sorted((ROOT / ".github" / "workflows").glob("*.yml")), ids=lambda file: file.name
)
def test_workflows_pin_actions_and_read_only(file):
    """Actions are pinned by digest; only the job that publishes may do more than read, and no password is named."""
    workflow = yaml.safe_load(file.read_text("utf-8"))
    assert workflow["permissions"] == {"contents": "read"}
    more = {name: job["permissions"] for name, job in workflow["jobs"].items() if "permissions" in job}
    assert more in ({}, {"publish": {"id-token": "write"}})
    uses = [
        step["uses"] for job in workflow["jobs"].values() for step in job.get("steps", ()) if "uses" in step
    ]
    assert uses and all(re.fullmatch(r"[\w/-]+@[0-9a-f]{40}", name) for name in uses)
    assert "secrets." not in file.read_text("utf-8")
