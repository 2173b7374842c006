"""Cameras compared: frames per second against error of the depth.

All draw the same shaded building from the same poses; see `tests.benchmarks.race` for how they are timed and
`tests.benchmarks.true_depth` for the judge, which is itself checked against a plain loop over all triangles. Errors
are those of pixels that are not at a silhouette, where a hair decides what is seen. Cameras that cannot work on a
machine, for want of OSMesa or EGL say, are left out, each with its reason.
"""

import os
import platform
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Float
from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from robosim.building.building import Building, make_building
from robosim.camera.model import CameraConfig, camera_pose
from robosim.camera.rendering.gl_systems import missing
from robosim.camera.rendering.shading import shaded_mesh
from robosim.plans.files import read_plan
from robosim.support.assets import shipped_plans
from robosim.support.figures import save_figure
from robosim.support.files import write_json
from tests.benchmarks.peers import PEERS
from tests.benchmarks.race import Heat, Result, race
from tests.benchmarks.true_depth import DepthJudge, plain_depth

#: The camera that the others are compared with: of each kind of picture the first of these that works.
OURS = {
    "rgb+depth": ("pyrender", "pyrender-egl", "embree"),
    "depth": ("pyrender-depth", "pyrender-depth-egl", "embree-depth"),
}
#: What cameras promise: 1 mm + 0.1 %.
_ABSOLUTE_M, _RELATIVE = 1e-3, 1e-3
_CLEARANCE_M = 0.2


@dataclass(frozen=True, kw_only=True)
class Row:
    """One camera at one size."""

    camera: str
    images: str
    """What it takes: "rgb+depth" or "depth"."""
    size_px: int
    frames_per_s: float = np.nan
    """Median over the turns."""
    ours_faster: float = np.nan
    """How many times as many frames robosim takes of the same images; median of the ratios of turns."""
    cpu_ms: float = np.nan
    """Processor time of a picture, which other work on the machine changes little; median over the turns."""
    ours_cheaper: float = np.nan
    """How many times less processor time robosim takes for the same images; ratio of the medians."""
    mean_error_mm: float = np.nan
    max_error_mm: float = np.nan
    beyond: float = np.nan
    """Share of pixels whose depth is off by more than 1 mm + 0.1 %."""
    trouble: str = ""
    """Why it took no pictures, if so."""


def run(
    building: Building | None = None,
    *,
    sizes: Sequence[int] = (128, 256),
    out: Path,
    peers: Sequence[str] = tuple(PEERS),
    warm_up: int = 1200,
    turns: int = 9,
    turn_s: float = 0.2,
    n_poses: int = 32,
) -> Table:
    """Time the cameras, and write `render.json` and `render.png`.

    Args:
        building: What is drawn; the shipped flat if not given.
        sizes: Widths of the square pictures [pixels].
        out: Folder for the files.
        peers: Which cameras, by the names of `tests.benchmarks.peers`.
        warm_up: Pictures that each takes before its time counts.
        turns: How often each has its turn.
        turn_s: How long a turn lasts, about [s].
        n_poses: From how many poses pictures are taken.

    Returns:
        A table of the results, and below it what was left out.

    Raises:
        RuntimeError: If none of the cameras took a picture.
    """
    building = building or make_building(read_plan(shipped_plans()["flat"]))
    mesh = shaded_mesh(building)
    rows: list[Row] = []
    for size in sizes:
        config = CameraConfig(width=size, height=size)
        heat = Heat(mesh, random_views(building, config, n_poses), config)
        with tempfile.TemporaryDirectory() as folder:
            names = _with_ours(peers)
            results = race(heat, names, Path(folder), warm_up=warm_up, turns=turns, turn_s=turn_s)
        rows += _rows(results, heat, DepthJudge(building.mesh, config))
    about = {
        "plan": building.plan.name,
        "free_m2": building.free.area,
        "triangles": len(mesh.faces),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "judge_error_m": judge_error_m(building),
    }
    out.mkdir(parents=True, exist_ok=True)
    write_json(out / "render.json", {**about, "rows": [asdict(row) for row in rows]})
    if all(row.trouble for row in rows):
        raise RuntimeError(f"No camera took a picture. {_left_out(rows)}")
    _plot(rows, out / "render.png")
    return _table(rows, f"{about['plan']}: {len(mesh.faces)} triangles, {about['machine']}")


def random_views(building: Building, config: CameraConfig, count: int) -> Float[np.ndarray, "n 4 4"]:
    """Camera poses spread over the free floor, always the same ones, not too close to walls."""
    rng = np.random.default_rng(0)
    inside = building.free.buffer(-_CLEARANCE_M)
    if inside.is_empty:
        inside = building.free
    x0, y0, x1, y1 = inside.bounds
    views: list[np.ndarray] = []
    while len(views) < count:
        draws = rng.uniform((x0, y0, -np.pi), (x1, y1, np.pi), (256, 3))
        here = shapely.contains_xy(inside, draws[:, 0], draws[:, 1])
        views += [camera_pose(pose, config) for pose in draws[here]]
    return np.array(views[:count])


