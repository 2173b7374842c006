"""Pages that are made at each build."""

from collections.abc import Mapping
from pathlib import Path


def write_pages(folder: Path, wanted: Mapping[str, str], suffix: str) -> None:
    """Write pages by their names, those that are new or have changed; others of the same ending go."""
    for old in folder.glob(f"*{suffix}"):
        if old.name not in wanted:
            old.unlink()
    for name, text in wanted.items():
        path = folder / name
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")
