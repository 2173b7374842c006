"""Links of one published transmitter, traced and laid beside their published labels and estimated angles.

The walls are those of `robosim.published.label_walls`, which the published ray tracer let paths through once: two
plasterboards with air between (`GAP_M`). Of the paths, those are taken that the published ray tracer could find
(`robosim.published.label_adjacent`).

A link is in the clear if its receiver lies in the same piece of free space as the transmitter and its cell has
eight free neighbours: the published receivers are shifted by a cell against their plan, so that many of the
others stand on walls or behind them, where a tie decides.
"""

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, UInt8

from robosim.building.building import Building, make_building
from robosim.plans.files import read_plan
from robosim.published.label_adjacent import adopted, with_coarse
from robosim.published.label_walls import published_mesh
from robosim.support.arrays_in import Array, read_npz
from robosim.support.reading import reading
from wireless.formats.mmwrobotnav_measurements import Measurements, link_states
from wireless.paths import Paths
from wireless.tracing.tracer import Tracer, TracerConfig

#: Plasterboard and the air between two of it [m]. Found from the published estimates: in line of sight, 2056 single
#: reflections heard apart are, over incidence, as strong as this wall says, with a median of 0.2 dB over all; of all
#: thicknesses from 8 to 20 mm and gaps to 130 mm it fits best. It lets 8 dB more through than a layer of 0.1 m.
PLASTERBOARD_M, GAP_M = 0.013, 0.089
#: Faces of edges reflect at half the angle between the rays: of all laws tried on 2,000 lone diffractions the one that
#: spreads least about the published strengths (`python -m tests.benchmarks edges`), though full-wave solutions
#: differ.
#: An edge with two reflections, one before and one after, was found from the labels: where nothing else arrives at a
#: fully traced receiver, 78 % of the links that have such a path are higher order, but 26 % and 41 % of those with both
#: reflections after or before (nine buildings). With a wall passed besides it is 44 %: three interactions are the most.
TRACER = TracerConfig(
    max_reflections=3,
    diffraction_reflections=2,
    diffraction_side_reflections=1,
    diffraction_law="bisector",
    max_transmissions=1,
    wall_passage="face",
    max_interactions=3,
    wall_thickness_m=PLASTERBOARD_M,
    wall_gap_m=GAP_M,
    max_paths=25,
)
#: The published receiver: samples [s], elements of an array, and directions that it looks in.
SAMPLE_S, ELEMENTS, DIRECTIONS = 2.5e-9, 8, 360


