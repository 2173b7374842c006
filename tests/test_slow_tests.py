"""The list of slow tests is up to date."""

from slow_tests import SLOW, TESTS


def test_all_entries_exist() -> None:
    """A module that was renamed or removed is not in the list."""
    assert not [name for name in SLOW if not (TESTS / name).exists()]
