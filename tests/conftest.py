"""Where the tests find floor plans and data that are not part of this project."""

from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of real floor plans and public measurements, which this project may not ship."""
    if not SHARED.is_dir():
        pytest.skip("needs the real floor plans in ../shared, which are not part of this project")
    return SHARED
