"""Frames to train a mapper on: sensor data of a robot that explores generated homes, with the ground truth.

Each home is a shard, `home-00012.npz`, that depends on the seed and its number alone: any number of workers writes the
same bytes, an interrupted run is resumed, and the last homes can be held out. The robot explores as in an episode, with
the classical mapper and the frontier explorer; when it has seen everything it starts again in another place. So there
are early and late maps, seen from realistic places. Motion is kinematic, for speed. Targets stand in the homes as in
episodes; robots pass through them, and the ground truth does not contain them.

| array | shape, type | meaning |
|---|---|---|
| depth | (n, h, w) uint16 | measured depth [mm], 0 without a return |
| rgb | (n, h, w, 3) uint8 | picture |
| action | (n,) int8 | last action, -1 at the first frame of an episode |
| odometry | (n, 3) float32 | measured motion since the last frame: x, y [m], yaw [rad] |
| pose | (n, 3) float64 | true pose: x, y [m], yaw [rad] in `map` |
| estimate | (n, 3) float64 | pose of the classical mapper |
| belief | (n, 64, 64) uint8 | classical map ahead of the estimated pose after this frame: 255 times the probability |
| truth | (n, 3, 64, 8) uint8 | channels of `robosim.datasets.true_patch`, bits packed along the last axis |

"""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool
from rich.console import Console

from robosim.agent import Agent
from robosim.building.building import Building, make_building
from robosim.building.reach import reach
from robosim.camera.depth_noise import DepthNoise
from robosim.datasets.true_patch import TruePatches
from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.navigation import make_navigator
from robosim.policies.goals import Explore, PolicyContext
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from robosim.simulator import Observation, SimulatorConfig
from robosim.support.arrays_in import FAR, Array, read_npz
from robosim.support.checks import SEED, Range, checked
from robosim.support.files import npz_bytes, write_whole
from robosim.support.progress import unit_progress
from robosim.support.reading import reading
from robosim.support.run_folder import run_folder
from robosim.support.workers import Workers
from robosim.task.tasks import make_task
from robosim.world import ROBOT, World
from slam.actions import nearest_action
from slam.grid import MapEstimate
from slam.poses import Pose
from slam.sensing.egocentric import belief_ahead

#: Bytes of a shard, packed and unpacked.
MOST_SHARD_BYTES = 400_000_000
#: Least and largest height or width of a depth image.
_SIDES = (8, 4096)


def read_shard(path: Path, names: Sequence[str]) -> list[np.ndarray]:
    """Arrays of a shard; FileError if the file is not one."""
    with reading(
        path, "a shard of `robosim collect`", "Collect it again.", most_bytes=MOST_SHARD_BYTES
    ) as file:
        arrays = read_npz(file, {name: SHARD[name] for name in names}, most_bytes=MOST_SHARD_BYTES)
        frames, *size = arrays["depth"].shape if "depth" in arrays else (1, *_SIDES)
        if not (frames and _SIDES[0] <= min(size) and max(size) <= _SIDES[1]):
            raise ValueError(f"it has {frames} frames of {size[0]} x {size[1]} pixels")
    return [arrays[name] for name in names]


#: Arrays of a shard, as above.
SHARD = {
    "depth": Array("u2", "n h w"),
    "rgb": Array("u1", "n h w 3"),
    "action": Array("i1", "n"),
    "odometry": Array("f", "n 3", FAR),
    "pose": Array("f", "n 3", FAR),
    "estimate": Array("f", "n 3", FAR),
    "belief": Array("u1", "n 64 64"),
    "truth": Array("u1", "n 3 64 8"),
}
#: Walks that may end without a step, before a home is given up.
_RESTARTS = 20


@dataclass(frozen=True, kw_only=True)
@checked
class CollectConfig:
    """Which frames are collected."""

    homes: Annotated[int, Range(1, 100_000)] = 100
    """Homes, one shard each."""
    steps: Annotated[int, Range(1, 10_000, "frames")] = 300
    """Frames of each home."""
    seed: Annotated[int, SEED] = 0
    """Seed of homes and noise."""
    navigable: Annotated[float, Range(0, 1)] = 0.6
    """Share of homes in the form of the published grids, whose free cells are those where an agent may stand."""
    depth_noise: DepthNoise = field(default_factory=lambda: DepthNoise(level=1.0))
    """Noise of the depth camera."""
    noise: NoiseModel = field(default_factory=NoiseModel)
    """Noise of motion and odometry."""


