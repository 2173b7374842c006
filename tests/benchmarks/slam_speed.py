"""Mapping: speed against error, over the size of depth images and over networks.

A walk by the classical map is recorded: true poses, actions, odometry. Each mapper then gets the same walk, with depth
images rendered from the true poses at each size and noise drawn anew from the same seed. Told are the median CPU
time of an update, the overlap of obstacles in view with the truth, and the pose error.
"""

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import matplotlib.pyplot as plt
import numpy as np
from rich.console import Console
from rich.table import Table

from robosim.building.building import Building, make_building
from robosim.building.reach import reach
from robosim.camera.cameras import make_camera
from robosim.camera.depth_noise import DepthNoise
from robosim.camera.model import CameraConfig, camera_pose
from robosim.camera.rendering.shading import shaded_mesh
from robosim.datasets.true_patch import MATTERS, OBSTACLE, SEEN, TruePatches
from robosim.episode import Decision, run_episode
from robosim.navigation import make_navigator
from robosim.parts import MAPPER
from robosim.plans.files import read_plan
from robosim.support.checks import SIZE_PX, Range, checked
from robosim.support.figures import save_figure
from robosim.support.files import write_json
from robosim.support.progress import told_units
from robosim.support.text_in import read_json
from robosim.support.workers import Workers
from robosim.task.record import EpisodeLog
from slam.actions import Action
from slam.grid import MapEstimate
from slam.mapping.classical import Mapper
from slam.mapping.neural import NeuralMapper
from slam.networks.scores import PatchScores
from slam.sensing.egocentric import belief_ahead, egocentric_map
from tests.benchmarks.slam_plan import EVERY, SlamSettings, told_ahead


@dataclass(frozen=True, kw_only=True)
@checked
class SpeedSettings:
    """What is compared."""

    sizes: Annotated[tuple[int, ...], SIZE_PX] = (64, 96, 128, 192, 256)
    """Widths of the square depth images [pixels]."""
    mappers: tuple[str, ...] = ()
    """Other networks, .safetensors files, at the size of 128."""
    plans: Annotated[int, Range(1, 10_000)] = 4
    """Plans that are used, the first ones."""
    frames: Annotated[int, Range(1, 100_000)] = 150
    """Frames of each."""

    def __post_init__(self) -> None:
        for mapper in self.mappers:
            MAPPER.check("others", mapper)


def speeds(
    plans: Sequence[str | Path],
    speed: SpeedSettings,
    settings: SlamSettings,
    *,
    workers: int,
    out: Path,
    console: Console,
) -> list[dict[str, Any]]:
    """Measure, draw `speed.png`, and return a row for each mapper and size.

    Args:
        plans: Files of floor plans.
        speed: What is compared.
        settings: Seed and noise.
        workers: Processes at once; times suffer where there are more than cores.
        out: Folder for the files.
        console: Where progress is shown.
    """
    calls = [(path, speed, settings, Path(out)) for path in plans[: speed.plans]]
    parts: list[list[dict[str, Any]]] = []
    with (
        Workers(min(workers, len(calls) or 1), what="plans") as pool,
        told_units(console, "plans for speed", len(calls)) as tell,
    ):
        for _, part in pool.run(_of_plan, calls):
            parts.append(part)
            tell("")
    rows = []
    for own in zip(*sorted(parts, key=lambda part: str(part[0]["plan"])), strict=True):
        score = PatchScores()
        for row in own:
            score.merge(PatchScores.of_counts(row["counts"]))
        rows.append(
            {
                **{key: own[0][key] for key in ("mapper", "size", "parameters")},
                "ms": float(np.median([row["ms"] for row in own])),
                "pose_error_m": float(np.median([row["pose_error_m"] for row in own])),
                "frames": sum(row["frames"] for row in own),
                **{key: value for key, value in score.result().items() if key.startswith("iou")},
            }
        )
    _plot(rows, out / "speed.png")
    return rows


def speed_table(rows: list[dict[str, Any]]) -> Table:
    """A row for each mapper and size."""
    table = Table(title="Speed against error", caption=f"{rows[0]['frames']} frames each")
    table.add_column("mapper")
    for name in ("depth image [px]", "parameters", "CPU ms a frame", "in view: IoU", "hidden: IoU"):
        table.add_column(name, justify="right")
    table.add_column("pose error [mm]", justify="right")
    for row in rows:
        table.add_row(
            row["mapper"],
            str(row["size"]),
            f"{row['parameters']:,}" if row["parameters"] else "-",
            f"{row['ms']:.2f}",
            f"{row['iou_seen']:.3f}",
            f"{row['iou_hidden']:.3f}",
            f"{1000 * row['pose_error_m']:.0f}",
        )
    return table


