"""Data sets of links of several buildings: true paths, link states, and estimated paths.

A unit is a transmitter of a building (`robosim.datasets.link_units`). Units are written whole or not at all, by several
processes, and an interrupted run writes the missing ones, to the same bytes. The folder holds:

    links/NAME_Tx_K.parquet   links of transmitter K of building NAME (`wireless.formats.link_records`)
    manifest.json             written last: versions, configuration, plans, units with their rows, columns
    settings.json             settings of the data set; a run with others is rejected
    mmwrobotnav/NAME/         optional CSV files of traced and of estimated paths
    deepmimo_scenarios/NAME/  optional DeepMIMO v4 scenario
"""

import json
import platform
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int
from rich.console import Console

from robosim.datasets.link_units import (
    MMWROBOTNAV,
    LinkPlan,
    LinkProgress,
    LinkSetConfig,
    deepmimo_folder,
    deepmimo_scene,
    link_progress,
    make_unit,
    plain_config,
    stream,
    transmitters_file,
    unit_path,
)
from robosim.plans.floorplan import FloorPlan, MapError
from robosim.plans.storey_plans import StoreysPlan, storeys_of
from robosim.radio.scene import Place, RadioScene
from robosim.support.files import json_bytes, whole_file, write_files
from robosim.support.installation import package_version
from robosim.support.processes import reuse_processes
from robosim.support.progress import tracked
from robosim.support.run_folder import run_folder
from robosim.support.workers import Workers
from wireless.formats.link_records import COLUMNS, read_columns
from wireless.paths import LinkState

#: Spawn key of transmitters' places; spawn keys of units are their numbers.
_PLACES = 1 << 31
Unit = tuple[LinkPlan, int]
Plan = FloorPlan | StoreysPlan


def make_dataset(
    plans: Iterable[Plan | Callable[[], Plan]],
    config: LinkSetConfig,
    out: Path,
    *,
    workers: int = 1,
    cluster: str | None = None,
    console: Console | None = None,
) -> dict[str, Any]:
    """Make a data set, or its missing parts, in a folder; returns `manifest.json` with a number of units.

    Plans are read one after the other, and functions that make a plan are called by the processes: of many buildings
    and links this process holds compressed plans and counts.
    A building of several storeys has units for the receivers of each storey, named NAME_storey_0 and so on; its
    transmitters are spread over all storeys. Under "timing" are links, seconds and links per second of this run.

    Raises:
        FolderError: If the folder belongs to other settings or another process works in it.
        MapError: If two plans have the same name, or one has no free area.
        ValueError: If a setting does not fit a plan.
    """
    out, console = Path(out), console or Console(quiet=True)
    with reuse_processes():
        with Workers(workers, cluster, what="plans") as pool:
            sites = _sites(plans, config, pool, console)
        with run_folder(out, "dataset", _settings(sites, config)):
            with link_progress(console, sum(len(s.transmitters) * s.n_rx for s in sites), out) as progress:
                _make_units(sites, config, out, workers, cluster, progress)
                timing = progress.timing()
            _finish_formats(sites, config, out)
            manifest = _write_manifest(sites, config, out)
    return {**manifest, "timing": {**timing, "links_per_s": timing["links"] / timing["seconds"]}}


def _sites(
    plans: Iterable[Plan | Callable[[], Plan]], config: LinkSetConfig, pool: Workers, console: Console
) -> list[LinkPlan]:
    """Plans and storeys with their transmitters, in their order."""
    prepared: dict[int, list[LinkPlan]] = {}
    names: set[str] = set()
    with tracked(pool.run(_prepare, ((plan, config) for plan in plans)), "plans", console) as shown:
        for number, prepared[number] in shown:
            for name in (site.name.lower() for site in prepared[number]):
                if name in names:
                    raise MapError(
                        f"2 plans are called {name!r}, but files are named after them. Rename them."
                    )
                names.add(name)
    if not names:
        raise ValueError("plans is empty, expected at least one floor plan.")
    return [site for number in sorted(prepared) for site in prepared[number]]


def _prepare(plan: Plan | Callable[[], Plan], config: LinkSetConfig) -> list[LinkPlan]:
    return [_site(place, config) for place in storeys_of(plan() if callable(plan) else plan)]


