"""How much traced links hang on the outline of walls: exact cells, straight walls, and walls moved at random.

Links are between random places of the free floor. The exact outline of the cells is the reference of each row, though
neither outline is that of the building: walls lie within a cell of 5 cm. Walls are moved by moving each corner of the
straight walls by a normal error along each axis.
"""

import numpy as np
import trimesh
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes

from robosim.building.building import Building, BuildingConfig, make_building
from robosim.plans.files import read_plan
from tests.benchmarks.harness import DEFAULT, Options, free_places
from tests.benchmarks.results import Results
from wireless.paths import LinkState, Paths
from wireless.tracing.tracer import Tracer

FREQUENCY_HZ, _HEIGHT_M, _NEAR_RAD = 28e9, 1.5, np.radians(5.0)
#: Standard deviation of a corner along each axis [m].
_MOVED_M = 0.025
_TRANSMITTERS, _RECEIVERS = 20, 25


def main(*, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Link states, directions and powers of the shipped flat and office by the outline of their walls.

    Args:
        options: Of every benchmark.
    """
    results = Results()
    for name in ("flat", "office"):
        plan = read_plan(name)
        rng = np.random.default_rng(options.seed)
        exact = make_building(plan, config=BuildingConfig(tolerance_m=0.0))
        straight = make_building(plan, config=BuildingConfig())
        ends = [
            np.column_stack([free_places(straight.free.buffer(-0.2), n, rng), np.full(n, _HEIGHT_M)])
            for n in (_TRANSMITTERS, _RECEIVERS)
        ]
        reference = Tracer(exact, frequency_hz=FREQUENCY_HZ).trace(*ends)
        _add(
            results,
            f"{name}, straight walls",
            reference,
            Tracer(straight, frequency_hz=FREQUENCY_HZ).trace(*ends),
        )
        traced = [_moved(straight, rng).trace(*ends) for _ in range(2)]
        _add(results, f"{name}, corners moved", reference, traced[0])
        _add(results, f"{name}, moved twice, compared", *traced)
    return options.finish("outlines", results)


def _moved(building: Building, rng: np.random.Generator) -> Tracer:
    """A tracer of a building whose upright edges are moved."""
    mesh = building.mesh
    corner, of = np.unique(mesh.vertices[:, :2].round(6), axis=0, return_inverse=True)
    vertices = mesh.vertices.copy()
    vertices[:, :2] += rng.normal(0, _MOVED_M, corner.shape)[of.reshape(-1)]
    return Tracer(
        trimesh.Trimesh(vertices, mesh.faces, process=False),
        materials=building.materials,
        face_material=building.face_material,
        frequency_hz=FREQUENCY_HZ,
    )


def _strongest(paths: Paths) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Azimuth of arrival of the strongest path of each link, and total power [dB]; NaN without a path."""
    n_links = len(paths.tx_position) * len(paths.rx_position)
    azimuth, power = np.full(n_links, np.nan), np.zeros(n_links)
    first = paths.strongest()
    azimuth[first.link] = first.aoa_az
    np.add.at(power, paths.link, paths.power)
    return azimuth, 10 * np.log10(np.where(power > 0, power, np.nan))


def _add(results: Results, row: str, reference: Paths, paths: Paths) -> None:
    """Compare links."""
    (azimuth, power), (other, other_power) = _strongest(reference), _strongest(paths)
    state, changed = reference.link_state().ravel(), paths.link_state().ravel()
    results.add(
        "outlines",
        row,
        "same link state",
        100 * float((state == changed).mean()),
        "%",
        digits=0,
        cases=len(state),
    )
    for name, of in (("line of sight", LinkState.LOS), ("first order", LinkState.FIRST_ORDER)):
        links = (state == of) & ~np.isnan(azimuth) & ~np.isnan(other)
        off = np.abs((azimuth - other + np.pi)[links] % (2 * np.pi) - np.pi)
        results.add(
            "outlines",
            row,
            f"{name}: strongest within 5°",
            100 * float((off <= _NEAR_RAD).mean()),
            "%",
            digits=0,
        )
        mean = float(np.abs(power - other_power)[links].mean())
        results.add("outlines", row, f"{name}: power off, mean", mean, "dB", digits=1, cases=int(links.sum()))
