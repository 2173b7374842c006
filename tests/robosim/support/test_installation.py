"""What to type to install more, what is said next to the other project called robosim, and where shipped plans are."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from robosim.plans import files as planfiles
from robosim.plans.files import read_plan, write_ros
from robosim.plans.floorplan import FloorPlan, MapError
from robosim.support import installation
from robosim.support.installation import install_command, install_first, is_installed, namesake

STRANGER = "Metadata-Version: 2.1\nName: robosim\nVersion: 1.0\nSummary: A pygame robotics simulator.\n"


def stranger(folder: Path, record: str = "", points: str = "") -> Path:
    """A folder with the metadata of another distribution called robosim."""
    about = folder / "robosim-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(STRANGER, "utf-8")
    (about / "RECORD").write_text(record, "utf-8")
    (about / "entry_points.txt").write_text(points, "utf-8")
    return folder


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Installs the metadata of this program in a folder, from where a `direct_url.json` says."""

    def install(origin: dict | None) -> None:
        about = tmp_path / "site" / "robosim_wireless-9.9.dist-info"
        about.mkdir(parents=True)
        (about / "METADATA").write_text(
            "Metadata-Version: 2.1\nName: robosim-wireless\nVersion: 9.9\n", "utf-8"
        )
        if origin is not None:
            (about / "direct_url.json").write_text(json.dumps(origin), "utf-8")
        monkeypatch.syspath_prepend(tmp_path / "site")
        monkeypatch.setattr(installation, "_ROOT", tmp_path / "site")

    return install


def test_a_checkout_is_installed_again_with_the_extra(monkeypatch, tmp_path):
    """By a dot in its folder, by its path in other folders."""
    root = Path(__file__).resolve().parents[3]
    monkeypatch.chdir(root)
    assert install_command("live") == "pip install -e '.[live]'"
    monkeypatch.chdir(tmp_path)
    assert install_command("live") == f"pip install -e '{root}[live]'"


@pytest.mark.parametrize(
    "origin", [None, {"url": "file:///missing/robosim_wireless-9.9-py3-none-any.whl", "archive_info": {}}]
)
def test_a_wheel_gets_the_extra_by_name(installed, origin):
    """It is installed already, so that pip fetches the extra's packages alone."""
    installed(origin)
    assert installation.package_version() == "9.9"
    assert install_command("bags") == "pip install 'robosim-wireless[bags]'"


def test_a_folder_is_named(installed, tmp_path):
    """`pip install FOLDER`, which does not run there."""
    source = tmp_path / "a checkout"
    source.mkdir()
    installed({"url": source.as_uri(), "dir_info": {}})
    assert install_command("bags") == f"pip install '{source}[bags]'"


def test_what_is_missing_is_installed_first(monkeypatch):
    """A module of an extra by the extra, another one by its name; nothing for one that is there."""
    assert install_first("numpy") == "" and is_installed("numpy")
    assert install_first("no_such_module") == "pip install no_such_module; "
    monkeypatch.setitem(sys.modules, "minari", None)
    assert not is_installed("minari")
    assert install_first("minari") == f"{install_command('minari')}; "


@pytest.mark.parametrize(
    ("record", "points", "expected"),
    [
        ("robosim-1.0.dist-info/METADATA,,\n", "", "Remove it: pip uninstall robosim"),
        (
            "robosim/__init__.py,,\n",
            "",
            "pip uninstall -y robosim && pip install --force-reinstall --no-deps '",
        ),
        # This program before it was renamed.
        ("robosim/__init__.py,,\n", "[console_scripts]\nrobosim = robosim.__main__:main\n", None),
    ],
)
def test_the_other_project_is_named_with_the_remedy(record, points, expected, tmp_path, monkeypatch):
    """One line; where its files replace ours, it says how to get them back."""
    # Python 3.12 lists only files that are there.
    (tmp_path / "robosim").mkdir()
    (tmp_path / "robosim" / "__init__.py").touch()
    monkeypatch.syspath_prepend(stranger(tmp_path, record, points))
    line = namesake()
    if expected is None:
        assert line is None
    else:
        assert line.startswith("robosim 1.0 is installed, another project") and expected in line
        assert "\n" not in line


def test_the_command_warns_of_the_other_project_once(tmp_path):
    """On standard error; the command works."""
    path = f"import sys; sys.path.insert(0, {str(stranger(tmp_path))!r})"
    code = f"{path}; from robosim.cli import main; main(['plan', 'flat', '--out', 'nowhere', '--help'])"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stderr.count("WARNING") == 1 and "pip uninstall robosim" in ended.stderr


def test_the_command_says_that_its_files_were_replaced(tmp_path):
    """The other project has written its own `robosim/__init__.py` over this one's: one line, status 1."""
    site = stranger(tmp_path, "robosim/__init__.py,,\n")
    root = Path(installation.__file__).parents[2]
    (site / "robosim").mkdir()
    (site / "robosim" / "__init__.py").touch()
    for name in ("__main__.py", "support"):
        (site / "robosim" / name).symlink_to(root / "robosim" / name)
    code = f"import sys; sys.path.insert(0, {str(site)!r}); from robosim.__main__ import main; main()"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert ended.stderr.startswith("robosim: robosim 1.0 is installed") and ended.stderr.count("\n") == 1


@pytest.fixture
def shipped(tmp_path, monkeypatch):
    """A package folder with two shipped plans and nothing else."""
    monkeypatch.setattr(installation, "__file__", str(tmp_path / "robosim" / "support" / "installation.py"))
    for name in ("flat", "office"):
        plan = FloorPlan(occupancy=np.zeros((2, 3), np.uint8), resolution_m=0.05, name=name)
        write_ros(plan, tmp_path / "assets" / "plans" / f"{name}.yaml")
    return tmp_path


def test_plans_lie_next_to_the_package_in_a_source_tree(shipped):
    assert installation.assets_dir() == shipped / "assets"
    assert list(installation.shipped_plans()) == ["flat", "office"]


def test_plans_lie_inside_an_installed_package(shipped):
    inside = shipped / "robosim" / "assets"
    inside.parent.mkdir()
    (shipped / "assets").rename(inside)
    assert installation.assets_dir() == inside
    assert list(installation.shipped_plans()) == ["flat", "office"]


def test_a_bare_name_reads_a_shipped_plan(shipped, monkeypatch):
    monkeypatch.chdir(shipped)
    assert read_plan("office").name == "office"
    with pytest.raises(MapError, match=r"ofice: no such file.*'office'"):
        read_plan("ofice")
    with pytest.raises(MapError, match="Shipped plans: flat, office"):
        read_plan("castle")


def test_a_file_goes_before_a_shipped_plan(shipped, monkeypatch):
    """A folder of that name in the working folder is said, not passed over."""
    monkeypatch.chdir(shipped)
    (shipped / "office").mkdir()
    with pytest.raises(MapError, match="office: is a folder"):
        read_plan("office")


def test_shipped_plans_can_be_read():
    """Those of this very tree."""
    for name, path in installation.shipped_plans().items():
        assert read_plan(name).name == name
        assert planfiles.find_plans([name]) == [path]
