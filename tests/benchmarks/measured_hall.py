"""Radio paths measured in a real hall at 60 GHz against traced ones: which mechanisms explain them, and how well.

The plan is the picture that the authors publish with their data: what is dark is wall, and its frame, where the plan
ends, reflects nothing. Posts are of metal. A traced path explains a measured one if delay and both azimuths agree
(`robosim.calibration.measured_paths`), and within 6 dB if its strength does, too.
Data: Kaltiokallio et al., Robust snapshot radio SLAM, 2024 (arXiv:2404.10291).
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Int
from PIL import Image
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import BuildingConfig, make_building
from robosim.calibration.material_fit import CURVED, EDGES, SPECULAR, residuals_db, rms_db, tracer_of
from robosim.calibration.measured_figure import draw_measured
from robosim.calibration.measured_paths import (
    MatchConfig,
    MeasuredHall,
    match,
    offset_db,
    read_measured_paths,
    trace_hall,
)
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.support.reading import reading
from slam.poses import wrap
from tests.benchmarks.harness import DEFAULT, Options, quartiles
from tests.benchmarks.results import Results
from wireless.em.materials import Layer, Material, wall_row
from wireless.paths import Interaction
from wireless.tracing.tracer import Tracer, TracerConfig

FREQUENCY_HZ = 60e9
#: What the authors turn the transmitter by [deg].
TURN_DEG = -1.6
#: Rows and columns of the picture's frame, its width on the ground, and the middle of its lower left corner [m].
ROWS, COLUMNS, WIDTH_M, CORNER_M = slice(2, 618), slice(2, 695), 18.0, (-7.0, -12.0)
#: Lines of the frame [cells].
FRAME = 3
#: Centres of the circles and how far they reach; ends, and half of the width, of the wall that joins two of them [m].
POSTS = np.array([(0.25, -4.29), (2.93, -4.39), (-5.46, -5.21), (-5.48, -6.86)])
POST_M, LOW_WALL, HALF_M = 0.24, np.array([(-7.0, -5.43), (0.25, -4.29)]), 0.25
#: From where to where the wall has a box in it, along x [m].
BOX_M = (-1.68, -1.08)
#: Strengths that differ by no more are the same [dB], and the range that strengths are compared in.
WITHIN_DB = 6.0
CLOSE, ANY = MatchConfig(strength_db=WITHIN_DB), MatchConfig()
#: Relative permittivities that are tried for walls.
PERMITTIVITIES = np.geomspace(4, 64, 17).round(1)
#: Coefficient of rough walls, and paths of a link then.
ROUGH = {"S = 0.2": 0.2, "S = 0.4": 0.4}
_MOST_ROUGH = 3000


def main(folder: Positional[Path], *, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Measured paths of a real hall that are explained, with one mechanism and one correction after the other.

    Args:
        folder: The data set: paths.csv, map.png.
        options: Of every benchmark.
    """
    results = Results()
    hall, drawn = read_measured_paths(folder / "paths.csv", math.radians(TURN_DEG)), read_plan(folder)
    bent = replace(EDGES, curved_walls=True)
    for row, kinds in {
        "direct paths": replace(SPECULAR, max_reflections=0),
        "and one reflection": replace(SPECULAR, max_reflections=1),
        "and two": SPECULAR,
        "and three": replace(SPECULAR, max_reflections=3),
        "two, and floor and ceiling": replace(SPECULAR, floor_ceiling=True),
        "two, and an edge with one": EDGES,
        "two, and posts and curved walls": CURVED,
    }.items():
        _add_explained(results, row, hall, drawn, "marble", kinds)
    hall = turned(hall, drawn)
    _add_explained(results, "and the receiver's heading", hall, drawn, "marble", CURVED)
    plan = read_plan(folder, low_wall=False)
    _add_explained(results, "and a low wall left out", hall, plan, "marble", CURVED)
    wall = _fit_walls(results, hall, plan)
    _add_explained(results, "and walls that fit", hall, plan, wall, CURVED)
    _add_explained(results, "and an edge with one", hall, plan, wall, bent)
    _add_strengths(results, hall, plan, wall, bent)
    _add_missing(results, hall, plan, wall, bent)
    building = make_building(plan, config=BuildingConfig(wall_material=wall))
    traced = trace_hall(hall, tracer_of(plan, wall, FREQUENCY_HZ, bent), ANY.height_m)
    draw_measured(
        hall, building, match(hall, traced, CLOSE), options.folder("measured_hall") / "measured.png"
    )
    for row, coefficient in ROUGH.items():
        rough = replace(CURVED, scattering=coefficient, max_paths=_MOST_ROUGH)
        _add_scattered(results, row, hall, plan, wall, rough)
    return options.finish("measured_hall", results)