def collect(
    config: CollectConfig, out: Path, *, workers: int, cluster: str | None = None, console: Console
) -> list[Path]:
    """Write the missing shards; returns the paths of all.

    Raises:
        FolderError: If the folder holds shards of another configuration, or another process works in it.
        WorkerLost: If a process was killed; the other homes are written first.
    """
    # More homes of the same kind may be added.
    settings = {key: value for key, value in asdict(config).items() if key != "homes"}
    with run_folder(out, "collect", settings) as folder:
        paths = [folder / f"home-{home:05d}.npz" for home in range(config.homes)]
        missing = [home for home, path in enumerate(paths) if not path.exists()]
        with (
            Workers(min(workers, len(missing) or 1), cluster, what="homes") as pool,
            unit_progress(console, "homes", len(paths), len(paths) - len(missing)) as advance,
        ):
            for number, shard in pool.run(_collect_shard, [(config, home) for home in missing]):
                write_whole(paths[missing[number]], shard)
                advance(paths[missing[number]].stem)
    return paths


def _collect_shard(config: CollectConfig, home: int) -> bytes:
    return npz_bytes(collect_home(home_building(config, home), config, seed=home))


def home_building(config: CollectConfig, home: int) -> Building:
    """The building of a home."""
    rng = np.random.default_rng([config.seed, home, 0])
    form = GeneratorConfig(navigable=bool(rng.random() < config.navigable))
    return make_building(generate_plan(int(rng.integers(1 << 31)), config=form))


def collect_home(building: Building, config: CollectConfig, *, seed: int) -> dict[str, np.ndarray]:
    """Explore one building; `seed` and that of the configuration seed all random numbers. Returns a shard's arrays."""
    robot = RobotConfig(noise=config.noise, depth_noise=config.depth_noise)
    settings = SimulatorConfig(physics="kinematic", robot=robot)
    places = reach(building, *robot.hull_m)
    truth = TruePatches(building, hfov_deg=settings.image.hfov_deg, height_m=robot.height_m)
    rng = np.random.default_rng([config.seed, seed, 1])
    rows: list[dict[str, Any]] = []
    with closing(World(building, {ROBOT: settings})) as world:
        for _ in range(_RESTARTS + config.steps):
            if len(rows) == config.steps:
                break
            navigator = make_navigator(settings)  # explores until everything is seen
            agent = Agent(navigator, Explore(PolicyContext(explorer=navigator.explorer)), robot)
            task = make_task(places, rng, min_path_m=1.0)
            sensed = world.reset({ROBOT: task}, rng)[ROBOT]
            agent.reset(task.start)
            while len(rows) < config.steps:
                estimate, pose = agent.observe(sensed), world.truth(ROBOT).pose
                rows.append(_row(sensed, estimate, pose, truth.at(pose)))
                if len(rows) < config.steps and (decision := agent.decide()) is not None:
                    sensed = world.step({ROBOT: decision.command})[ROBOT]
                else:
                    break
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


def _row(
    sensed: Observation, estimate: MapEstimate, pose: Pose, patch: Bool[np.ndarray, "3 ny nx"]
) -> dict[str, Any]:
    """Sensor data, estimates and ground truth of a frame."""
    return {
        "depth": np.minimum(np.rint(sensed.depth * 1000), 65535).astype(np.uint16),
        "rgb": sensed.rgb.copy(),
        "action": np.int8(-1 if sensed.action is None else nearest_action(sensed.action)),
        "odometry": sensed.odometry.astype(np.float32),
        "pose": pose,
        "estimate": estimate.pose,
        "belief": np.rint(255 * belief_ahead(estimate)).astype(np.uint8),
        "truth": np.packbits(patch, axis=-1),
    }
