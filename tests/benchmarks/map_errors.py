"""Error of coverage maps over their CPU time, next to Sionna RT's: specular paths of up to four reflections.

The reference of both is the mean power over `DENSE` x `DENSE` points of each cell with all paths, found by exact images
here; cells where a path reaches only some of these points are left out. Ours are traced at the middle of a cell, or at
four or nine points of it; those of Sionna RT shoot samples, which average over a cell. Preparation of a scene and
compiling are left out on both sides.

Reference: Sionna RT (Aoudia et al., arXiv:2504.21719), `RadioMapSolver`.
"""

import re
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float
from matplotlib.figure import Figure
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import BuildingConfig, make_building
from robosim.building.mesh_export import export_mitsuba
from tests.benchmarks.harness import DEFAULT, Options, console, free_places, plans_of
from tests.benchmarks.results import Results
from tests.benchmarks.tracer_peer import (
    ALL,
    FREQUENCY_HZ,
    HEIGHT_M,
    MATERIALS,
    SCENE_HZ,
    TX_M,
    find_scenes,
    specular,
)
from wireless.geometry.array_types import Point, Points
from wireless.tracing.tracer import Tracer, TracerConfig

#: Most reflections of the map that all are compared with, and points of a cell along each side.
ORDER, DENSE = 4, 5
#: Height of receivers in buildings, and in the street [m].
RX_M, STREET_M = 1.3, 1.5
#: Transmitter of Sionna RT's examples in Munich, and the side of the map around it [m].
MUNICH_TX, MUNICH_M = (8.5, 21.0, 27.0), 300.0
#: In a building the transmitter is at the one of so many places that reaches most cells.
TRIED = 10
#: Links traced at once where all paths of dense points are found.
BATCH = 20_000
#: Lines of the figure: label, rows, and marker.
SERIES = (
    ("orders 1 to 4, middle of a cell", r"all paths, order \d", "o-"),
    ("1 to 200 paths, order 4", r"\d+ paths, order 4", "s-"),
    ("1, 4 and 9 points of a cell, order 4", r"all paths, order 4(, \d points)?", "^-"),
    ("Sionna RT, more and more samples", r"Sionna RT .*", "x--"),
)
WORKER = Path(__file__).with_name("map_errors_worker.py")


