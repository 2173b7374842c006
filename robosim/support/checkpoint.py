"""The state of a training in a file, so that it can be stopped and go on."""

import io
from pathlib import Path
from typing import Any

from robosim.support.files import write_whole


class Checkpoint:
    """One file, written whole at every save."""

    def __init__(self, path: Path) -> None:
        """Say where."""
        self.path = Path(path)

    def load(self) -> dict[str, Any] | None:
        """What was saved last, or None.

        Raises:
            ValueError: If the file is damaged.
        """
        import torch

        if not self.path.exists():
            return None
        try:
            kept = torch.load(self.path, weights_only=True)
        except Exception as error:  # torch.load raises whatever the damaged bytes lead it to
            raise ValueError(f"{self.path}: damaged checkpoint. Delete it to start again.") from error
        if not isinstance(kept, dict):
            raise ValueError(f"{self.path}: no checkpoint of a training. Delete it to start again.")
        return kept

    def save(self, state: dict[str, Any]) -> None:
        """Keep a state: tensors, numbers, texts, and lists and dictionaries of these."""
        import torch

        buffer = io.BytesIO()
        torch.save(state, buffer)
        write_whole(self.path, buffer.getvalue())
