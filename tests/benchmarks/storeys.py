"""Radio tracing in buildings of several storeys: links a second of CPU, in each storey and between any two of them.

Transmitters and receivers stand at random places of all storeys, as a data set has them. Rates are of warm runs of one
thread, by CPU time. A few links are traced in space too, where every facet and every edge is tried: the paths that both
find are counted, and those that only one of them does.
"""

from pathlib import Path
from time import perf_counter, process_time
from typing import Any, Literal

import numpy as np
import shapely
from jaxtyping import Float
from rich.console import Group
from rich.table import Table

from robosim.building.multi_storey import Storeys, make_storeys
from robosim.plans.files import read_plan
from robosim.plans.storey_plans import StoreyPlan, StoreysPlan
from robosim.support.files import write_json
from wireless.paths import Paths
from wireless.tracing.stack_scene import StackScene
from wireless.tracing.tracer import Tracer, TracerConfig

#: What is traced: up to two reflections, then an edge with one besides.
SETTINGS = {
    "2 reflections": TracerConfig(max_reflections=2, diffraction=False),
    "2 reflections, edges with 1": TracerConfig(max_reflections=2, diffraction_reflections=1),
}
HEIGHT_M, CLEARANCE_M = 1.5, 0.1
#: A stairwell in the hall of the shipped villa.
STAIRS = ((4.1, 8.6), (6.1, 8.6), (6.1, 11.0), (4.1, 11.0))
#: Transmitters, and links that are traced in space too.
_TX, _CHECKED = 3, 9
_ENGINES: tuple[Literal["storeys", "space"], ...] = ("storeys", "space")
#: Paths whose lengths and directions differ by less are one [m, rad].
_SAME = 1e-6


def three_villas() -> StoreysPlan:
    """The shipped villa three times over itself, a stairwell of 2 x 2.4 m2 open in both slabs."""
    villa = read_plan("villa")
    storeys = [StoreyPlan(plan=villa, openings=(STAIRS,)), StoreyPlan(plan=villa, openings=(STAIRS,))]
    return StoreysPlan(name="villas", storeys=(*storeys, StoreyPlan(plan=villa)))


def run(plan: StoreysPlan, *, out: Path, receivers: int = 200, seed: int = 0) -> Group:
    """Trace a building at all settings; write `storeys.json`, and return a table.

    Args:
        plan: The building.
        out: Folder for the file.
        receivers: Receivers on each storey.
        seed: Seed of places.
    """
    building, rng = make_storeys(plan), np.random.default_rng(seed)
    tx, rx = (_places(building, count, rng) for count in (_TX, receivers))
    rows = [_measured(building, tx, rx, name, config) for name, config in SETTINGS.items()]
    checked = _checked(building, tx, rx, rng)
    about = {
        "building": plan.name,
        "storeys": len(plan.storeys),
        "faces": len(building.mesh.faces),
        "seed": seed,
    }
    write_json(Path(out) / "storeys.json", about | {"speed": rows, "in_space": checked})
    table = Table(title=f"{plan.name}: {len(plan.storeys)} storeys of {len(building.mesh.faces)} triangles")
    for column in ("paths", "links per CPU second", "prepared in s", "links between storeys", "with a path"):
        table.add_column(column, justify="left" if column == "paths" else "right")
    for row in rows:
        table.add_row(
            row["setting"],
            f"{row['links_per_cpu_s']:,.0f}",
            f"{row['prepare_s']:.1f}",
            f"{row['between']:,}",
            f"{100 * row['between_with_path'] / max(1, row['between']):.1f} %",
        )
    told = "{links} links traced in space too: {same} paths in both, {missing} in space only, {extra} in storeys only"
    return Group(table, told.format(**checked))


def _places(building: Storeys, count: int, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """So many random places on each storey."""
    found: list[tuple[float, float, float]] = []
    for number, storey in enumerate(building.storeys):
        room = storey.building.free.buffer(-CLEARANCE_M)
        low, high = np.reshape(room.bounds, (2, 2))
        while len(found) < (number + 1) * count:
            x, y = rng.uniform(low, high)
            if shapely.contains_xy(room, x, y):
                found.append((x, y, storey.floor_m + HEIGHT_M))
    return np.array(found)


def _measured(
    building: Storeys,
    tx: Float[np.ndarray, "t 3"],
    rx: Float[np.ndarray, "r 3"],
    name: str,
    config: TracerConfig,
) -> dict[str, Any]:
    """Rate of one setting, and how many links between storeys have a path."""
    begin = perf_counter()
    tracer = Tracer(building, config=config)
    prepare_s = perf_counter() - begin
    tracer.trace(tx[:1], rx[:1], workers=1)  # compiles
    begin = process_time()
    paths = tracer.trace(tx, rx, workers=1)
    seconds = process_time() - begin
    between = tx[:, None, 2] != rx[None, :, 2]
    return {
        "setting": name,
        "in_storeys": isinstance(tracer.scene, StackScene),
        "links_per_cpu_s": len(tx) * len(rx) / seconds,
        "prepare_s": prepare_s,
        "paths": len(paths),
        "between": int(between.sum()),
        "between_with_path": int((between & (paths.count() > 0)).sum()),
    }


def _checked(
    building: Storeys, tx: Float[np.ndarray, "t 3"], rx: Float[np.ndarray, "r 3"], rng: np.random.Generator
) -> dict[str, int]:
    """How many paths of a few links storeys and space have in common."""
    some = rng.permutation(len(rx))[: _CHECKED // 3]
    storeys, space = (
        Tracer(
            building,
            config=TracerConfig(
                scene=scene, search="exhaustive", max_reflections=2, max_transmissions=0, max_paths=3000
            ),
        ).trace(tx[:: len(tx) // 3][:3], rx[some])
        for scene in _ENGINES
    )
    same = sum(_in_both(storeys, space, link) for link in np.unique(space.link))
    return {"links": 3 * len(some), "same": same, "missing": len(space) - same, "extra": len(storeys) - same}


def _in_both(one: Paths, other: Paths, link: int) -> int:
    """Paths of a link that both have, each counted once."""
    rows = [
        np.column_stack([p.delay_s * 3e8, np.cos(p.aod_az), np.sin(p.aoa_az), p.aod_el, p.aoa_el])[
            p.link == link
        ]
        for p in (one, other)
    ]
    left, count = list(rows[0]), 0
    for row in rows[1]:
        off = [np.abs(each - row).max() for each in left]
        if off and min(off) < _SAME:
            left.pop(int(np.argmin(off)))
            count += 1
    return count
