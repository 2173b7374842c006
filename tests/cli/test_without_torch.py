"""What works where PyTorch or another extra is not installed: all that does not need it."""

import subprocess
import sys

import pytest

from robosim.support.installation import EXTRAS, install_command

#: As where it is not installed: an import fails.
WITHOUT = """
import sys

class Without:
    def find_spec(self, name, path=None, target=None):
        if name == "MODULE":
            raise ModuleNotFoundError("No module named 'MODULE'", name="MODULE")

sys.meta_path.insert(0, Without())
"""


def run(code: str, module: str = "torch") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", WITHOUT.replace("MODULE", module) + code],
        capture_output=True,
        text=True,
        check=False,
    )


def test_an_episode_runs_with_all_defaults(tmp_path):
    """Neural mapper, classifier of link states, learned choice of frontiers: three decisions, and files of them."""
    output = run(
        "from robosim.cli import main\n"
        f"main(['episode', 'cottage', '--max-steps', '3', '--no-video', '--out', {str(tmp_path / 'out')!r}])"
    )
    assert output.returncode == 0, output.stderr
    assert (tmp_path / "out" / "result.json").is_file()


def test_what_trains_says_what_to_install(tmp_path):
    """One line on standard error, status 2."""
    for words in (
        ["train", "mapper", "--smoke"],
        ["train", "link-state", "--data", str(tmp_path)],
        ["train", "search"],
    ):
        output = run(f"from robosim.cli import main\nmain({[*words, '--out', str(tmp_path / 'out')]!r})")
        assert output.returncode == 2, output.stdout + output.stderr
        assert f"torch, which is not installed: {install_command('train')}" in output.stderr
        assert "Traceback" not in output.stderr and output.stderr.count("\n") == 1


def test_libraries_say_what_to_install():
    for name in ("robosim.LinkDataset", "slam.learning.mapper", "wireless.linkstate.Recipe"):
        package, _, attribute = name.rpartition(".")
        output = run(f"from {package} import {attribute}")
        assert output.returncode == 1
        assert (
            "pip install" in output.stderr.splitlines()[-1] and "[train]'" in output.stderr.splitlines()[-1]
        )


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("viser", "live flat"),
        ("minari", "collect-searches"),
        ("distributed", "collect --homes 1 --cluster tcp://127.0.0.1:1"),
    ],
)
def test_a_missing_extra_is_one_line_with_the_remedy(module, words, tmp_path):
    """Status 2, and what to type for this installation."""
    line = words.split()
    if line[0] != "live":
        line += ["--out", str(tmp_path / "out")]
    ended = run(f"from robosim.cli import main\nmain({line!r})", module)
    assert ended.returncode == 2, ended.stderr
    assert install_command(EXTRAS[module]) in ended.stderr
    assert ended.stderr.count("\n") == 1 and "internal error" not in ended.stderr


@pytest.mark.parametrize("package", ["robosim", "slam", "wireless"])
def test_all_public_names_can_be_imported_at_once(package):
    """`import *` brings what works without PyTorch; names that need it say so when they are imported."""
    ended = run(f"from {package} import *\nprint(len(dir()))")
    assert ended.returncode == 0, ended.stderr
    assert int(ended.stdout) > 20
