"""Radio tracing: speed against error, over outline tolerance, reflections and diffraction.

Each plan is traced at each setting, from the same transmitters to the same receivers, and compared with the
fullest setting (exact outline, most reflections, diffraction with a reflection): share of links with the same
link state, direction of the strongest path, total power. Places lie in the free space of all tolerances.
Rates are of warm runs, those of one worker by CPU time; compiling and preparing a building are reported apart. Growth
is the slope of a line through logarithms of time. Who sees whom is asked of other engines too (`sight`),
and rooms of triangles are traced in space (`space`).

Errors are those of leaving paths out and of moving walls; how right the physics is, the tests say.
"""

import itertools
import os
import platform
import resource
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
import shapely
import trimesh
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from robosim.building.building import Building, BuildingConfig, make_building
from robosim.plans.floorplan import FloorPlan
from robosim.support.figures import save_figure
from robosim.support.files import write_json
from robosim.support.progress import tracked
from tests.benchmarks import sight, space
from wireless.paths import Paths
from wireless.tracing.blocks import available_cores
from wireless.tracing.tracer import Tracer, TracerConfig

#: Outline tolerances [m], the fullest first; None for straight walls under staircases.
TOLERANCES_M = (0.0, None, 0.02, 0.05, 0.1)
#: Most reflections on a path without diffraction.
ORDERS = (0, 1, 2, 3, 4)
#: Kinds of diffracted paths, by the most reflections on them; -1 for no diffraction.
EDGES = {-1: "no edges", 0: "edges", 1: "edges, 1 reflection"}
#: The setting that rates, growth and latency are measured at.
USUAL = TracerConfig(max_reflections=3, diffraction_reflections=1)
HEIGHT_M = 1.5
#: Directions within this are the same [rad].
SAME_RAD = np.radians(5.0)
_TX_PER_PLAN = 2
_LATENCIES = 200
_GRID_M = 0.15


def run(
    plans: Sequence[FloorPlan],
    *,
    out: Path,
    receivers: int = 400,
    segments: int = 40_000,
    workers: int | None = None,
    seed: int = 0,
    rooms: Sequence[space.Room] = space.ROOMS,
    console: Console | None = None,
) -> Group:
    """Trace plans at all settings, and rooms; write `wireless.json` and two plots, and return tables.

    Args:
        plans: Floor plans.
        out: Folder for the files.
        receivers: Receivers for each plan in the comparison of settings.
        segments: Segments that engines are asked about in each plan.
        workers: Most threads; None for one on each available core.
        seed: Seed of places.
        rooms: Rooms of triangles that rates are measured in.
        console: Where progress is shown; None for nowhere.
    """
    workers = workers or available_cores()
    compile_s = _compile()
    settings: list[dict[str, Any]] = []
    speeds: list[dict[str, Any]] = []
    sights: list[dict[str, Any]] = []
    with tracked(plans, "tracing", console) as shown:
        for plan in shown:
            rng = np.random.default_rng(seed)
            buildings = {
                t: make_building(plan, config=BuildingConfig(tolerance_m=t, height_m=2 * HEIGHT_M))
                for t in TOLERANCES_M
            }
            tracers = {t: _prepared(b) for t, b in buildings.items()}
            places = _places(list(buildings.values()), _TX_PER_PLAN + receivers, rng)
            settings += _sweep(plan.name, buildings, places)
            grid = _grid(buildings[TOLERANCES_M[0]])
            for tolerance_m, (tracer, prepare_s) in tracers.items():
                row = {"plan": plan.name, "tolerance_m": tolerance_m, "prepare_s": prepare_s}
                speeds.append(row | _speed(tracer, places, _inside(buildings[tolerance_m], grid), workers))
            exact = buildings[TOLERANCES_M[0]]
            for answer in sight.compare(exact, count=segments, seed=seed):
                sights.append({"plan": plan.name, **answer})
            views = sight.rate_of_views(exact, receivers=300, seed=seed)
            sights.append(
                {"plan": plan.name, "engine": "views of the plan, float64", "segments_per_s_here": views}
            )
    triangles = space.compare(rooms, receivers=receivers, seed=seed)
    about = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "workers": workers,
        "seed": seed,
        "receivers": receivers,
        "compile_s": compile_s,
        "peak_memory_gb": _peak_memory_gb(),
        "growth_with_walls": {plan.name: _growth(speeds, plan.name) for plan in plans},
    }
    summary = _pooled(settings)
    write_json(
        Path(out) / "wireless.json",
        about
        | {"settings": settings, "pooled": summary, "speed": speeds, "sight": sights, "space": triangles},
    )
    _plot(summary, speeds, Path(out) / "wireless.png")
    save_figure(space.plot(triangles), Path(out) / "space.png")
    return Group(
        _error_table(summary), _speed_table(speeds, about), _sight_table(sights), *space.tables(triangles)
    )


