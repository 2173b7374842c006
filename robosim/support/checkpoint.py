"""The state of a training in a file, so that an interrupted training resumes."""

import io
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from robosim.support.files import write_whole
from robosim.support.reading import reading


class Checkpoint:
    """One file, written whole at every save."""

    def __init__(self, path: Path) -> None:
        """Say where."""
        self.path = Path(path)

    def restore(self, put: Callable[[dict[str, Any]], None]) -> None:
        """Give the last saved state, if there is one, to `put`; errors of `put` count as damage of the file.

        Raises:
            FileError: If the file is damaged, or its state is rejected.
        """
        if os.path.lexists(self.path):
            with reading(self.path, "the checkpoint of a training", "Delete it to start again.") as file:
                put(_whole(file))

    def save(self, state: dict[str, Any]) -> None:
        """Store a state: tensors, numbers, texts, and lists and dictionaries of these."""
        import torch

        buffer = io.BytesIO()
        torch.save(state, buffer)
        write_whole(self.path, buffer.getvalue())


def _whole(file: BinaryIO) -> dict[str, Any]:
    """Content of a file of `torch.save`, with checked sums; no code in it is run."""
    import torch

    with zipfile.ZipFile(file) as archive:
        if any(member.compress_type != zipfile.ZIP_STORED for member in archive.infolist()):
            raise ValueError("it is not packed by PyTorch")
        # PyTorch itself does not compare the check sums.
        if (damaged := archive.testzip()) is not None:
            raise ValueError(f"the check sum of {damaged} is wrong")
    file.seek(0)
    state = torch.load(file, weights_only=True)
    if not isinstance(state, dict):
        raise ValueError(f"a {type(state).__name__}, expected names and values")
    return state
