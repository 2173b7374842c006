"""`robosim collect`."""

from pathlib import Path
from shlex import quote

from tyro.conf import OmitArgPrefixes

from robosim.commands.speaking import console, tell
from robosim.commands.terminal import (
    ALL_CORES,
    WorkOptions,
    folder_for,
    going_on,
)


def collect(
    *,
    homes: int = 400,
    seed: int = 0,
    steps: int = 120,
    depth_noise: float = 1.0,
    noise: float = 1.0,
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Collect frames to train a mapper on: a robot explores made homes; the truth is kept beside what it senses.

    One file a home, the same for any number of workers. An interrupted run goes on when the command is given again,
    and more homes may be added later.

    Example: robosim collect --homes 400 --out out/frames

    Args:
        homes: Number of homes.
        seed: Seed of homes and noise.
        steps: Frames of each home.
        depth_noise: Level of the depth camera's noise: 0 none, 1 as published for a Kinect.
        noise: Level of actuation and odometry noise: 0 none, 1 as published for LoCoBot.
        work: Who does the work.
        out: Folder for the files, and to go on from; a new one under runs/ if not given.
    """
    from robosim.camera.depth_noise import DepthNoise
    from robosim.datasets.collect import CollectConfig
    from robosim.datasets.collect import collect as collect_frames
    from robosim.robot.odometry import NoiseModel

    config = CollectConfig(
        homes=homes,
        steps=steps,
        seed=seed,
        depth_noise=DepthNoise(level=depth_noise),
        noise=NoiseModel(level=noise),
    )
    folder = folder_for(out, "collect")
    with going_on(folder):
        shards = collect_frames(config, folder, workers=work.count, cluster=work.cluster, console=console)
    tell({"homes": len(shards), "steps": steps, "files": [path.name for path in shards]}, folder)
    console.print(f"Wrote {len(shards)} homes of {steps} frames each in {folder}")
    console.print(f"Next: robosim train mapper --data {quote(str(folder))}")
