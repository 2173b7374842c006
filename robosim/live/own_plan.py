"""A floor plan or mesh that somebody has put onto the page: one file, which needs none beside it."""

import logging
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path, PurePosixPath

from robosim.plans.files import IMAGES, read_plan
from robosim.plans.floorplan import FloorPlan, MapError

#: Files that say all by themselves; a .yaml names another file, which is not here.
MESHES, OTHERS = (".stl", ".obj", ".ply", ".glb", ".off"), (".npy", ".json")
ENDINGS = (*IMAGES, *MESHES, *OTHERS)
#: Those of them that do not say how large they are.
SCALED = (*IMAGES, ".npy")
#: The largest that is taken [bytes]; what the page's connection carries at once.
MOST_BYTES = 50_000_000


def plan_of(name: str, content: bytes, resolution_m: float) -> tuple[FloorPlan, str]:
    """The floor plan in a file's content, and what its reader warns of, such as the axis that it took to point up.

    Args:
        name: What the file was called; its folder is left aside.
        content: Its bytes.
        resolution_m: Metres per pixel, for images and arrays.

    Raises:
        MapError: If it cannot be read; the message names the file and the fix.
    """
    plain = PurePosixPath(name.replace("\\", "/")).name
    ending = PurePosixPath(plain).suffix.lower()
    if ending not in ENDINGS:
        raise MapError(
            f"{plain[:80]}: expected one file that says all by itself ({' '.join(ENDINGS)}). Give others on the "
            "command line: robosim live FILE."
        )
    if len(content) > MOST_BYTES:
        raise MapError(
            f"{plain[:80]}: {len(content)} bytes, expected at most {MOST_BYTES}. Give it on the command line: "
            "robosim live FILE."
        )
    # In a folder of its own, so that it can name no other file; under a name that we choose.
    with tempfile.TemporaryDirectory(prefix="robosim-live-") as folder:
        path = Path(folder) / f"plan{ending}"
        path.write_bytes(content)
        try:
            with _warnings() as warnings:
                plan = read_plan(path, resolution_m=resolution_m if ending in SCALED else None)
        except (ValueError, OSError) as error:
            raise MapError(str(error).replace(str(path), plain[:80])) from None
    return replace(plan, name=PurePosixPath(plain).stem[:80]), " ".join(warnings).replace(
        str(path), plain[:80]
    )


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """What readers of plans warn of in this thread meanwhile."""
    told, thread = list[str](), threading.get_ident()

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.thread == thread:
                told.append(record.getMessage())

    listener, readers = Listener(logging.WARNING), logging.getLogger("robosim.plans")
    readers.addHandler(listener)
    try:
        yield told
    finally:
        readers.removeHandler(listener)