@dataclass(frozen=True, kw_only=True)
class Cells:
    """A scene, a transmitter, and the cells of a map."""

    name: str
    scene: Path
    """File for Sionna RT."""
    tracer: Callable[[TracerConfig], Tracer]
    tx: Point
    frequency_hz: float
    low: Float[np.ndarray, "2"]
    """Lower left corner of the map [m]."""
    shape: tuple[int, int]
    """Rows and columns."""
    cell_m: float
    z_m: float
    free: shapely.Geometry | None = None
    """Where cells have to be; None for everywhere."""

    def points(self, per_side: int) -> Points:
        """Points of all cells [m], those of a cell one after the other."""
        row, column = np.divmod(np.arange(np.prod(self.shape)), self.shape[1])
        step = (np.arange(per_side) + 0.5) / per_side
        y, x = np.meshgrid(step, step, indexing="ij")
        corner = np.column_stack([column, row])[:, None] + np.column_stack([x.ravel(), y.ravel()])
        flat = self.low + self.cell_m * corner.reshape(-1, 2)
        return np.column_stack([flat, np.full(len(flat), self.z_m)])


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    python: str = "python",
    cell_m: float = 0.2,
    samples: tuple[int, ...] = (100_000, 1_000_000, 10_000_000, 100_000_000),
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Error of coverage maps over their CPU time, next to Sionna RT's.

    Args:
        plans: Floor plans, or folders of them; Munich of Sionna RT is added.
        python: A Python that has Sionna RT; without it, nothing is measured.
        cell_m: Side of a cell in buildings [m]; 4 m in Munich.
        samples: Numbers of samples of Sionna RT.
        options: Of every benchmark.
    """
    results = Results()
    scenes = find_scenes(python, "map_errors")
    if scenes is None:
        return results
    with tempfile.TemporaryDirectory() as folder:
        places = [
            of_plan(plan, cell_m, options.seed, Path(folder) / str(i))
            for i, plan in enumerate(plans_of(plans))
        ]
        munich = scenes / "munich" / "munich.xml"
        for cells in [*places, *([_of_munich(munich)] if munich.exists() else [])]:
            measure(cells, python, samples, results)
    results.figures["map_errors"] = draw(results)
    return options.finish("map_errors", results)


def measure(cells: Cells, python: str, samples: tuple[int, ...], results: Results) -> None:
    """Errors and CPU times of all maps of a scene."""
    complete = specular(ORDER, ALL)
    dense, _ = own_powers(cells, complete, DENSE)
    truth, middle, inside = dense.mean(axis=2), dense[..., DENSE**2 // 2], _inside(cells)
    wanted = inside & (dense > 0).all(axis=2)
    partly = inside & (truth > 0) & ~wanted
    console.print(f"{cells.name}: {wanted.sum()} cells; {partly.sum()} that are reached in part are left out")
    rows: list[tuple[str, Float[np.ndarray, "ny nx"], float]] = []
    for order in range(1, ORDER + 1):
        rows.append((f"all paths, order {order}", *_map(cells, specular(order, ALL), 1)))
    for paths in (1, 5, 25, 200):
        rows.append((f"{paths} paths, order {ORDER}", *_map(cells, specular(ORDER, paths), 1)))
    for side in (2, 3):
        rows.append((f"all paths, order {ORDER}, {side**2} points", *_map(cells, complete, side)))
    peer = ask_peer(cells, python, samples)
    for count in samples:
        name = f"Sionna RT {peer['version']}, {count:.0e} samples".replace("e+0", "e")
        rows.append((name, peer[f"gain_{count}"], float(peer[f"cpu_s_{count}"])))
    for name, gain, seconds in rows:
        error, at_middle = _error_db(gain, truth, wanted), _error_db(gain, middle, wanted)
        results.add(cells.name, name, "CPU", seconds, "s", cases=int(wanted.sum()))
        results.add(cells.name, name, "error", np.sqrt(np.mean(error**2)), "dB", digits=2)
        results.add(cells.name, name, "at the middle", np.sqrt(np.mean(at_middle**2)), "dB", digits=2)
        results.add(cells.name, name, "median", np.median(np.abs(error)), "dB", digits=2)
        results.add(cells.name, name, "not reached", 100 * (1 - len(error) / wanted.sum()), "%", digits=1)


def own_powers(
    cells: Cells, config: TracerConfig, per_side: int
) -> tuple[Float[np.ndarray, "ny nx points"], float]:
    """Power gains at points of each cell, and the CPU time of tracing and adding the paths [s]."""
    tracer, points = cells.tracer(config), cells.points(per_side)
    power, begin = np.zeros(len(points)), time.process_time()
    for first in range(0, len(points), BATCH):
        batch = points[first : first + BATCH]
        paths = tracer.trace(cells.tx[None], batch, workers=1)
        strength = (np.abs(paths.gain[:, :, 0]) ** 2).sum(axis=1)  # both polarisations at the receiver
        power[first : first + len(batch)] = np.bincount(paths.rx, strength, len(batch))
    seconds = time.process_time() - begin
    return power.reshape(*cells.shape, -1), seconds


def draw(results: Results) -> Figure:
    """Error over CPU time of each scene."""
    names = list(results.tables())
    figure = Figure(figsize=(3.2 * len(names), 3.2), layout="constrained")
    for axes, name in zip(figure.subplots(1, len(names), sharey=True, squeeze=False)[0], names, strict=True):
        rows: dict[str, dict[str, Any]] = {}
        for row in results.rows:
            if row["table"] == name:
                rows.setdefault(row["row"], {})[row["name"]] = row["value"]
        for label, pattern, mark in SERIES:
            chosen = [values for row, values in rows.items() if re.fullmatch(pattern, row)]
            axes.plot([v["CPU"] for v in chosen], [v["error"] for v in chosen], mark, label=label, ms=4, lw=1)
        axes.set(xscale="log", yscale="log", title=name, xlabel="CPU time [s]")
        axes.grid(alpha=0.3, which="both")
    figure.axes[0].set_ylabel("root mean square error [dB]")
    figure.axes[0].legend(fontsize=6)
    return figure


def _map(cells: Cells, config: TracerConfig, per_side: int) -> tuple[Float[np.ndarray, "ny nx"], float]:
    power, seconds = own_powers(cells, config, per_side)
    return power.mean(axis=2), seconds


def of_plan(plan: Any, cell_m: float, seed: int, folder: Path) -> Cells:
    """A storey of half-spaces, which both programs know."""
    building = make_building(plan, config=BuildingConfig(height_m=HEIGHT_M, **MATERIALS))
    places = free_places(building.free, TRIED, np.random.default_rng(seed))
    low, high = np.array(building.free.bounds).reshape(2, 2)
    columns, rows = np.ceil((high - low) / cell_m).astype(int)
    cells = Cells(
        name=plan.name,
        scene=export_mitsuba(building, folder, frequency_hz=FREQUENCY_HZ),
        tracer=lambda config: Tracer(building, frequency_hz=FREQUENCY_HZ, config=config),
        tx=np.array([*places[0], TX_M]),
        frequency_hz=FREQUENCY_HZ,
        low=low,
        shape=(int(rows), int(columns)),
        cell_m=cell_m,
        z_m=RX_M,
        free=building.free,
    )
    options = [replace(cells, tx=np.array([*place, TX_M])) for place in places]
    return max(options, key=lambda option: int((_map(option, specular(1, 1), 1)[0] > 0).sum()))


def _of_munich(scene: Path) -> Cells:
    side = int(MUNICH_M / 4)
    return Cells(
        name="Munich",
        scene=scene,
        tracer=lambda config: Tracer.from_mitsuba(scene, frequency_hz=SCENE_HZ, config=config),
        tx=np.array(MUNICH_TX),
        frequency_hz=SCENE_HZ,
        low=np.array(MUNICH_TX[:2]) - MUNICH_M / 2,
        shape=(side, side),
        cell_m=4.0,
        z_m=STREET_M,
    )


def _inside(cells: Cells) -> Bool[np.ndarray, "ny nx"]:
    """Cells that are wholly in free space."""
    if cells.free is None:
        return np.ones(cells.shape, bool)
    middle = cells.points(1)[:, :2]
    squares = shapely.box(*(middle - cells.cell_m / 2).T, *(middle + cells.cell_m / 2).T)
    return shapely.contains(cells.free, squares).reshape(cells.shape)


def _error_db(
    gain: Float[np.ndarray, "ny nx"], truth: Float[np.ndarray, "ny nx"], wanted: Bool[np.ndarray, "ny nx"]
) -> Float[np.ndarray, " n"]:
    """Errors of the cells that a map reaches."""
    reached = wanted & (gain > 0)
    return 10 * np.log10(gain[reached] / truth[reached])


def ask_peer(cells: Cells, python: str, samples: tuple[int, ...]) -> dict[str, Any]:
    """Maps of Sionna RT."""
    size = cells.cell_m * np.array(cells.shape[::-1])
    with tempfile.TemporaryDirectory() as folder:
        wanted, maps = Path(folder) / "map.npz", Path(folder) / "maps.npz"
        np.savez(
            wanted, tx=cells.tx, center=[*(cells.low + size / 2), cells.z_m], size=size, cell_m=cells.cell_m,
            frequency_hz=cells.frequency_hz, depth=ORDER, samples=samples,
        )  # fmt: skip
        subprocess.run([python, WORKER, cells.scene, wanted, maps], check=True)
        return dict(np.load(maps))
