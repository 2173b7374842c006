"""Radio tracing among triangles: how many of all paths rays find, and links a second of CPU over the number of facets.

Rooms are made of turned boxes and of balls, whose facets no two are parallel. Recall is the share of the paths of
exhaustive search within 40 dB of the strongest of their link that a search by rays finds, over the number of rays, and
at the default number in each room that exhaustive search gets through; no path that is found may be another. Rates are
of one transmitter, which is made ready first and counts, and one thread, by CPU time, with compiled code; latency is
that of one receiver more of a transmitter that is known.
"""

from collections.abc import Sequence
from time import process_time
from typing import Any, NamedTuple

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from matplotlib.figure import Figure
from rich.table import Table
from scipy.constants import speed_of_light
from scipy.spatial import cKDTree

from wireless.paths import Interaction, Paths
from wireless.tracing.scenes import SpaceScene
from wireless.tracing.tracer import Tracer, TracerConfig


class Room(NamedTuple):
    """What is in a room of 7 x 5 x 3 m3."""

    boxes: int
    """Boxes, six facets each."""
    balls: int
    """Balls."""
    divided: int
    """How often the 20 triangles of a ball are cut in four."""


#: From 66 facets to 102,520 in five steps.
ROOMS = Room(10, 0, 0), Room(34, 1, 2), Room(26, 2, 2), Room(20, 3, 3), Room(16, 5, 5)
#: Judged by exhaustive search.
JUDGED = Room(15, 1, 1)
RAYS = 100, 300, 1000, 3000, 10_000, 30_000, 100_000
#: Paths that are weaker than the strongest of their link by more do not count for recall [dB].
RANGE_DB = 40.0
SIZE_M = np.array([7.0, 5.0, 3.0])
#: Lengths and angles that differ by less are those of one path [m, rad].
_SAME = 1e-6
_ALONE = 40
#: Rooms of more facets are not judged by exhaustive search, which takes minutes there.
_MOST_JUDGED = 5000


def made(room: Room, seed: int) -> trimesh.Trimesh:
    """The mesh of a room; things stand below 1.9 m."""
    rng = np.random.default_rng(seed)
    parts = [trimesh.creation.box(bounds=np.array([np.zeros(3), SIZE_M]))]
    for _ in range(room.boxes):
        box = trimesh.creation.box(rng.uniform(0.3, 0.8, 3))
        box.apply_transform(trimesh.transformations.rotation_matrix(rng.uniform(0, 3), (0.1, 0.2, 1)))
        box.apply_translation(rng.uniform((0.8, 0.8, 0.5), (6.2, 4.2, 1.1)))
        parts.append(box)
    for _ in range(room.balls):
        ball = trimesh.creation.icosphere(subdivisions=room.divided, radius=rng.uniform(0.2, 0.5))
        ball.apply_translation(rng.uniform((0.8, 0.8, 0.6), (6.2, 4.2, 1.3)))
        parts.append(ball)
    whole = trimesh.util.concatenate(parts)
    assert isinstance(whole, trimesh.Trimesh)
    return whole


def compare(
    rooms: Sequence[Room] = ROOMS,
    judged: Room = JUDGED,
    *,
    receivers: int = 400,
    links: int = 20,
    seed: int = 0,
) -> dict[str, list[dict[str, Any]]]:
    """Rows of recall over the number of rays, and of rates over the number of facets.

    Args:
        rooms: What rates are measured in.
        judged: What recall is measured in.
        receivers: Receivers of rates.
        links: Links of recall.
        seed: Seed of rooms and places.
    """
    places = np.random.default_rng(seed).uniform((0.2, 0.2, 2.0), (6.8, 4.8, 2.8), (receivers + _ALONE, 3))
    return {
        "recall": _recall(made(judged, seed), places[:1], places[1 : 1 + links], RAYS),
        "speed": [_rates(made(room, seed), places[:1], places[1:]) for room in rooms],
    }


def _config(**options: Any) -> TracerConfig:
    """Two reflections, or an edge and one."""
    usual: dict[str, Any] = {"scene": "space", "search": "rays", "max_reflections": 2, "floor_ceiling": True}
    return TracerConfig(**usual | {"max_transmissions": 0} | options)


def _recall(
    mesh: trimesh.Trimesh,
    tx: Float[np.ndarray, "1 3"],
    rx: Float[np.ndarray, "r 3"],
    numbers: Sequence[int],
) -> list[dict[str, Any]]:
    """A row for each number of rays."""
    every = Tracer(mesh, config=_config(search="exhaustive", max_paths=5000)).trace(tx, rx)
    most = np.zeros(len(rx))
    np.maximum.at(most, every.link, every.power)
    strong = every.select(every.power > most[every.link] * 10 ** (-RANGE_DB / 10))
    rows = []
    for rays in numbers:
        tracer = Tracer(mesh, config=_config(rays=rays, max_paths=5000))
        begin = process_time()
        paths = tracer.trace(tx, rx, workers=1)
        found = _among(strong, paths)
        bent = (strong.interaction == Interaction.DIFFRACTION).any(axis=1)
        rows.append(
            {
                "rays": rays,
                "facets": _facets(tracer),
                "paths": len(strong.power),
                "recall": float(found.mean()),
                "recall_reflected": float(found[~bent].mean()),
                "recall_bent": float(found[bent].mean()),
                "false": int((~_among(paths, every)).sum()),
                "cpu_s": process_time() - begin,
            }
        )
    return rows


