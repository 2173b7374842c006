"""The checks before a commit are those that `make test` begins with."""

from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]


def test_a_commit_is_checked_as_by_make_test():
    """Command by command, in order; all but the tests themselves, which take minutes."""
    (_, recipe) = (ROOT / "Makefile").read_text().split("\ntest: ")
    lines = [line.strip() for line in recipe.split("\n\n")[0].splitlines()[1:]]
    gates = [line.replace("$(BIN)", ".venv/bin") for line in lines if "pytest" not in line]
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    assert len(gates) == 4
    assert [hook["entry"] for hook in hooks] == gates
    assert all(hook["language"] == "system" and not hook["pass_filenames"] for hook in hooks)
