"""A floor plan or mesh that a user uploads to the page: one file that refers to no other."""

import logging
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path, PurePosixPath

from robosim.plans.files import IMAGES, read_plan
from robosim.plans.floorplan import FloorPlan, MapError

#: Files that refer to no others; a .yaml names an image, which is not uploaded.
MESHES, OTHERS = (".stl", ".obj", ".ply", ".glb", ".off"), (".npy", ".json")
ENDINGS = (*IMAGES, *MESHES, *OTHERS)
#: Those of them without a scale.
SCALED = (*IMAGES, ".npy")
#: Largest file [bytes]: the page's connection carries so much at once.
MOST_BYTES = 50_000_000


def plan_of(name: str, content: bytes, resolution_m: float) -> tuple[FloorPlan, str]:
    """The floor plan in a file, with metres per pixel for images and arrays, and warnings of its reader.

    Raises:
        MapError: If it has no printable name or cannot be read; the message names the file and the remedy.
    """
    file = PurePosixPath(name.replace("\\", "/"))
    plain, ending = file.name[:80], file.suffix.lower()
    if not file.stem.strip(" .") or not file.name.isprintable():
        raise MapError(f"the file's name is {plain!r}, expected printable text. Rename the file.")
    if ending not in ENDINGS:
        raise MapError(
            f"{plain}: expected one file that refers to no other ({' '.join(ENDINGS)}). Give others on the "
            "command line: robosim live FILE."
        )
    if len(content) > MOST_BYTES:
        raise MapError(
            f"{plain}: {len(content)} bytes, expected at most {MOST_BYTES}. Give it on the command line: "
            "robosim live FILE."
        )
    # In a folder of its own, under our own name, so that it can name no other file.
    with tempfile.TemporaryDirectory(prefix="robosim-live-") as folder:
        path = Path(folder) / f"plan{ending}"
        path.write_bytes(content)
        try:
            with _warnings() as warnings:
                plan = read_plan(path, resolution_m=resolution_m if ending in SCALED else None)
        except (ValueError, OSError) as error:
            raise MapError(str(error).replace(str(path), plain)) from None
    return replace(plan, name=file.stem[:80]), " ".join(warnings).replace(str(path), plain)


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """Warnings of plan readers in this thread within the block."""
    messages, thread = list[str](), threading.get_ident()

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.thread == thread:
                messages.append(record.getMessage())

    listener, readers = Listener(logging.WARNING), logging.getLogger("robosim.plans")
    readers.addHandler(listener)
    try:
        yield messages
    finally:
        readers.removeHandler(listener)