def _compile() -> float:
    """Seconds that the first trace in this process takes: compiling, or loading what was compiled."""
    walls = np.array([[0, 0, 0], [5, 0, 0], [5, 0, 3], [0, 0, 3]], float)
    mesh = trimesh.Trimesh(walls, [(0, 1, 2), (0, 2, 3)], process=False)
    begin = perf_counter()
    Tracer(mesh, config=USUAL).trace(np.array([[1.0, 1, 1]]), np.array([[3.0, 1, 1]]))
    return perf_counter() - begin


def _prepared(building: Building) -> tuple[Tracer, float]:
    """The usual tracer of a building, and the seconds that it took to make."""
    begin = perf_counter()
    return Tracer(building, config=USUAL), perf_counter() - begin


def _places(buildings: Sequence[Building], count: int, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """Random places in the free space of all buildings."""
    free = shapely.intersection_all([b.free for b in buildings])
    low, high = np.array(free.bounds).reshape(2, 2)
    found = np.empty((0, 2))
    while len(found) < count:
        spots = rng.uniform(low, high, (4 * count, 2))
        found = np.concatenate([found, spots[shapely.contains_xy(free, spots)]])
    return np.insert(found[:count], 2, HEIGHT_M, axis=1)


def _grid(building: Building) -> Float[np.ndarray, "n 3"]:
    """The grid of receivers that rates are measured on."""
    low, high = np.array(building.free.bounds).reshape(2, 2)
    axes = [np.arange(a + _GRID_M / 2, b, _GRID_M) for a, b in zip(low, high, strict=True)]
    spots = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    return np.insert(spots, 2, HEIGHT_M, axis=1)


def _inside(building: Building, places: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    return places[shapely.contains_xy(building.free, places[:, :2])]


def _sweep(
    name: str, buildings: dict[float | None, Building], places: Float[np.ndarray, "n 3"]
) -> list[dict[str, Any]]:
    """A row for each setting, errors against the fullest one."""
    tx, rx = places[:_TX_PER_PLAN], places[_TX_PER_PLAN:]
    rows, fullest = [], None
    for tolerance_m, order, edges in itertools.product(TOLERANCES_M, ORDERS[::-1], sorted(EDGES)[::-1]):
        config = TracerConfig(
            max_reflections=order, diffraction=edges >= 0, diffraction_reflections=max(edges, 0)
        )
        tracer = Tracer(buildings[tolerance_m], config=config)
        tracer.trace(tx[:1], rx[:1])
        begin = process_time()
        paths = tracer.trace(tx, rx, workers=1)
        seconds = process_time() - begin
        fullest = fullest or paths
        setting = {"plan": name, "tolerance_m": tolerance_m, "order": order, "edges": edges}
        rows.append(setting | {"seconds": seconds, "links": len(tx) * len(rx)} | errors(paths, fullest))
    return rows


def errors(paths: Paths, reference: Paths) -> dict[str, Any]:
    """How the links of one tracing differ from those of another.

    Returns:
        same_state: Share of links with the same link state.
        aoa_rad: Angle in azimuth between the strongest paths, of links that the reference has paths for; pi
            if the other has none.
        power_db: Absolute ratio of total powers, of links that both have paths for.
    """
    some = (reference.count() > 0).ravel()
    both = some & (paths.count() > 0).ravel()
    aoa, power = [], []
    for one in (paths, reference):
        first = np.full(both.size, np.nan)
        first[one.link[one.rank == 0]] = one.aoa_az[one.rank == 0]
        aoa.append(first[some])
        power.append(np.bincount(one.link, one.power, both.size)[both])
    off = np.abs(np.angle(np.exp(1j * (aoa[0] - aoa[1]))))
    return {
        "same_state": float((paths.link_state() == reference.link_state()).mean()),
        "aoa_rad": np.where(np.isnan(off), np.pi, off).tolist(),
        "power_db": np.abs(10 * np.log10(power[0] / power[1])).tolist(),
    }


def _pooled(settings: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row for each setting over all plans; per-link lists are dropped from `settings`."""
    rows = []
    key = ("tolerance_m", "order", "edges")
    for setting in itertools.product(TOLERANCES_M, ORDERS, sorted(EDGES)):
        mine = [row for row in settings if tuple(row[k] for k in key) == setting]
        links = sum(row["links"] for row in mine)
        aoa, power = (np.concatenate([row[k] for row in mine]) for k in ("aoa_rad", "power_db"))
        rows.append(
            dict(zip(key, setting, strict=True))
            | {
                "links_per_s": links / sum(row["seconds"] for row in mine),
                "same_state": sum(row["same_state"] * row["links"] for row in mine) / links,
                **_summed_up(aoa, power),
            }
        )
    for row in settings:
        row |= _summed_up(np.array(row.pop("aoa_rad")), np.array(row.pop("power_db")))
        row["links_per_s"] = row["links"] / row["seconds"]
    return rows


def _summed_up(aoa_rad: np.ndarray, power_db: np.ndarray) -> dict[str, float]:
    return {
        "same_aoa": float((aoa_rad <= SAME_RAD).mean()) if len(aoa_rad) else np.nan,
        "power_db": float(power_db.mean()) if len(power_db) else np.nan,
        "power_90_db": float(np.quantile(power_db, 0.9)) if len(power_db) else np.nan,
    }


def _speed(
    tracer: Tracer, places: Float[np.ndarray, "n 3"], grid: Float[np.ndarray, "m 3"], workers: int
) -> dict[str, Any]:
    """Rates on a grid with one worker and with all, growth with receivers, latency of single links."""
    tx = places[:1]
    tracer.trace(tx, grid[:1])
    seconds = {}
    for n in dict.fromkeys((1, workers)):
        clock = process_time if n == 1 else perf_counter
        begin = clock()
        tracer.trace(tx, grid, workers=n)
        seconds[n] = clock() - begin
    counts = [n for n in (len(grid) // 16, len(grid) // 4, len(grid)) if n]
    mixed = np.random.default_rng(0).permutation(grid)
    times = []
    for n in counts:
        begin = process_time()
        tracer.trace(tx, mixed[:n], workers=1)
        times.append(process_time() - begin)
    live = []
    for i in range(_LATENCIES):
        begin = perf_counter()
        tracer.trace(tx, mixed[i % len(mixed)][None])
        live.append(perf_counter() - begin)
    plan = tracer.scene.plan  # type: ignore[union-attr]  # buildings are plans
    return {
        "walls": len(plan.wall_point),
        "corners": len(plan.corner_vertex),
        "receivers": len(grid),
        "links_per_s_1": len(grid) / seconds[1],
        "links_per_s": len(grid) / seconds[workers],
        "growth_with_receivers": _slope(counts, times),
        "live_s": float(np.median(live)),
        "live_95_s": float(np.quantile(live, 0.95)),
    }


def _slope(x: Sequence[float], y: Sequence[float]) -> float:
    """Exponent of y over x; not a number if x does not vary."""
    if len(set(x)) < 2:
        return np.nan
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def _growth(speeds: list[dict[str, Any]], plan: str) -> float:
    """Exponent of the time per link over the number of walls, by a plan's tolerances."""
    mine = [row for row in speeds if row["plan"] == plan]
    return _slope([row["walls"] for row in mine], [1 / row["links_per_s_1"] for row in mine])


def _peak_memory_gb() -> float:
    """Most memory that this process has held."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e9 if sys.platform == "darwin" else 1e6)


def _outline(tolerance_m: float | None) -> str:
    """What tables call an outline."""
    return "straight" if tolerance_m is None else f"within {tolerance_m:g} m" if tolerance_m else "exact"


def _error_table(rows: list[dict[str, Any]]) -> Table:
    caption = (
        "Links per CPU second on one worker · links with the link state of the fullest setting · strongest paths "
        f"within {np.degrees(SAME_RAD):g}° of its · mean error in dB of total power where both reach."
    )
    table = Table(title="Speed against error", caption=caption, box=None, pad_edge=False)
    table.add_column("diffraction")
    table.add_column("order", justify="right")
    for tolerance_m in TOLERANCES_M:
        table.add_column(_outline(tolerance_m), justify="right")
    of = {(row["tolerance_m"], row["order"], row["edges"]): row for row in rows}
    for edges, order in itertools.product(sorted(EDGES), ORDERS):
        cells = [of[tolerance_m, order, edges] for tolerance_m in TOLERANCES_M]
        table.add_row(
            EDGES[edges],
            str(order),
            *(
                f"{c['links_per_s']:,.0f}  {100 * c['same_state']:.1f} %  {100 * c['same_aoa']:.0f} %  "
                f"{c['power_db']:.2f}"
                for c in cells
            ),
        )
    return table


def _speed_table(rows: list[dict[str, Any]], about: dict[str, Any]) -> Table:
    growth = ", ".join(f"{power:.2f} ({plan})" for plan, power in about["growth_with_walls"].items())
    caption = (
        f"Reflections to {USUAL.max_reflections}, diffraction with {USUAL.diffraction_reflections} reflection. "
        f"First trace {about['compile_s']:.1f} s (compiling, or loading what was). Time grows with walls to "
        f"the power of {growth}. Peak memory {about['peak_memory_gb']:.2f} GB."
    )
    told = Text(caption, "table.caption")  # has names of plans in it
    table = Table(title="Rates and latency, warm", caption=told, box=None, pad_edge=False)
    table.add_column("plan")
    columns = ("outline", "walls", "prepare", "receivers", "links/s, 1 worker")
    for column in (*columns, f"{about['workers']} workers", "growth with receivers", "one link", "95 %"):
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(
            Text(row["plan"]),
            _outline(row["tolerance_m"]),
            str(row["walls"]),
            f"{row['prepare_s']:.2f} s",
            str(row["receivers"]),
            f"{row['links_per_s_1']:,.0f}",
            f"{row['links_per_s']:,.0f}",
            f"{row['growth_with_receivers']:.2f}",
            f"{1e3 * row['live_s']:.2f} ms",
            f"{1e3 * row['live_95_s']:.2f} ms",
        )
    return table


def _sight_table(rows: list[dict[str, Any]]) -> Table:
    caption = (
        "Corners and points of walls to receivers, exact outline, one thread; wrong answers out of so many "
        f"segments, at the plan's place and {sight.FAR_M / 1e3:g} km away."
    )
    table = Table(title="Who sees whom", caption=caption, box=None, pad_edge=False)
    for column in ("plan", "engine"):
        table.add_column(column)
    for column in ("million/s", "segments", "wrong", "wrong far away"):
        table.add_column(column, justify="right")
    for row in rows:
        counts = [f"{row[k]:,}" if k in row else "-" for k in ("segments", "wrong_here", "wrong_far")]
        table.add_row(Text(row["plan"]), row["engine"], f"{row['segments_per_s_here'] / 1e6:.2f}", *counts)
    return table


def _plot(rows: list[dict[str, Any]], speeds: list[dict[str, Any]], path: Path) -> None:
    """Errors over speed (better is down and to the right), and time over walls."""
    figure = Figure(figsize=(13, 8), layout="constrained")
    axes = figure.subplots(2, 2).ravel()
    markers = dict(zip(sorted(EDGES), "os^", strict=True))
    quantities: dict[str, Callable[[dict[str, Any]], float]] = {
        "links of another state [%]": lambda row: 100 * (1 - row["same_state"]),
        f"strongest paths off by over {np.degrees(SAME_RAD):g}° [%]": lambda row: 100 * (1 - row["same_aoa"]),
        "mean error of total power [dB]": lambda row: row["power_db"],
    }
    for (label, value), ax in zip(quantities.items(), axes[:3], strict=True):
        for (i, tolerance_m), edges in itertools.product(enumerate(TOLERANCES_M), sorted(EDGES)):
            line = [row for row in rows if (row["tolerance_m"], row["edges"]) == (tolerance_m, edges)]
            x, y = [row["links_per_s"] for row in line], [value(row) for row in line]
            ax.plot(x, y, marker=markers[edges], color=f"C{i}", lw=0.6, ms=4)
            for row in line:
                ax.annotate(str(row["order"]), (row["links_per_s"], value(row)), fontsize=6)
        ax.set(xscale="log", xlabel="links per second", ylabel=label)
        ax.set_ylim(bottom=0)
    for i, plan in enumerate(dict.fromkeys(row["plan"] for row in speeds)):
        mine = sorted((row for row in speeds if row["plan"] == plan), key=lambda row: row["walls"])
        for key, marker, style in (("links_per_s_1", "o", "-"), ("live_s", "s", "--")):
            of = {row["walls"]: 1e3 * (row[key] if key == "live_s" else 1 / row[key]) for row in mine}
            kept = [row["walls"] for row in mine if row["tolerance_m"] is not None]
            axes[3].plot(kept, [of[n] for n in kept], marker + style, color=f"C{i}")
            straight = [row["walls"] for row in mine if row["tolerance_m"] is None]
            axes[3].plot(straight, [of[n] for n in straight], marker, color=f"C{i}", mfc="white", ms=8)
        axes[3].plot([], [], "o-", color=f"C{i}", label=plan)
    axes[3].set(xscale="log", yscale="log", xlabel="walls", ylabel="time per link [ms]")
    axes[3].xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes[3].xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axes[3].xaxis.set_minor_formatter(NullFormatter())
    axes[3].plot([], [], "o-", color="0.4", label="in a grid, one worker")
    axes[3].plot([], [], "s--", color="0.4", label="alone")
    axes[3].plot([], [], "o", color="0.4", mfc="white", ms=8, label="straight walls")
    axes[3].legend(fontsize="x-small")
    for ax in axes:
        ax.grid(True, which="both", lw=0.3)
    for edges, marker in markers.items():
        axes[0].plot([], [], marker, color="0.4", label=EDGES[edges])
    for i, tolerance_m in enumerate(TOLERANCES_M):
        axes[0].plot([], [], "-", color=f"C{i}", label=f"outline: {_outline(tolerance_m)}")
    figure.legend(
        *axes[0].get_legend_handles_labels(),
        title="numbers: most reflections;\nerrors: against exact outline,\n4 reflections, edges and 1",
        fontsize="x-small",
        loc="outside right upper",
    )
    save_figure(figure, path)
