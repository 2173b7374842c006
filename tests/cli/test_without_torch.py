"""What works where PyTorch is not installed: all that does not train."""

import subprocess
import sys

#: As where it is not installed: an import fails.
WITHOUT = """
import sys

class Without:
    def find_spec(self, name, path=None, target=None):
        if name == "torch":
            raise ModuleNotFoundError("No module named 'torch'", name="torch")

sys.meta_path.insert(0, Without())
"""


def run(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", WITHOUT + code], capture_output=True, text=True, check=False
    )


def test_an_episode_runs_with_all_defaults(tmp_path):
    """Neural mapper, classifier of link states, learned choice of frontiers: three decisions, and files of them."""
    told = run(
        "from robosim.cli import main\n"
        f"main(['episode', 'cottage', '--max-steps', '3', '--no-video', '--out', {str(tmp_path / 'out')!r}])"
    )
    assert told.returncode == 0, told.stderr
    assert (tmp_path / "out" / "result.json").is_file()


def test_what_trains_says_what_to_install(tmp_path):
    """One line on standard error, status 2."""
    for words in (
        ["train", "mapper", "--smoke"],
        ["train", "link-state", "--data", str(tmp_path)],
        ["train", "steering"],
        ["train", "search"],
    ):
        told = run(f"from robosim.cli import main\nmain({[*words, '--out', str(tmp_path / 'out')]!r})")
        assert told.returncode == 2, told.stdout + told.stderr
        assert "torch, which is not installed: pip install 'robosim[train]'" in told.stderr
        assert "Traceback" not in told.stderr and told.stderr.count("\n") == 1


def test_libraries_say_what_to_install():
    for name in ("robosim.LinkDataset", "slam.learning.mapper", "wireless.linkstate.Recipe"):
        package, _, attribute = name.rpartition(".")
        told = run(f"from {package} import {attribute}")
        assert told.returncode == 1
        assert "pip install 'robosim[train]'" in told.stderr.splitlines()[-1]