@dataclass(frozen=True, kw_only=True, eq=False)
class Links:
    """Traced beside published, for each link of a transmitter."""

    published: UInt8[np.ndarray, " n"]
    """Published link state."""
    computed: UInt8[np.ndarray, " n"]
    """Computed link state."""
    clear: Bool[np.ndarray, " n"]
    """Whether the link is in the transmitter's own piece of free space and off border cells."""
    strongest_off: Float[np.ndarray, " n"]
    """Angle between the strongest computed path's arrival and the published estimate [rad]; NaN for none."""
    cluster_off: Float[np.ndarray, " n"]
    """The same of what a receiver with beams would take for the strongest path."""
    any_off: Float[np.ndarray, " n"]
    """The same of the computed path that is nearest to the estimate."""

    def arrays(self) -> dict[str, np.ndarray]:
        """The columns by their names."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @classmethod
    def load(cls, path: Path) -> "Links":
        """Read a NumPy archive of `arrays`."""
        expected = {f.name: Array("b u f", "n") for f in fields(cls)}
        with reading(path, "compared links", "Delete it to compare them again.") as file:
            return cls(**read_npz(file, expected))


@lru_cache(maxsize=1)
def prepared(plan: Path) -> tuple[Building, Tracer]:
    """Building and tracer of a plan, kept for the next transmitter."""
    building = make_building(read_plan(plan))
    return building, Tracer(published_mesh(building.plan, building.height_m), config=TRACER)


def compare(measured: Measurements, plan: Path) -> Links:
    """Trace the links of a transmitter and compare.

    Raises:
        ValueError: If receivers lie outside of the plan, or on no regular grid.
    """
    building, tracer = prepared(plan)
    tx = measured.tx_position
    clear = in_the_clear(building, tx[:2], measured.rx_position)
    rx = np.column_stack([measured.rx_position, np.full(len(measured.rx_position), measured.tx_position[2])])
    try:
        paths = published_paths(measured.tx_position, rx, measured.rx_cell, tracer)
    except ValueError as error:
        raise ValueError(f"{measured.building} {measured.number}: {error}") from error
    estimate = measured.aoa_az[:, 0]
    return Links(
        published=measured.state,
        computed=link_states(paths)[0],
        clear=clear,
        strongest_off=_nearest(paths.strongest(), estimate),
        cluster_off=_apart(received_azimuth(paths), estimate),
        any_off=_nearest(paths, estimate),
    )


def published_paths(
    tx: Float[np.ndarray, "3"], rx: Float[np.ndarray, "n 3"], cell: Int[np.ndarray, "n 2"], tracer: Tracer
) -> Paths:
    """Paths from a transmitter, as far as the published ray tracer could find them.

    Args:
        tx: Where the transmitter is [m].
        rx: Where receivers are [m], all at one height.
        cell: Row and column of each, from 1 at the north-west.
        tracer: Of the published walls.

    Raises:
        ValueError: If receivers are on no regular grid.
    """
    all_cells, position = with_coarse(cell, rx[:, :2])
    all_rx = np.column_stack([position, np.full(len(position), rx[0, 2])])
    paths = tracer.trace(tx[None], all_rx, workers=1)
    paths = paths.select(adopted(paths, all_cells) & (paths.rx < len(rx)))
    return replace(paths, rx_position=rx)


def in_the_clear(
    building: Building, tx: Float[np.ndarray, "2"], rx: Float[np.ndarray, "n 2"]
) -> Bool[np.ndarray, " n"]:
    """Which receivers are in the transmitter's own piece of free space, in cells with eight free neighbours.

    Raises:
        ValueError: If receivers lie outside of the plan.
    """
    plan = building.plan
    cell = np.floor(plan.to_cells(rx)).astype(np.int64)
    if not ((cell >= 0) & (cell < plan.shape[::-1])).all():
        raise ValueError(
            f"{plan.name}: receivers from {rx.min(axis=0)} to {rx.max(axis=0)} m do not fit on this plan. "
            "Do data and plan belong together?"
        )
    inner = cv2.erode(np.pad(plan.free, 1).astype(np.uint8), np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0
    parts = shapely.get_parts(building.free)
    own = parts[np.argmin(shapely.distance(parts, shapely.Point(tx)))]
    return inner[cell[:, 1], cell[:, 0]] & shapely.contains_xy(own, rx)


def received_azimuth(paths: Paths) -> Float[np.ndarray, " n_rx"]:
    """Azimuth of arrival that a receiver with beams takes for the strongest path [rad]; NaN without paths.

    Paths in one sample of delay and one beam add up, incoherently since their phases are random. The beam is
    that of a uniform line of `ELEMENTS` half a wavelength apart, looking in `DIRECTIONS`. One transmitter only.
    """
    look = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    found = np.full(len(paths.rx_position), np.nan)
    start = np.searchsorted(paths.rx, np.arange(len(found) + 1))
    for i in np.flatnonzero(np.diff(start)):
        some = slice(start[i], start[i + 1])
        power, azimuth, delay = paths.power[some], paths.aoa_az[some], paths.delay_s[some]
        in_beam = _beam(look[:, None] - azimuth) * power
        in_sample = np.sinc((delay[:, None] - delay) / SAMPLE_S) ** 2
        found[i] = look[np.argmax((in_beam @ in_sample).max(axis=1))]
    return found


def _beam(off: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "n m"]:
    """Power of a beam, 1 at its peak, at angles off it; nothing behind it."""
    phase = np.pi / 2 * np.sin(off)
    safe = np.where(np.abs(phase) < 1e-9, 1e-9, phase)
    factor = np.sin(ELEMENTS * safe) / (ELEMENTS * np.sin(safe))
    return np.where(np.cos(off) > 0, factor**2, 0.0)


def _apart(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Angle between directions [rad]."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi)


def _nearest(paths: Paths, estimate: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Least angle between a link's paths and its estimate [rad]; NaN without paths."""
    off = np.full(len(estimate), np.inf)
    np.minimum.at(off, paths.rx, _apart(paths.aoa_az, estimate[paths.rx]))
    return np.where(np.isinf(off), np.nan, off)


def confusion(links: Links, mask: Bool[np.ndarray, " n"]) -> Int[np.ndarray, "4 4"]:
    """Number of links by published (row) and computed (column) state."""
    pairs = 4 * links.published[mask].astype(np.int64) + links.computed[mask]
    return np.bincount(pairs, minlength=16).reshape(4, 4)