def judge_error_m(building: Building, n_rays: int = 100) -> float:
    """Largest difference between the judge and trying all triangles, over some pixels of one view [m]."""
    config = CameraConfig(width=64, height=64)
    T_map_camera = random_views(building, config, 1)[0]
    view = DepthJudge(building.mesh, config).look(T_map_camera)
    some = np.linspace(0, view.depth.size - 1, n_rays).astype(int)
    some = some[view.sure.ravel()[some]]
    rays = config.directions().reshape(-1, 3)[some] @ T_map_camera[:3, :3].T
    exact = plain_depth(building.mesh, T_map_camera[:3, 3], rays)
    return float(np.abs(view.depth.ravel()[some] - exact).max())


def _with_ours(peers: Sequence[str]) -> list[str]:
    """Names of cameras in the order of `PEERS`; with one of ours, if none was named, to compare them with."""
    unknown = [name for name in peers if name not in PEERS]
    if unknown:
        raise ValueError(f"peers has {unknown[0]!r}, expected names among {', '.join(PEERS)}.")
    there = {name for name, peer in PEERS.items() if not (peer.system and missing(peer.system))}
    kinds = {PEERS[name].images for name in peers}
    ours = [[name for name in OURS[kind] if name in there] for kind in kinds]
    added = {able[0] for able in ours if not set(able) & set(peers)}
    return sorted(set(peers) | added, key=list(PEERS).index)


def _rows(results: list[Result], heat: Heat, judge: DepthJudge) -> list[Row]:
    truth = [judge.look(T) for T in heat.poses]
    depth, sure = np.stack([view.depth for view in truth]), np.stack([view.sure for view in truth])
    able = {result.name: result for result in results if not result.trouble}
    rows = []
    for result in results:
        peer = PEERS[result.name]
        row = Row(camera=peer.label, images=peer.images, size_px=heat.config.width, trouble=result.trouble)
        if result.trouble:
            rows.append(row)
            continue
        # Where none of ours works, a camera is compared with itself.
        ours = next((able[name] for name in OURS[peer.images] if name in able), result)
        error = np.abs(result.depth - depth)[sure]
        rows.append(
            replace(
                row,
                frames_per_s=float(1 / np.median(result.seconds)),
                ours_faster=float(np.median(result.seconds / ours.seconds)),
                cpu_ms=float(1e3 * np.median(result.cpu_s)),
                ours_cheaper=float(np.median(result.cpu_s) / np.median(ours.cpu_s)),
                mean_error_mm=float(1e3 * error.mean()),
                max_error_mm=float(1e3 * error.max()),
                beyond=float((error > _ABSOLUTE_M + _RELATIVE * depth[sure]).mean()),
            )
        )
    return rows


def _table(rows: list[Row], title: str) -> Table:
    caption = (
        "ours: how many times as fast robosim takes the same images, by the clock and by processor time. "
        "Errors of depth against exact ray casting, away from silhouettes."
    )
    if any(row.trouble for row in rows):
        caption += f"\n{_left_out(rows)}"
    table = Table(title=Text(title, "table.title"), caption=caption)
    for column in ("camera", "images"):
        table.add_column(column)
    for column in (
        "size",
        "frames/s",
        "ours",
        "CPU ms",
        "ours",
        "mean error",
        "max error",
        "beyond 1 mm + 0.1 %",
    ):
        table.add_column(column, justify="right")
    for row in rows:
        if row.trouble:
            continue
        table.add_row(
            row.camera,
            row.images,
            str(row.size_px),
            f"{row.frames_per_s:,.0f}",
            f"{row.ours_faster:.1f} x",
            f"{row.cpu_ms:.2f}",
            f"{row.ours_cheaper:.1f} x",
            f"{row.mean_error_mm:.4f} mm",
            f"{row.max_error_mm:.3f} mm",
            f"{100 * row.beyond:.3f} %",
        )
    return table


def _left_out(rows: list[Row]) -> str:
    """Which cameras took no pictures, and why, reason by reason."""
    cameras: dict[str, dict[str, None]] = {}
    for row in rows:
        if row.trouble:
            cameras.setdefault(row.trouble, {})[row.camera] = None
    return "\n".join(f"Left out: {'; '.join(names)}. {reason}" for reason, names in cameras.items())


def _plot(rows: list[Row], path: Path) -> None:
    """Draw error over speed; better is down and to the right."""
    figure = Figure(figsize=(10, 5), layout="constrained")
    axes = figure.subplots()
    shown = [row for row in rows if not row.trouble]
    markers = dict(zip(sorted({row.size_px for row in shown}), "osD^v*", strict=False))
    kinds = list(dict.fromkeys((row.camera, row.images) for row in shown))
    for number, kind in enumerate(kinds):
        points = [row for row in shown if (row.camera, row.images) == kind]
        x, y = [row.frames_per_s for row in points], [row.max_error_mm for row in points]
        axes.plot(x, y, "-", color=f"C{number}", lw=0.8, label=", ".join(kind))
        for row in points:
            axes.plot(row.frames_per_s, row.max_error_mm, markers[row.size_px], color=f"C{number}")
    for size, marker in markers.items():
        axes.plot([], [], marker, color="0.5", label=f"{size} x {size} pixels")
    axes.set(xscale="log", yscale="log", xlabel="frames per second", ylabel="largest error of depth [mm]")
    axes.grid(True, which="both", lw=0.3)
    figure.legend(fontsize="x-small", loc="outside right upper")
    save_figure(figure, path)
