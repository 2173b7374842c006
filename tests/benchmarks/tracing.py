"""Radio tracing: speed against error, in plans, in buildings of several storeys and among triangles.

Rates are of warm runs of one thread, by processor time. Errors of an outline or of fewer interactions are those against
the exact outline with four reflections and diffraction with one; whether the physics is right, the tests of `wireless`
say. Paths that a search by rays finds among triangles are compared with those of exhaustive search.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import shapely
import trimesh
from jaxtyping import Bool, Float
from scipy.constants import speed_of_light
from scipy.spatial import cKDTree
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import Building, BuildingConfig, make_building
from robosim.building.multi_storey import Storeys, make_storeys
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FloorPlan
from robosim.plans.storey_plans import StoreyPlan, StoreysPlan
from tests.benchmarks.harness import DEFAULT, Options, figure_of, free_places, plans_of, timed
from tests.benchmarks.results import Results
from wireless.paths import Interaction, LinkState, Paths
from wireless.tracing.tracer import Tracer, TracerConfig

#: Outlines by the tolerance that walls may be moved by [m]; None for straight walls under staircases.
OUTLINES = {"exact": 0.0, "straight walls": None, "0.02 m": 0.02, "0.05 m": 0.05, "0.1 m": 0.1}
#: The setting that rates are measured at, and the fullest one.
USUAL = TracerConfig(max_reflections=3, diffraction_reflections=1)
FULLEST = replace(USUAL, max_reflections=4)
HEIGHT_M, GRID_M = 1.5, 0.15
#: Directions within this are the same [rad].
SAME_RAD = np.radians(5.0)
#: Transmitters of a plan, and single links whose latency is measured.
TRANSMITTERS, SINGLE = 2, 200
#: Numbers of rays, and what counts of all paths: those at most so much weaker than the strongest of their link [dB].
RAYS, RANGE_DB = (100, 300, 1000, 3000, 10_000, 30_000, 100_000), 40.0
#: Lengths, directions and interactions that differ by less are those of one path [m, rad].
SAME_PATH = 1e-6
#: Coefficients and exponents of the lobe of rough walls (None for Lambert's), and the weakest path of a state [dB].
SCATTERING, WEAKEST_DB = ((0.2, 4), (0.4, 4), (0.4, None)), -130.0
#: A stairwell in the hall of the shipped villa [m].
STAIRS = ((4.1, 8.6), (6.1, 8.6), (6.1, 11.0), (4.1, 11.0))


class Room(NamedTuple):
    """What is in a room of 7 x 5 x 3 m3: boxes of 6 facets, and spheres of 20 triangles that are each cut in four."""

    boxes: int
    spheres: int
    divided: int


#: From 66 to 102,502 facets; the last is not judged by exhaustive search.
ROOMS = (Room(10, 0, 0), Room(34, 1, 2), Room(26, 2, 2), Room(20, 3, 3), Room(16, 5, 5))
JUDGED, MOST_JUDGED = Room(15, 1, 1), 5000


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    receivers: int = 400,
    rooms: int = len(ROOMS),
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Tracing of radio paths: links a second against errors, in plans, over storeys and among triangles.

    Args:
        plans: Floor plans, or folders of them.
        receivers: Receivers of each plan, storey and room.
        rooms: How many of the rooms of triangles, the smallest first.
        options: Of every benchmark.
    """
    results = Results()
    for plan in plans_of(plans):
        measure_plan(plan, receivers, options.seed, results)
        measure_scattering(plan, receivers // 2, options.seed, results)
    measure_storeys(three_villas(), receivers // 2, options.seed, results)
    measure_rays(made(JUDGED, options.seed), options.seed, results)
    for room in ROOMS[:rooms]:
        measure_room(made(room, options.seed), receivers, options.seed, results)
    results.figures["space"] = draw(results)
    return options.finish("tracing", results)


def measure_plan(plan: FloorPlan, receivers: int, seed: int, results: Results) -> None:
    """Rates and errors of one plan, over outlines, reflections and diffraction."""
    rng = np.random.default_rng(seed)
    buildings = {
        name: make_building(plan, config=BuildingConfig(tolerance_m=tolerance_m, height_m=2 * HEIGHT_M))
        for name, tolerance_m in OUTLINES.items()
    }
    everywhere_free = shapely.intersection_all([building.free for building in buildings.values()])
    places = _upright(free_places(everywhere_free, TRANSMITTERS + receivers, rng))
    tx, rx = places[:TRANSMITTERS], places[TRANSMITTERS:]
    reference = Tracer(buildings["exact"], config=FULLEST).trace(tx, rx, workers=1)
    for outline, building in buildings.items():
        row = f"{plan.name}, {outline}"
        tracer = Tracer(building, config=USUAL)
        results.add("outlines", row, "walls", len(tracer.scene.plan.wall_point))  # type: ignore[union-attr]
        grid = _upright(grid_in(building))
        tracer.trace(tx[:1], grid[:1])
        seconds, _ = timed(lambda tracer=tracer, grid=grid: tracer.trace(tx[:1], grid, workers=1))
        results.add("outlines", row, "links a CPU second", len(grid) / seconds, digits=0, cases=len(grid))
        single = [
            1e3 * timed(lambda tracer=tracer, one=one: tracer.trace(tx[:1], one[None]))[0]
            for one in rng.permutation(grid)[:SINGLE]
        ]
        results.add("outlines", row, "one link more", np.median(single), "ms", digits=2, cases=len(single))
        _add_errors(results, "outlines", row, errors(tracer.trace(tx, rx, workers=1), reference))
    for reflections in range(5):
        for name, edges in (("", False), (" and an edge", True)):
            config = TracerConfig(
                max_reflections=reflections, diffraction=edges, diffraction_reflections=int(edges)
            )
            tracer = Tracer(buildings["exact"], config=config)
            tracer.trace(tx[:1], rx[:1])
            seconds, paths = timed(lambda tracer=tracer: tracer.trace(tx, rx, workers=1))
            row = f"{plan.name}, {reflections} reflections{name}"
            results.add("interactions", row, "links a CPU second", len(tx) * len(rx) / seconds, digits=0)
            _add_errors(results, "interactions", row, errors(paths, reference))


def _add_errors(results: Results, table: str, row: str, found: dict[str, Any]) -> None:
    results.add(table, row, "same link state", 100 * found["same_state"], "%", digits=1)
    aoa, power = found["aoa_rad"], found["power_db"]
    results.add(
        table, row, "strongest path within 5°", 100 * np.mean(aoa <= SAME_RAD), "%", digits=1, cases=len(aoa)
    )
    results.add(table, row, "mean error of power", np.mean(power), "dB", digits=2, cases=len(power))


def grid_in(building: Building) -> Float[np.ndarray, "n 2"]:
    """Grid of receivers in free space [m]."""
    low, high = np.array(building.free.bounds).reshape(2, 2)
    axes = [np.arange(a + GRID_M / 2, b, GRID_M) for a, b in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    return places[shapely.contains_xy(building.free, places)]


def _upright(places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    return np.insert(places, 2, HEIGHT_M, axis=1)


def errors(paths: Paths, reference: Paths) -> dict[str, Any]:
    """How the links of one tracing differ from those of another.

    Returns:
        same_state: Share of links with the same link state.
        aoa_rad: Angle in azimuth between the strongest paths, of links that the reference has paths for; pi if the
            other has none.
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
        "aoa_rad": np.where(np.isnan(off), np.pi, off),
        "power_db": np.abs(10 * np.log10(power[0] / power[1])),
    }


def measure_scattering(plan: FloorPlan, links: int, seed: int, results: Results) -> None:
    """Change of power and of link states by rough walls, against smooth ones, over coefficient and lobe."""
    building, rng = make_building(plan), np.random.default_rng(seed)
    largest = max(shapely.get_parts(building.free.buffer(-0.25)), key=shapely.area)
    ends = np.insert(free_places(largest, 10 + links // 10, rng), 2, 1.2, axis=1)
    tx, rx = ends[:10], ends[10:]

    def trace(**changes: Any) -> tuple[float, Paths]:
        tracer = Tracer(building, config=TracerConfig(**changes))
        tracer.trace(tx[:1], rx[:1], workers=1)
        return timed(lambda: tracer.trace(tx, rx, workers=1))

    def power(paths: Paths) -> Float[np.ndarray, " n"]:
        return np.bincount(paths.link, paths.power, len(tx) * len(rx))

    _, smooth = trace()
    state = smooth.link_state(WEAKEST_DB).ravel()
    for coefficient, lobe in SCATTERING:
        rough = {"scattering": coefficient, "scattering_lobe": lobe}
        seconds, few = trace(**rough)
        _, every = trace(**rough, max_paths=2000)
        both = (power(smooth) > 0) & (power(every) > 0)
        change = 10 * np.log10(power(every)[both] / power(smooth)[both])
        row = f"{plan.name}, S = {coefficient:g}, {'Lambert' if lobe is None else 'directive'}"
        for name, one in (("line of sight", LinkState.LOS), ("first order", LinkState.FIRST_ORDER),
                          ("higher order", LinkState.HIGHER_ORDER)):  # fmt: skip
            value, cases = change[state[both] == one], int((state[both] == one).sum())
            results.add(
                "scattering", row, name, np.median(value) if cases else None, "dB", digits=1, cases=cases
            )
        results.add(
            "scattering",
            row,
            "10 to 90 %",
            None,
            "dB",
            digits=1,
            spread=tuple(np.percentile(change, (10, 90))),
        )
        same = 100 * np.mean(few.link_state(WEAKEST_DB).ravel() == state)
        results.add("scattering", row, "same link state", same, "%", digits=1, cases=len(state))
        results.add("scattering", row, "links a CPU second", len(state) / seconds, digits=0)


def three_villas() -> StoreysPlan:
    """The shipped villa three times over itself, a stairwell open in both slabs."""
    villa = read_plan("villa")
    storeys = [StoreyPlan(plan=villa, openings=(STAIRS,)), StoreyPlan(plan=villa, openings=(STAIRS,))]
    return StoreysPlan(name="villas", storeys=(*storeys, StoreyPlan(plan=villa)))


def measure_storeys(plan: StoreysPlan, receivers: int, seed: int, results: Results) -> None:
    """Rates over all pairs of storeys, and paths of a few links against those traced in space."""
    building, rng = make_storeys(plan), np.random.default_rng(seed)
    tx, rx = (_on_storeys(building, count, rng) for count in (3, receivers))
    for name, config in {
        "2 reflections": TracerConfig(max_reflections=2, diffraction=False),
        "2 reflections, and an edge with 1": TracerConfig(max_reflections=2, diffraction_reflections=1),
    }.items():
        tracer = Tracer(building, config=config)
        tracer.trace(tx[:1], rx[:1], workers=1)
        seconds, _ = timed(lambda tracer=tracer: tracer.trace(tx, rx, workers=1))
        links = len(tx) * len(rx)
        results.add("storeys", name, "links a CPU second", links / seconds, digits=0, cases=links)
    few = rx[rng.permutation(len(rx))[:3]]
    exhaustive = TracerConfig(
        scene="storeys", search="exhaustive", max_reflections=2, max_transmissions=0, max_paths=3000
    )
    in_storeys = Tracer(building, config=exhaustive).trace(tx[::3], few)
    in_space = Tracer(building, config=replace(exhaustive, scene="space")).trace(tx[::3], few)
    same = int(among(in_space, in_storeys).sum())
    row = f"{len(tx[::3]) * len(few)} links traced in space too"
    results.add("storeys", row, "paths in both", same)
    results.add("storeys", row, "in space alone", len(in_space) - same)
    results.add("storeys", row, "in storeys alone", len(in_storeys) - same)


def _on_storeys(building: Storeys, count: int, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """Random places on each storey."""
    return np.concatenate(
        [
            np.insert(
                free_places(one.building.free.buffer(-0.1), count, rng), 2, one.floor_m + HEIGHT_M, axis=1
            )
            for one in building.storeys
        ]
    )


def made(room: Room, seed: int) -> trimesh.Trimesh:
    """The mesh of a room; things stand below 1.9 m."""
    rng = np.random.default_rng(seed)
    parts = [trimesh.creation.box(bounds=np.array([np.zeros(3), (7.0, 5.0, 3.0)]))]
    for _ in range(room.boxes):
        box = trimesh.creation.box(rng.uniform(0.3, 0.8, 3))
        box.apply_transform(trimesh.transformations.rotation_matrix(rng.uniform(0, 3), (0.1, 0.2, 1)))
        box.apply_translation(rng.uniform((0.8, 0.8, 0.5), (6.2, 4.2, 1.1)))
        parts.append(box)
    for _ in range(room.spheres):
        sphere = trimesh.creation.icosphere(subdivisions=room.divided, radius=rng.uniform(0.2, 0.5))
        sphere.apply_translation(rng.uniform((0.8, 0.8, 0.6), (6.2, 4.2, 1.3)))
        parts.append(sphere)
    return trimesh.util.concatenate(parts)


def _places(count: int, seed: int) -> Float[np.ndarray, "n 3"]:
    """Places above what stands in a room."""
    return np.random.default_rng(seed).uniform((0.2, 0.2, 2.0), (6.8, 4.8, 2.8), (count, 3))


def _in_space(**changes: Any) -> TracerConfig:
    """Two reflections, or an edge and one."""
    usual: dict[str, Any] = {"scene": "space", "search": "rays", "max_reflections": 2, "floor_ceiling": True}
    return TracerConfig(**usual | {"max_transmissions": 0} | changes)


def measure_rays(mesh: trimesh.Trimesh, seed: int, results: Results, *, links: int = 20) -> None:
    """Share of the paths of exhaustive search that a search by rays finds, over the number of rays."""
    places = _places(1 + links, seed)
    strong, every = strong_paths(mesh, places[:1], places[1:])
    bent = (strong.interaction == Interaction.DIFFRACTION).any(axis=1)
    for rays in RAYS:
        paths = Tracer(mesh, config=_in_space(rays=rays, max_paths=5000)).trace(
            places[:1], places[1:], workers=1
        )
        found, row = among(strong, paths), f"{rays:,}"
        results.add("rays", row, "found", 100 * found.mean(), "%", digits=2, cases=len(found))
        results.add("rays", row, "without edges", 100 * found[~bent].mean(), "%", digits=2)
        results.add("rays", row, "with an edge", 100 * found[bent].mean(), "%", digits=2)
        results.add("rays", row, "false", (~among(paths, every)).sum())


def strong_paths(
    mesh: trimesh.Trimesh, tx: Float[np.ndarray, "t 3"], rx: Float[np.ndarray, "r 3"]
) -> tuple[Paths, Paths]:
    """Paths of exhaustive search within `RANGE_DB` of the strongest of their link, and all of them."""
    every = Tracer(mesh, config=_in_space(search="exhaustive", max_paths=5000)).trace(tx, rx)
    most = np.zeros(len(tx) * len(rx))
    np.maximum.at(most, every.link, every.power)
    return every.select(every.power > most[every.link] * 10 ** (-RANGE_DB / 10)), every


def among(some: Paths, others: Paths) -> Bool[np.ndarray, " n"]:
    """Which of some paths are among others: of the same link, interactions, length and directions."""
    rows = []
    for paths in (some, others):
        bent = (paths.interaction == Interaction.DIFFRACTION).any(axis=1)
        angles = paths.aod_az, paths.aoa_az, paths.aod_el, paths.aoa_el
        rows.append(
            np.column_stack([10 * paths.link, paths.order, bent, paths.delay_s * speed_of_light, *angles])
        )
    off, _ = cKDTree(rows[1]).query(rows[0])
    return off < SAME_PATH


def measure_room(mesh: trimesh.Trimesh, receivers: int, seed: int, results: Results) -> None:
    """Rates of one transmitter, whose own search counts, and what is found at the default number of rays."""
    places = _places(1 + receivers + 40, seed)
    tx, many, alone = places[:1], places[1:-40], places[-40:]
    row = ""
    for name, edges in (("without edges", False), ("links a CPU second", True)):
        tracer = Tracer(mesh, config=_in_space(diffraction=edges))
        facets = len(tracer.scene.space.mirrors)  # type: ignore[union-attr]
        row = f"{facets:,} facets"
        tracer.trace(many[:1], tx)
        seconds, _ = timed(lambda tracer=tracer: tracer.trace(tx, many, workers=1))
        results.add("rooms", row, name, receivers / seconds, digits=0, cases=receivers)
    single = [1e3 * timed(lambda one=one: tracer.trace(tx, one[None], workers=1))[0] for one in alone]
    results.add("rooms", row, "one link more", np.median(single), "ms", digits=1, cases=len(single))
    if facets <= MOST_JUDGED:
        strong, every = strong_paths(mesh, tx, many)
        paths = Tracer(mesh, config=_in_space(max_paths=5000)).trace(tx, many, workers=1)
        found = among(strong, paths)
        results.add("rooms", row, "found", 100 * found.mean(), "%", digits=2, cases=len(found))
        results.add("rooms", row, "false", (~among(paths, every)).sum())


def draw(results: Results) -> Any:
    """Paths found over the number of rays, and rates over the number of facets."""
    figure, (left, right) = figure_of(2)
    for axes, table, names in (
        (left, "rays", ("found", "without edges", "with an edge")),
        (right, "rooms", ("links a CPU second", "without edges")),
    ):
        for name, marker in zip(names, "os^", strict=False):
            own = [row for row in results.rows if (row["table"], row["name"]) == (table, name)]
            x = [float(row["row"].split()[0].replace(",", "")) for row in own]
            axes.plot(x, [row["value"] for row in own], f"{marker}-", label=name)
        axes.legend(fontsize="small")
    left.set(xscale="log", xlabel="rays of the transmitter", ylabel=f"paths within {RANGE_DB:g} dB found [%]")
    right.set(xscale="log", yscale="log", xlabel="facets", ylabel="links a CPU second")
    return figure