def _among(some: Paths, others: Paths) -> Bool[np.ndarray, " n"]:
    """Which of some paths are among others: of the same link, interactions, length and directions."""
    rows = []
    for paths in (some, others):
        bent = (paths.interaction == Interaction.DIFFRACTION).any(axis=1)
        numbers: tuple[Int[np.ndarray, " n"], ...] = (10 * paths.link, paths.order, bent)
        angles = paths.aod_az, paths.aoa_az, paths.aod_el, paths.aoa_el
        rows.append(np.column_stack([*numbers, paths.delay_s * speed_of_light, *angles]))
    off, _ = cKDTree(rows[1]).query(rows[0])
    return off < _SAME


def _facets(tracer: Tracer) -> int:
    """Facets of a mesh that is traced in space."""
    assert isinstance(tracer.scene, SpaceScene)
    return len(tracer.scene.space.mirrors)


def _rates(
    mesh: trimesh.Trimesh, tx: Float[np.ndarray, "1 3"], rx: Float[np.ndarray, "r 3"]
) -> dict[str, Any]:
    """Rates and latency in one room."""
    row: dict[str, Any] = {"triangles": len(mesh.faces)}
    for name, edges in (("links_per_cpu_s_no_edges", False), ("links_per_cpu_s", True)):
        begin = process_time()
        tracer = Tracer(mesh, config=_config(diffraction=edges))
        row |= {"facets": _facets(tracer), "prepare_s": process_time() - begin}
        tracer.trace(rx[:1], tx)
        many, alone = rx[:-_ALONE], rx[-_ALONE:]
        begin = process_time()
        tracer.trace(tx, many, workers=1)
        row[name] = len(many) / (process_time() - begin)
        times = []
        for one in alone:
            begin = process_time()
            tracer.trace(tx, one[None], workers=1)
            times.append(process_time() - begin)
        row["live_s"] = float(np.median(times))
    if row["facets"] <= _MOST_JUDGED:
        (judged,) = _recall(mesh, tx, rx[:-_ALONE], [TracerConfig().rays])
        row |= {key: judged[key] for key in ("paths", "recall", "false")}
    return row


def tables(report: dict[str, list[dict[str, Any]]]) -> tuple[Table, Table]:
    """What was measured, for people."""
    recall = Table(
        title="Among triangles: paths that rays find",
        caption=f"Of all paths within {RANGE_DB:g} dB of the strongest, in a room of "
        f"{report['recall'][0]['facets']} facets; up to two reflections, or an edge and one.",
        box=None,
        pad_edge=False,
    )
    for column in ("rays", "found", "without edges", "with an edge", "false"):
        recall.add_column(column, justify="right")
    for row in report["recall"]:
        shares = (f"{100 * row[key]:.2f} %" for key in ("recall", "recall_reflected", "recall_bent"))
        recall.add_row(f"{row['rays']:,}", *shares, str(row["false"]))
    speed = Table(
        title="Among triangles: rates and latency, one worker",
        caption="One transmitter, made ready first and counted; up to two reflections, or an edge and one. Found: at "
        f"the default number of rays, of all paths within {RANGE_DB:g} dB of the strongest.",
        box=None,
        pad_edge=False,
    )
    for column in (
        "facets",
        "prepare",
        "links/CPU s",
        "without edges",
        "one link more",
        "found",
        "of paths",
        "false",
    ):
        speed.add_column(column, justify="right")
    for row in report["speed"]:
        rates = (f"{row[key]:,.0f}" for key in ("links_per_cpu_s", "links_per_cpu_s_no_edges"))
        live = f"{1e3 * row['live_s']:.1f} ms"
        found = ["-"] * 3
        if "recall" in row:
            found = [f"{100 * row['recall']:.2f} %", f"{row['paths']:,}", str(row["false"])]
        speed.add_row(f"{row['facets']:,}", f"{row['prepare_s']:.2f} s", *rates, live, *found)
    return recall, speed


def plot(report: dict[str, list[dict[str, Any]]]) -> Figure:
    """Recall over rays, and rates over facets."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    rows = report["recall"]
    lines = {"recall": "all", "recall_reflected": "without edges", "recall_bent": "with an edge"}
    for (key, label), marker in zip(lines.items(), "os^", strict=True):
        left.plot([row["rays"] for row in rows], [100 * row[key] for row in rows], f"{marker}-", label=label)
    left.set(xscale="log", xlabel="rays of the transmitter", ylabel=f"paths within {RANGE_DB:g} dB found [%]")
    left.set_title(f"{rows[0]['facets']} facets")
    rows = report["speed"]
    for (key, label), marker in zip(
        {"links_per_cpu_s": "with edges", "links_per_cpu_s_no_edges": "without edges"}.items(),
        "os",
        strict=True,
    ):
        right.plot([row["facets"] for row in rows], [row[key] for row in rows], f"{marker}-", label=label)
    right.plot(
        [row["facets"] for row in rows],
        [1 / row["live_s"] for row in rows],
        "^--",
        label="one at a time, transmitter known",
    )
    right.set(xscale="log", yscale="log", xlabel="facets", ylabel="links per CPU second")
    for ax in (left, right):
        ax.grid(True, which="both", lw=0.3)
        ax.legend(fontsize="small")
    return figure