def _of_plan(
    path: str | Path, speed: SpeedSettings, settings: SlamSettings, out: Path
) -> list[dict[str, Any]]:
    """Rows of one plan, read from their file if they were measured with the same settings."""
    plan = read_plan(path)
    told = json.loads(json.dumps({"speed": asdict(speed), "settings": asdict(settings)}))
    file = out / "speed" / f"{plan.name}.json"
    if file.exists():
        kept = read_json(file, "speeds of mappers", "Delete it to measure again.", keys=("told", "rows"))
        if kept["told"] == told:
            rows: list[dict[str, Any]] = kept["rows"]
            return rows
    building = make_building(plan)
    walk = _Walk(building, settings, speed.frames)
    variants = [("classical", size) for size in speed.sizes]
    variants += [(settings.mapper, size) for size in speed.sizes]
    variants += [(name, CameraConfig().width) for name in speed.mappers]
    images = {size: walk.depths(size) for size in dict.fromkeys(size for _, size in variants)}
    rows = [{"plan": plan.name, **walk.scores(name, size, images[size])} for name, size in variants]
    write_json(file, {"told": told, "rows": rows})
    return rows


class _Walk:
    """A recorded walk, to be gone again with other eyes."""

    def __init__(self, building: Building, settings: SlamSettings, frames: int) -> None:
        self._building, self._settings = building, settings
        robot = settings.simulator.robot
        places = reach(building, robot.radius_m, robot.height_m)
        self._task = settings.task(places, building.plan.name)
        self._frames: list[tuple[np.ndarray, np.ndarray, Action | None]] = []

        def record(log: EpisodeLog, decision: Decision) -> None:
            self._frames.append((decision.pose.copy(), decision.view.odometry.copy(), decision.before))

        config = replace(settings.episode("classical", building.plan.name), max_steps=frames)
        run_episode(building, places, self._task, config, record)
        truth = TruePatches(building, height_m=robot.height_m)
        self._truth = [truth.at(pose) for pose, _, _ in self._frames[::EVERY]]

    def depths(self, size: int) -> list[np.ndarray]:
        """Noisy depth images of a size along the way."""
        image = CameraConfig(width=size, height=size)
        noise, rng = DepthNoise(level=self._settings.depth_noise), np.random.default_rng(self._settings.seed)
        camera = make_camera([shaded_mesh(self._building)], image)
        try:
            frames = (camera.render(camera_pose(pose, image)) for pose, _, _ in self._frames)
            return [noise.apply(frame.depth, float(image.focal_px), rng) for frame in frames]
        finally:
            camera.close()

    def scores(self, name: str, size: int, depths: list[np.ndarray]) -> dict[str, Any]:
        """What a mapper makes of them."""
        image = CameraConfig(width=size, height=size)
        mapper = make_navigator(replace(self._settings.simulator, image=image), mapper=name).mapper
        mapper.reset(self._task.start)
        score, seconds, errors = PatchScores(), [], []
        for k, (depth, (pose, odometry, action)) in enumerate(zip(depths, self._frames, strict=True)):
            begin = time.process_time()
            estimate = mapper.update(depth, action, odometry)
            seconds.append(time.process_time() - begin)
            errors.append(float(np.hypot(*(estimate.pose - pose)[:2])))
            if k % EVERY == 0:
                patch = self._truth[k // EVERY]
                score.add(_told(mapper, estimate, depth), patch[OBSTACLE], patch[SEEN], patch[MATTERS])
        return {
            "mapper": _short(name),
            "size": size,
            "parameters": mapper.network.parameters if isinstance(mapper, NeuralMapper) else 0,
            "frames": len(self._frames),
            "ms": 1000 * float(np.median(seconds)),
            "pose_error_m": float(np.median(errors)),
            "counts": score.counts(),
        }


def _told(mapper: Mapper, estimate: MapEstimate, depth: np.ndarray) -> np.ndarray:
    """What a mapper says of the patch ahead, in the way that suits it best."""
    if isinstance(mapper, NeuralMapper):
        return told_ahead(mapper, estimate, depth)["network"]
    return np.where(egocentric_map(estimate)[0], 1.0, np.minimum(belief_ahead(estimate), 0.5))


def _short(name: str) -> str:
    return Path(name).parent.name if name.endswith(".safetensors") else name


def _plot(rows: list[dict[str, Any]], path: Path) -> None:
    """Overlap and pose error over time; sizes of one mapper are joined."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
    for name in dict.fromkeys(row["mapper"] for row in rows):
        own = [row for row in rows if row["mapper"] == name]
        ms = [row["ms"] for row in own]
        label = f"{name}, {own[0]['parameters']:,} parameters" if own[0]["parameters"] else name
        left.plot(ms, [row["iou_seen"] for row in own], "o-", label=label)
        right.plot(ms, [1000 * row["pose_error_m"] for row in own], "o-", label=label)
        for row in own:
            left.annotate(str(row["size"]), (row["ms"], row["iou_seen"]), fontsize=7)
            right.annotate(str(row["size"]), (row["ms"], 1000 * row["pose_error_m"]), fontsize=7)
    left.set(xlabel="median processor time of an update [ms]", ylabel="IoU of obstacles in view")
    right.set(xlabel="median processor time of an update [ms]", ylabel="median pose error [mm]")
    left.set_title("numbers: width of the depth image [px]", fontsize=9)
    for ax in (left, right):
        ax.grid(alpha=0.3)
        ax.legend(fontsize=7)
    save_figure(figure, path)
