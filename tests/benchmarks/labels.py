"""Agreement of traced link states and angles with the published labels of mmwRobotNav.

One unit is a building and a transmitter. Units are kept in `units/`, so that a run that was killed goes on where
it stopped, and a unit is done anew only if its plan, its data or the rules have changed. Each unit is worked on
alone: the number of workers changes no result.
"""

import hashlib
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

import wireless
from robosim.published import label_adjacent, label_links, label_walls
from robosim.published.label_links import TRACER, Links, compare, confusion
from robosim.support.files import npz_bytes, write_json, write_whole
from robosim.support.progress import told_units
from robosim.support.run_folder import run_folder
from robosim.support.workers import Workers
from tests.benchmarks import label_maps
from wireless.formats.mmwrobotnav_measurements import DataError, find_measurements, read_measurements
from wireless.paths import LinkState

STATES = ("outage", "LOS", "first", "higher")
NEAR_RAD = np.radians(5.0)
#: Maps of disagreement are drawn of so many buildings.
N_MAPS = 3
Unit = tuple[str, int]


def run(
    data: Path, plans: Path, *, workers: int, cluster: str | None = None, out: Path, console: Console
) -> dict[str, Any]:
    """Compare all links, write `labels.json` and maps of the worst buildings, and show the tables.

    Args:
        data: Folder with a folder of measurements for each building.
        plans: Folder with `NAME.glb_topdownmap.out` for each building.
        workers: Processes at once.
        cluster: Address of a dask scheduler that is used instead; its processes have to see the files.
        out: Folder for the results.
        console: Where progress and tables are shown.

    Returns:
        What `labels.json` holds: for each building and in total what `summary` gives.

    Raises:
        DataError: If there are no measurements, or a plan is missing.
    """
    units = find_measurements(data)
    plan_of = {name: _plan(plans, name) for name, _ in units}
    keys = {unit: _key(data, plan_of[unit[0]], unit) for unit in units}
    left = [unit for unit in units if not _kept(out, unit, keys[unit])]
    with run_folder(out, "bench labels"):
        calls = [(data, plan_of[unit[0]], unit) for unit in left]
        with (
            Workers(min(workers, len(left) or 1), cluster, what="transmitters") as pool,
            told_units(console, "transmitters", len(units), len(units) - len(left)) as tell,
        ):
            for number, content in pool.run(_work, calls):
                unit = left[number]
                write_whole(_file(out, unit, keys[unit]), content)
                tell(f"{unit[0]} {unit[1]}")
        of_building: dict[str, list[Links]] = defaultdict(list)
        for unit in units:
            of_building[unit[0]].append(Links.load(_file(out, unit, keys[unit])))
        rows = {name: summary(links) for name, links in of_building.items()}
        total = summary([links for some in of_building.values() for links in some])
        result = {"buildings": rows, "total": total}
        write_json(out / "labels.json", result)
        for name in sorted(rows, key=lambda name: (rows[name]["all"], name))[:N_MAPS]:
            measured = [read_measurements(data, *unit) for unit in units if unit[0] == name]
            label_maps.draw(out / f"{name}.png", plan_of[name], measured, of_building[name])
        _show(console, rows, total)
        return result


def summary(some: list[Links]) -> dict[str, Any]:
    """Agreement and angles of some transmitters' links together, as shares; NaN of no links."""
    links = Links(**{name: np.concatenate([getattr(s, name) for s in some]) for name in vars(some[0])})
    same = links.published == links.computed
    row: dict[str, Any] = {
        "links": len(same),
        "all": _share(same),
        "clear_links": int(links.clear.sum()),
        "clear": _share(same[links.clear]),
        "confusion": confusion(links, np.ones(len(same), bool)),
        "confusion_clear": confusion(links, links.clear),
    }
    for state in (LinkState.LOS, LinkState.FIRST_ORDER, LinkState.HIGHER_ORDER):
        both = (links.published == state) & ~np.isnan(links.strongest_off)
        row[f"aoa_{STATES[state]}"] = {
            "strongest": _share(links.strongest_off[both] < NEAR_RAD),
            "cluster": _share(links.cluster_off[both] < NEAR_RAD),
            "any": _share(links.any_off[both] < NEAR_RAD),
        }
    return row


def last_line(total: dict[str, Any]) -> str:
    """The two totals in words."""
    return (
        f"Link states agree for {100 * total['all']:.2f} % of all {total['links']} links and for "
        f"{100 * total['clear']:.2f} % of the {total['clear_links']} in the transmitter's own free space and off "
        "border cells."
    )


def _share(mask: np.ndarray) -> float:
    return float(mask.mean()) if len(mask) else float("nan")


def _plan(plans: Path, name: str) -> Path:
    path = plans / f"{name}.glb_topdownmap.out"
    if not path.is_file():
        raise DataError(
            f"{path}: no such plan, but there are measurements of {name}. Give the folder of its top-down grid."
        )
    return path


def _key(data: Path, plan: Path, unit: Unit) -> str:
    """Changes with whatever a unit's result depends on: its files, the rules and the tracer's code."""
    name, number = unit
    files = (plan, data / name / f"{name}_tx_pos.csv", data / name / f"{name}_Tx_{number}_beam_search.csv")
    content = b"".join(path.read_bytes() for path in files if path.is_file())
    sources = [
        Path(label_adjacent.__file__),
        Path(label_links.__file__),
        Path(label_walls.__file__),
        *sorted(Path(wireless.__file__).parent.rglob("*.py")),
    ]
    code = b"".join(path.read_bytes() for path in sources)
    return hashlib.sha256(repr(TRACER).encode() + code + content).hexdigest()[:16]


def _file(out: Path, unit: Unit, key: str) -> Path:
    return out / "units" / f"{unit[0]}-{unit[1]}-{key}.npz"


def _kept(out: Path, unit: Unit, key: str) -> bool:
    return _file(out, unit, key).is_file()


def _work(data: Path, plan: Path, unit: Unit) -> bytes:
    """The links of one unit, compared."""
    return npz_bytes(compare(read_measurements(data, *unit), plan).arrays())


def _show(console: Console, rows: dict[str, Any], total: dict[str, Any]) -> None:
    """Tables by building and of confusion, and the totals as the last line."""
    table = Table("building", "links", "agree %", "clear links", "agree %", *_angles(), title="Link states")
    for name, row in [*rows.items(), ("total", total)]:
        if name == "total":
            table.add_section()
        angles = [
            f"{100 * row[f'aoa_{state}']['strongest']:.1f} / {100 * row[f'aoa_{state}']['cluster']:.1f}"
            for state in STATES[1:]
        ]
        cells = [f"{100 * row[name]:.2f}" for name in ("all", "clear")]
        table.add_row(Text(name), str(row["links"]), cells[0], str(row["clear_links"]), cells[1], *angles)
    console.print(table)
    console.print(
        "AoA: share within 5 degrees of the estimate, of the strongest path / through a receiver's beams"
    )
    for name, title in (("confusion", "All links"), ("confusion_clear", "Links in the clear")):
        matrix = Table("published", *(f"computed {state}" for state in STATES), title=title)
        for state, counts in zip(STATES, total[name], strict=True):
            matrix.add_row(state, *(str(count) for count in counts))
        console.print(matrix)
    console.print(last_line(total), soft_wrap=True)


def _angles() -> list[str]:
    return [f"AoA {state} %" for state in STATES[1:]]
