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

import numpy as np
import shapely
from jaxtyping import Float

from robosim.building.building import Building, make_building
from robosim.building.multi_storey import Storey, Storeys, StoreysConfig, make_storeys
from robosim.plans.files import IMAGES, read_plan
from robosim.plans.floorplan import FloorPlan, MapError
from robosim.plans.storey_plans import StoreysPlan
from robosim.radio.link import RadioLink, RadioLinkConfig
from robosim.radio.measurement import Interpreter, Measurement
from robosim.radio.receivers import ReceiverGrid, receiver_grid
from robosim.radio.scene import RadioConfig
from wireless.paths import LinkState, Paths
from wireless.tracing.tracer import Tracer

#: Distance from walls at which a handle stops [m].
CLEARANCE_M = 0.05
#: Distance between candidates for the robot's first place [m].
FIRST_STEP_M = 1.0
#: Wall materials that the page offers.
WALL_MATERIALS = ("partition", "concrete_wall", "glazing", "door", "metal")


class LinkModel:
    """A building with one or several storeys, ready for tracing."""

    def __init__(self, plan: FloorPlan | StoreysPlan, config: RadioConfig) -> None:
        """Build walls and furniture of the wall material, and the tracer.

        Raises:
            MapError: If a plan has no free area.
            ValueError: If antennas do not fit under a ceiling, or a material is unknown at this frequency.
        """
        self.plan = plan
        walls = replace(config.building, furniture_material=config.building.wall_material)
        if isinstance(plan, StoreysPlan):
            self._walls: Building | Storeys = make_storeys(plan, config=StoreysConfig(building=walls))
            self.storeys = self._walls.storeys
        else:
            self._walls = single = make_building(plan, config=walls)
            self.storeys = (Storey(building=single, floor_m=0.0, opening=shapely.MultiPolygon()),)
        #: The lowest storey.
        self.building: Building = self.storeys[0].building
        self._prepare(config)

    def _prepare(self, config: RadioConfig) -> None:
        self.config = config
        lowest = min(one.building.height_m for one in self.storeys)
        if not 0 < config.height_m < lowest:
            where = " of each storey" if len(self) > 1 else ""
            raise ValueError(
                f"height is {config.height_m:g} m, expected antennas between floor and ceiling{where}, 0 to "
                f"{lowest:g} m."
            )
        self.tracer = Tracer(self._walls, frequency_hz=config.frequency_hz, config=config.tracer)
        self._free = []
        for storey in self.storeys:
            free = storey.building.free_at(config.height_m)
            inside = free.buffer(-CLEARANCE_M)
            self._free.append(free if inside.is_empty else inside)
            shapely.prepare(self._free[-1])
        self._lock = Lock()
        self._receiver: tuple[RadioLink, Interpreter] | None = None
        self._grids: dict[float, ReceiverGrid] = {}

    def __len__(self) -> int:
        """Number of storeys."""
        return len(self.storeys)

    def with_config(self, config: RadioConfig) -> "LinkModel":
        """The same plan with other settings; only other settings of the building build the walls again."""
        if config.building != self.config.building:
            return LinkModel(self.plan, config)
        other = copy(self)
        other._prepare(config)
        return other

    def level_m(self, storey: int) -> float:
        """Height of antennas on a storey above the lowest floor [m]."""
        return self.storeys[storey].floor_m + self.config.height_m

    def antenna(self, place: Float[np.ndarray, "2"], storey: int = 0) -> Float[np.ndarray, "3"]:
        """Position of an antenna on a storey, height above the lowest floor [m]."""
        return np.array([*place, self.level_m(storey)])

    def nearest_free(self, place: Float[np.ndarray, "2"], storey: int = 0) -> Float[np.ndarray, "2"]:
        """The free point of a storey that is nearest to a place [m]; some free point for NaN or infinite values."""
        free = self._free[storey]
        if not np.isfinite(place).all():
            place = np.array(free.representative_point().coords[0])
        point = shapely.Point(*place)
        if free.covers(point):
            return np.array(place, float)
        return np.array(shapely.shortest_line(free, point).coords[0])

    def first_place(self, storey: int = 0) -> Float[np.ndarray, "2"]:
        """A place below the opening of a storey's slab, or in its largest part if it has none [m]."""
        opening = self.storeys[storey].opening
        parts = shapely.get_parts(self._free[storey])
        inside = opening if not opening.is_empty else parts[int(np.argmax(shapely.area(parts)))]
        return self.nearest_free(np.array(inside.representative_point().coords[0]), storey)

    def place_out_of_sight(self, tx: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """A place with many paths from a transmitter, out of its sight if possible [m]; one storey only."""
        try:
            places = self.grid(FIRST_STEP_M).position
        except ValueError:  # the room is smaller than the step
            return self.nearest_free(tx + FIRST_STEP_M)
        paths = self.tracer.trace(self.antenna(tx)[None], places, workers=1)
        count, hidden = paths.count()[0], paths.link_state()[0] == LinkState.FIRST_ORDER
        best = int(np.argmax(np.where(hidden, count, 0) if hidden.any() else count))
        return self.nearest_free(places[best][:2])

    def paths(
        self, tx: Float[np.ndarray, "2"], rx: Float[np.ndarray, "2"], storeys: tuple[int, int] = (0, 0)
    ) -> Paths:
        """True paths between two places [m] on their storeys."""
        ends = self.antenna(tx, storeys[0]), self.antenna(rx, storeys[1])
        return self.tracer.trace(ends[0][None], ends[1][None], workers=1)

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

    def grid(self, step_m: float) -> ReceiverGrid:
        """Places all over the free space, a step apart [m].

        Raises:
            ValueError: If none fits.
        """
        if step_m not in self._grids:
            self._grids[step_m] = receiver_grid(self.building, step_m, self.config.height_m)
        return self._grids[step_m]


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
