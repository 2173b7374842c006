"""What rough walls change: power and link states of random links with scattering against the same without."""

from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time

import numpy as np
import shapely
from jaxtyping import Float
from rich.console import Console
from rich.table import Table

from robosim.building.building import Building, make_building
from robosim.plans.floorplan import FloorPlan
from robosim.support.files import write_json
from robosim.support.progress import tracked
from wireless.paths import LinkState, Paths
from wireless.tracing.tracer import Tracer, TracerConfig

#: Scattering coefficients, and exponents of the lobe; None is Lambert's law.
TRIED: tuple[tuple[float, int | None], ...] = ((0.2, 4), (0.4, 4), (0.4, None))
#: Height of both ends, room that they have [m], and the weakest path that counts for a state [dB].
HEIGHT_M, ROOM_M, THRESHOLD_DB = 1.2, 0.25, -130.0
#: Enough paths for all that is scattered.
ALL_PATHS = 2000
TRANSMITTERS = 10


@dataclass(frozen=True)
class Row:
    """One plan and one kind of wall."""

    plan: str
    scattering: float
    lobe: int | None
    links: int
    change_db: dict[str, float]
    """Change of total power [dB]: median by link state without scattering, and percentiles 10 and 90 of all."""
    same_state: float
    links_per_s: float
    """By processor time, one thread, 25 paths a link."""
    links_per_s_without: float


def run(plans: list[FloorPlan], *, links: int, seed: int, out: Path, console: Console) -> Table:
    """Trace links of each plan, write scattering.json, and give the table.

    Args:
        plans: Where.
        links: Links of each, in tens.
        seed: Of their places.
        out: Folder for the results.
        console: Where progress is shown.
    """
    with tracked(plans, "plans", console) as some:
        rows = [row for plan in some for row in compare(make_building(plan), links, seed)]
    write_json(out / "scattering.json", {"rows": [asdict(row) for row in rows]})
    states = [state.name.lower().replace("_", " ") for state in LinkState if state]
    table = Table("plan", "S", "lobe", *(f"{s} [dB]" for s in states), "10 to 90 %", "same state", "links/s")
    for row in rows:
        change = row.change_db
        table.add_row(
            row.plan,
            f"{row.scattering:g}",
            "Lambert" if row.lobe is None else str(row.lobe),
            *(f"{change[s]:+.2f}" for s in states),
            f"{change['low']:+.1f} to {change['high']:+.1f}",
            f"{100 * row.same_state:.1f} %",
            f"{row.links_per_s:.0f} ({row.links_per_s_without:.0f})",
        )
    return table


def compare(building: Building, links: int, seed: int) -> list[Row]:
    """Rows of one building."""
    tx, rx = _ends(building, links, seed)
    without, plain = _timed(building, TracerConfig(), tx, rx)
    power, state = _power(without), without.link_state(THRESHOLD_DB).ravel()
    rows = []
    for share, lobe in TRIED:
        config = TracerConfig(scattering=share, scattering_lobe=lobe)
        few, speed = _timed(building, config, tx, rx)
        every = Tracer(
            building, config=TracerConfig(scattering=share, scattering_lobe=lobe, max_paths=ALL_PATHS)
        )
        total = _power(every.trace(tx, rx, workers=1))
        both = (power > 0) & (total > 0)
        off = 10 * np.log10(total[both] / power[both])
        change = {
            s.name.lower().replace("_", " "): float(np.median(off[state[both] == s]))
            if (state[both] == s).any()
            else float("nan")
            for s in LinkState
            if s
        }
        low, high = np.percentile(off, (10, 90)) if len(off) else (np.nan, np.nan)
        rows.append(
            Row(
                building.plan.name,
                share,
                lobe,
                len(power),
                {**change, "low": float(low), "high": float(high)},
                float(np.mean(few.link_state(THRESHOLD_DB).ravel() == state)),
                speed,
                plain,
            )
        )
    return rows


def _timed(
    building: Building, config: TracerConfig, tx: Float[np.ndarray, "n 3"], rx: Float[np.ndarray, "m 3"]
) -> tuple[Paths, float]:
    """Paths, and links a second of processor time."""
    tracer = Tracer(building, config=config)
    tracer.trace(tx[:1], rx[:1], workers=1)  # loops are compiled, views begun
    start = process_time()
    paths = tracer.trace(tx, rx, workers=1)
    return paths, len(tx) * len(rx) / max(process_time() - start, 1e-9)


def _power(paths: Paths) -> Float[np.ndarray, " n"]:
    """Total power gain of each link."""
    links = len(paths.tx_position) * len(paths.rx_position)
    return np.bincount(paths.link, weights=paths.power, minlength=links)


def _ends(
    building: Building, links: int, seed: int
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "m 3"]]:
    """Random places with room around them, in the largest piece of free floor."""
    room = max(shapely.get_parts(building.free.buffer(-ROOM_M)), key=shapely.area)
    low, high = np.array(room.bounds).reshape(2, 2)
    rng, places = np.random.default_rng(seed), np.empty((0, 2))
    wanted = TRANSMITTERS + -(-links // TRANSMITTERS)
    while len(places) < wanted:
        some = rng.uniform(low, high, (4 * wanted, 2))
        places = np.vstack([places, some[shapely.contains_xy(room, *some.T)]])
    ends = np.column_stack([places[:wanted], np.full(wanted, HEIGHT_M)])
    return ends[:TRANSMITTERS], ends[TRANSMITTERS:]