def read_plan(folder: Path, low_wall: bool = True) -> FloorPlan:
    """The plan of the hall, with or without the wall that joins two posts but for what the map draws in it."""
    with reading(folder / "map.png", "a map") as file:
        dark = np.array(Image.open(file).convert("L"))[ROWS, COLUMNS][::-1] < 128
    cell_m = WIDTH_M / (dark.shape[1] - FRAME)
    corner = np.array(CORNER_M) - FRAME / 2 * cell_m
    xy = corner + (np.stack(np.meshgrid(*map(np.arange, dark.shape[::-1])), axis=-1) + 0.5) * cell_m
    post = (np.linalg.norm(xy[:, :, None] - POSTS, axis=-1) < POST_M).any(axis=-1)
    if not low_wall:
        along = np.diff(LOW_WALL, axis=0)[0] / np.linalg.norm(np.diff(LOW_WALL, axis=0))
        off = (xy - LOW_WALL[0]) @ [-along[1], along[0]]
        is_bare = (xy[..., 0] < BOX_M[0]) | (xy[..., 0] > BOX_M[1])
        dark &= ~((np.abs(off) < HALF_M) & (xy[..., 0] < LOW_WALL[1, 0]) & is_bare & ~post)
    material = np.where(dark & post, 2, 0).astype(np.uint8)
    frame = np.ones(dark.shape, bool)
    frame[FRAME:-FRAME, FRAME:-FRAME] = False
    material[frame] = 1
    return FloorPlan(
        occupancy=np.where(dark | frame, OCCUPIED, FREE).astype(np.uint8),
        resolution_m=cell_m,
        origin=(*corner.tolist(), 0.0),
        name="hall",
        material=material,
        materials=("vacuum", "metal"),
    )


def turned(hall: MeasuredHall, plan: FloorPlan) -> MeasuredHall:
    """The same with all headings of the receiver turned by one angle, the median over direct paths."""
    tracer = tracer_of(plan, "marble", FREQUENCY_HZ, replace(SPECULAR, max_reflections=0))
    table = hall.table.copy()
    direct = table[match(hall, trace_hall(hall, tracer, ANY.height_m), ANY).order == 0]
    to_tx = np.arctan2(*(direct[:, 1:3] - direct[:, 4:6]).T[::-1])
    table[:, 6] -= np.median(wrap(direct[:, 6] + direct[:, 9] - to_tx))
    return replace(hall, table=table)


def half_space(permittivity: float) -> Material:
    """A material of so great a thickness and loss that nothing of its far side returns."""
    return Material(
        "wall", (Layer(thickness_m=0.5, relative_permittivity=float(permittivity), conductivity_spm=1.0),)
    )


def _add_explained(
    results: Results,
    row: str,
    hall: MeasuredHall,
    plan: FloorPlan,
    wall: str | Material,
    kinds: TracerConfig,
) -> None:
    """Add shares of paths and of power that are explained, with any strength and within 6 dB."""
    assert hall.power_db is not None
    paths = trace_hall(hall, tracer_of(plan, wall, FREQUENCY_HZ, kinds), ANY.height_m)
    power = 10 ** (hall.power_db / 10)
    for name, config in (("", ANY), (f" within {WITHIN_DB:.0f} dB", CLOSE)):
        found = match(hall, paths, config)
        shares = {
            "paths": found.explained.mean(),
            "by chance": found.by_chance,
            "power": power[found.explained].sum() / power.sum(),
        }
        for column, share in shares.items():
            results.add("hall", row, column + name, 100 * float(share), "%", digits=1, cases=len(power))


def _fit_walls(results: Results, hall: MeasuredHall, plan: FloorPlan) -> Material:
    """The permittivity that fits best at every other place; its errors there and at the others are added."""
    fitted = np.unique(hall.table[:, 0], return_inverse=True)[1] % 2 == 0

    def errors_db(wall: str | Material) -> tuple[float, float]:
        paths = trace_hall(hall, tracer_of(plan, wall, FREQUENCY_HZ, CURVED), ANY.height_m)
        off = residuals_db(hall, match(hall, paths, ANY))
        return rms_db(off[fitted]), rms_db(off[~fitted])

    best = min(PERMITTIVITIES, key=lambda one: errors_db(half_space(one))[0])
    walls: dict[str, str | Material] = {"marble": "marble", "fitted": half_space(best)}
    for row, wall in walls.items():
        permittivity = wall_row("marble", FREQUENCY_HZ)[0].real if row == "marble" else float(best)
        results.add("walls", row, "relative permittivity", permittivity, digits=1)
        for name, error in zip(("at fitted places", "at the others"), errors_db(wall), strict=True):
            results.add("walls", row, f"error of reflections, RMS, {name}", error, "dB", digits=1)
    return half_space(best)