def _site(plan: Place, config: LinkSetConfig) -> LinkPlan:
    """A plan with its transmitters and number of receivers."""
    scene = RadioScene(plan, config.radio)
    grid, whole = scene.grid(config.grid_m), scene.whole.plan.digest()
    transmitters = scene.transmitters(
        config.tx_per_plan, lambda storey: stream(config.seed, whole, _PLACES + storey)
    )
    return LinkPlan.of(plan, transmitters, len(grid.position))


def _settings(sites: list[LinkPlan], config: LinkSetConfig) -> dict[str, Any]:
    """Return the settings that the data depend on, as JSON types."""
    return {
        "version": package_version(),
        "config": plain_config(config),
        "plans": [
            {"name": site.name, "sha256": site.digest, "receivers": site.n_rx, "tx_m": site.transmitters}
            for site in sites
        ],
    }


def _make_units(
    sites: list[LinkPlan],
    config: LinkSetConfig,
    out: Path,
    workers: int,
    cluster: str | None,
    progress: LinkProgress,
) -> None:
    """Make the missing units."""
    units: list[Unit] = [(site, tx) for site in sites for tx in range(len(site.transmitters))]
    missing = [(site, tx) for site, tx in units if not unit_path(out, site.name, tx).exists()]
    total = sum(site.n_rx for site, _ in units)
    done = total - sum(site.n_rx for site, _ in missing)
    progress.report(done, total)
    if not missing:
        return
    with Workers(min(workers, len(missing)), cluster, what="transmitters") as pool:
        for number, files in pool.run(make_unit, ((site, tx, config) for site, tx in missing)):
            write_files(out, files)
            done += missing[number][0].n_rx
            progress.report(done, total)


def _write_manifest(sites: list[LinkPlan], config: LinkSetConfig, out: Path) -> dict[str, Any]:
    """Write `manifest.json` unit by unit; returns its content with the number of units in their place."""
    units: list[Unit] = [(site, tx) for site in sites for tx in range(len(site.transmitters))]
    states = np.array([_states(out, *unit) for unit in units])
    libraries = ("numpy", "numba", "pyarrow", "scipy", "shapely")
    manifest = {
        **_settings(sites, config),
        "versions": {
            "python": platform.python_version(),
            **{name: package_version(name) for name in libraries},
        },
        "rows": int(states.sum()),
        "states": _by_name(states.sum(axis=0)),
        "units": len(units),
        "columns": {
            name: {"type": str(kind), "unit": unit, "meaning": meaning}
            for name, (kind, unit, meaning) in COLUMNS.items()
        },
    }
    before, after = json_bytes(manifest).split(b'"units": %d' % len(units))
    with whole_file(out / "manifest.json") as partial, partial.open("wb") as file:
        file.write(before + b'"units": [')
        for number, ((site, tx), counts) in enumerate(zip(units, states, strict=True)):
            path = unit_path(Path(), site.name, tx).as_posix()
            unit = {"plan": site.name, "tx": tx + 1, "file": path, "rows": int(counts.sum())}
            file.write(b",\n    " if number else b"\n    ")
            file.write(json.dumps({**unit, "states": _by_name(counts)}).encode())
        file.write(b"\n  ]" + after)
    return manifest


def _states(out: Path, site: LinkPlan, tx: int) -> Int[np.ndarray, "4"]:
    """Number of links of a unit in each state."""
    state = read_columns(unit_path(out, site.name, tx), ["link_state"])["link_state"]
    return np.bincount(state, minlength=len(LinkState))


def _by_name(states: Int[np.ndarray, "4"]) -> dict[str, int]:
    return {state.name.lower(): int(states[state]) for state in LinkState}


def _finish_formats(sites: list[LinkPlan], config: LinkSetConfig, out: Path) -> None:
    """Write the files that formats have once per building."""
    for site in sites:
        name = site.name
        if "mmwrobotnav" in config.formats:
            write_files(out / MMWROBOTNAV / name, transmitters_file(name, site.transmitters))
        if "deepmimo" in config.formats:
            reached = np.zeros(site.n_rx, bool)
            for tx in range(len(site.transmitters)):
                reached |= read_columns(unit_path(out, name, tx), ["n_paths"])["n_paths"] > 0
            scene = RadioScene(site.plan, config.radio)
            files = deepmimo_scene(scene, len(site.transmitters), site.n_rx, int(reached.sum()))
            write_files(deepmimo_folder(out, name), files)
