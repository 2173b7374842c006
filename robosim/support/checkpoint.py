"""The state of a training in a file, so that it can be stopped and go on."""

import io
import os
from pathlib import Path
from typing import Any

from robosim.support.files import write_whole
from robosim.support.reading import reading


class Checkpoint:
    """One file, written whole at every save."""

    def __init__(self, path: Path) -> None:
        """Say where."""
        self.path = Path(path)

    def load(self) -> dict[str, Any] | None:
        """What was saved last, or None.

        Raises:
            FileError: If the file is damaged.
        """
        import torch

        if not os.path.lexists(self.path):
            return None
        with reading(self.path, "the checkpoint of a training", "Delete it to begin anew.") as file:
            kept: Any = torch.load(file, weights_only=True)
            if not isinstance(kept, dict):
                raise ValueError("it holds no state")
            return kept

    def save(self, state: dict[str, Any]) -> None:
        """Keep a state: tensors, numbers, texts, and lists and dictionaries of these."""
        import torch

        buffer = io.BytesIO()
        torch.save(state, buffer)
        write_whole(self.path, buffer.getvalue())