def _add_strengths(
    results: Results, hall: MeasuredHall, plan: FloorPlan, wall: Material, kinds: TracerConfig
) -> None:
    """Add how much stronger paths are than traced, by mechanism."""
    tracer = tracer_of(plan, wall, FREQUENCY_HZ, kinds)
    paths = trace_hall(hall, tracer, ANY.height_m)
    no_edges = paths.select(~(paths.interaction == Interaction.DIFFRACTION).any(axis=1))
    curves = _curved_walls(tracer)
    for some, is_edge in ((no_edges, False), (paths, True)):
        found = match(hall, some, ANY)
        off = np.asarray(hall.power_db) - found.traced_db - offset_db(hall, found)
        curved = found.explained & np.isin(some.primitive[found.path], curves).any(axis=1)
        flat = found.explained & ~curved
        rows = {
            "direct": flat & (found.order == 0),
            "one reflection": flat & (found.order == 1),
            "two reflections": flat & (found.order == 2),
            "a post or curved wall": curved & (found.order == 1),
            "and a reflection": curved & (found.order == 2),
        }
        for row, which in ({"an edge": found.diffracted} if is_edge else rows).items():
            _add_strength(results, "strength", row, off[which])


def _add_missing(
    results: Results, hall: MeasuredHall, plan: FloorPlan, wall: Material, kinds: TracerConfig
) -> None:
    """Add where the power is that is not explained within 6 dB, and reflections over those of a perfect mirror.

    A perfect mirror is exact images without loss: no flat wall of any material reflects more.
    """
    tracer = tracer_of(plan, wall, FREQUENCY_HZ, kinds)
    paths = trace_hall(hall, tracer, ANY.height_m)
    alike, close = match(hall, paths, ANY), match(hall, paths, CLOSE)
    power_db = np.asarray(hall.power_db)
    share = 10 ** (power_db / 10) / (10 ** (power_db / 10)).sum()
    missing = ~close.explained
    strongest = np.zeros(len(share), bool)
    strongest[np.argmax(np.where(missing, share, 0))] = True
    for row, which in {
        "all": missing,
        "a traced path, with another strength": missing & alike.explained,
        "no traced path": missing & ~alike.explained,
        "the strongest path alone": strongest,
    }.items():
        results.add(
            "missing", row, "power", 100 * float(share[which].sum()), "%", digits=1, cases=int(which.sum())
        )
    over_mirror_db = power_db + 20 * np.log10(hall.table[:, 7])
    over_mirror_db -= np.median(over_mirror_db[alike.order == 0])
    is_curved = np.isin(paths.primitive, _curved_walls(tracer)).any(axis=1)
    single = alike.explained & (alike.order == 1) & ~alike.diffracted & ~is_curved[alike.path]
    for row, values in (
        ("flat walls, one reflection", over_mirror_db[single]),
        ("the strongest path alone", over_mirror_db[strongest]),
    ):
        middle, spread = quartiles(values)
        results.add(
            "mirrors", row, "over a perfect mirror", middle, "dB", digits=1, cases=len(values),
            spread=spread if len(values) > 1 else None,
        )  # fmt: skip
        above = 100 * float((values > 0).mean())
        results.add("mirrors", row, "above a perfect mirror", above, "%", digits=0)


def _curved_walls(tracer: Tracer) -> Int[np.ndarray, " n"]:
    """Faces that belong to posts and curved walls."""
    assert tracer._curved is not None
    return np.concatenate([arc.walls for arc in tracer._curved.arcs])


def _add_strength(results: Results, table: str, row: str, off_db: np.ndarray) -> None:
    """Add the median and quartiles of measured over traced strength."""
    low, middle, high = np.quantile(off_db, (0.25, 0.5, 0.75))
    results.add(
        table, row, "measured over traced", middle, "dB", digits=1, spread=(low, high), cases=len(off_db)
    )
    results.add(table, row, "within 6 dB", 100 * float((np.abs(off_db) <= WITHIN_DB).mean()), "%", digits=0)


def _add_scattered(
    results: Results, row: str, hall: MeasuredHall, plan: FloorPlan, wall: Material, kinds: TracerConfig
) -> None:
    """Add how much stronger paths are than what rough walls scatter in their directions."""
    paths = trace_hall(hall, tracer_of(plan, wall, FREQUENCY_HZ, kinds), ANY.height_m)
    found = match(hall, paths, ANY)
    off = np.asarray(hall.power_db) - found.traced_db - offset_db(hall, found)
    _add_strength(
        results,
        "scattering",
        row,
        off[found.explained & (paths.interaction[found.path, 0] == Interaction.SCATTERING)],
    )
