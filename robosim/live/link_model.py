"""A radio link in a building: its paths, and what a receiver measures.

Paths take milliseconds, a measurement ten times as long. The receiver, which takes seconds to create, is created by the
first measurement. Only a building of one storey has a receiver and a grid of places.

A plan that a user uploads to the page is one file that refers to no other.
"""

import logging
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from pathlib import Path, PurePosixPath
from threading import Lock
from typing import Any

import numpy as np
import shapely
from jaxtyping import Float

from robosim.plans.files import IMAGES, read_plan
from robosim.plans.floorplan import FloorPlan, MapError
from robosim.plans.storey_plans import StoreysPlan, storeys_of
from robosim.radio.link import RadioLink, RadioLinkConfig
from robosim.radio.measurement import Interpreter, Measurement
from robosim.radio.receivers import ReceiverGrid
from robosim.radio.scene import RadioConfig, RadioScene
from wireless.paths import LinkState, Paths

#: Distance between candidates for the robot's first place [m].
FIRST_STEP_M = 1.0
#: Wall materials that the page offers.
WALL_MATERIALS = ("partition", "concrete_wall", "glazing", "door", "metal")


class LinkModel(RadioScene):
    """A building with one or several storeys, and a receiver in it."""

    clearance_m = 0.05
    """Distance from walls at which a handle stops [m]."""

    def __init__(self, plan: FloorPlan | StoreysPlan, config: RadioConfig) -> None:
        """Build walls and furniture of the wall material, and the tracer.

        Raises:
            MapError: If a plan has no free area.
            ValueError: If antennas do not fit under a ceiling, or a material is unknown at this frequency.
        """
        self.plan = plan
        walls = replace(config.building, furniture_material=config.building.wall_material)
        super().__init__(storeys_of(plan)[0], replace(config, building=walls))
        self._prepare()

    def _prepare(self) -> None:
        lowest = min(storey.building.height_m for storey in self.storeys)
        if not 0 < self.config.height_m < lowest:
            where = " of each storey" if len(self.storeys) > 1 else ""
            raise ValueError(
                f"height is {self.config.height_m:g} m, expected antennas between floor and ceiling{where}, 0 to "
                f"{lowest:g} m."
            )
        self.__dict__.pop("tracer", None)
        assert self.tracer  # raises an error now rather than at the first link
        self._lock = Lock()
        self._receiver: tuple[RadioLink, Interpreter] | None = None
        self._grids: dict[float, ReceiverGrid] = {}

    def with_config(self, config: RadioConfig) -> "LinkModel":
        """Return the model with other settings; only other settings of the building build the walls again."""
        if config.building != self.config.building:
            return LinkModel(self.plan, config)
        other = copy(self)
        other.config = config
        other._prepare()
        return other

    def antenna(self, place: Float[np.ndarray, "2"], storey: int = 0) -> Float[np.ndarray, "3"]:
        """Position of an antenna on a storey at the free point nearest to a place, above the lowest floor [m]."""
        return self.nearest_free(np.array([*place, self.storeys[storey].floor_m + self.config.height_m]))

    def first_place(self, storey: int = 0) -> Float[np.ndarray, "3"]:
        """Position below the opening of a storey's slab, or in its largest connected floor if it has none [m]."""
        opening, free = (
            self.storeys[storey].opening,
            self.storeys[storey].building.free_at(self.config.height_m),
        )
        components = shapely.get_parts(free)
        inside = components[np.argmax(shapely.area(components))] if opening.is_empty else opening
        return self.antenna(shapely.get_coordinates(inside.representative_point())[0], storey)

    def place_out_of_sight(self, tx: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """Position on the lowest storey with many paths from a transmitter, out of its sight if possible [m]."""
        try:
            places = self.grid(FIRST_STEP_M).position
        except ValueError:  # the room is smaller than the step
            return self.antenna(tx[:2] + FIRST_STEP_M)
        paths = self.trace(tx[None], places, workers=1)
        count, hidden = paths.count()[0], paths.link_state()[0] == LinkState.FIRST_ORDER
        best = np.argmax(np.where(hidden, count, 0) if hidden.any() else count)
        return self.nearest_free(places[best])

    def measure(
        self, tx: Float[np.ndarray, "2"], pose: Float[np.ndarray, "3"], seed: int
    ) -> tuple[Measurement, Paths]:
        """Estimated paths and link state at a pose (x, y, yaw) [m, rad], and the true paths; slow at the first call."""
        with self._lock:
            if self._receiver is None:
                c = self.config
                link_config = RadioLinkConfig(
                    frequency_hz=c.frequency_hz, height_m=c.height_m, tracer=c.tracer
                )
                link = RadioLink(self.building, link_config)
                self._receiver = link, Interpreter(link, "generated")
            link, interpreter = self._receiver
            link.place(tx)
            estimates = link.measure(pose, np.random.default_rng(seed))
            assert link.paths is not None  # set by the measurement
            return interpreter.interpret(estimates, pose), link.paths

    def grid(self, step_m: float, **options: Any) -> ReceiverGrid:
        """Receivers on a grid over the lowest storey, cached by step [m]; options as of a scene are not."""
        if options:
            return super().grid(step_m, **options)
        if step_m not in self._grids:
            self._grids[step_m] = super().grid(step_m)
        return self._grids[step_m]


#: Files that refer to no others; a .yaml names an image, which is not uploaded.
MESHES, OTHERS = (".stl", ".obj", ".ply", ".glb", ".off"), (".npy", ".json")
ENDINGS = (*IMAGES, *MESHES, *OTHERS)
#: Endings of files without a scale.
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
