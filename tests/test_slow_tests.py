"""The list of slow tests is up to date."""

import pytest
import slow_tests
from slow_tests import TESTS, add_slow, read_slow


def test_all_entries_exist() -> None:
    """A module or function that was renamed or removed is not in the list."""
    for entry in read_slow():
        module, _, function = entry.partition("::")
        assert (TESTS / module).exists(), entry
        assert not function or f"def {function}(" in (TESTS / module).read_text(), entry


def test_add_slow_reads_durations(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Functions with a setup or call of half a second are added, each once; teardowns and quick ones are not."""
    monkeypatch.setattr(slow_tests, "LIST", tmp_path / "slow.txt")
    slow_tests.LIST.write_text("faults\n")
    add_slow(
        "0.90s call     tests/a/test_b.py::test_c[1-2 3]\n0.70s setup    tests/a/test_b.py::test_c[4]\n"
        "0.60s teardown tests/a/test_b.py::test_d\n0.40s call     tests/a/test_b.py::test_e\n"
    )
    assert read_slow() == ["a/test_b.py::test_c", "faults"]
