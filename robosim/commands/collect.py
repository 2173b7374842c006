"""`robosim collect`, `robosim collect-searches`."""

from pathlib import Path
from shlex import quote
from typing import Literal

from tyro.conf import OmitArgPrefixes

from robosim.commands.speaking import console, tell
from robosim.commands.terminal import (
    ALL_CORES,
    WorkOptions,
    folder_for,
    going_on,
)
from robosim.support.installation import install_first
from wireless.support.counting import counted


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
    console.print(f"Wrote {counted(len(shards), 'home')} of {counted(steps, 'frame')} each in {folder}")
    console.print(f"Next: {install_first('torch')}robosim train mapper --data {quote(str(folder))}")


def collect_searches(
    *,
    plan: str = "homes:100",
    episodes: int = 100,
    observe: tuple[Literal["rgb", "depth", "lidar", "odometry", "radio", "map", "pose"], ...] = (
        "depth",
        "odometry",
        "radio",
        "pose",
    ),
    driver: Literal["way", "random"] = "way",
    stray: float = 0.1,
    targets: int = 4,
    most_steps: int = 1000,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Collect searches to learn from: trajectories with all that is observed, as a Minari data set.

    An interrupted run goes on when the command is given again, and more searches may be added later. Needs
    the extra `minari`.

    Example: robosim collect-searches --plan flat --episodes 20 --out out/searches

    Args:
        plan: Where plans come from: a name, file, folder, suite, or homes:500 for so many invented homes.
        episodes: Searches.
        observe: What is kept of each step.
        driver: way follows the shortest drive on the true map; random goes forward three times of five.
        stray: Chance that the way's driver does any action instead.
        targets: Places of each plan that targets are drawn from, each with a table of radio.
        most_steps: Steps after which a search is given up.
        seed: Seed of the first search; the next has the next number.
        out: Folder for the data set, and to go on from; a new one under runs/ if not given.
    """
    from robosim.environments.collect import CollectSearchesConfig
    from robosim.environments.collect import collect_searches as collect_them

    config = CollectSearchesConfig(
        plan=plan,
        episodes=episodes,
        observe=observe,
        driver=driver,
        stray=stray,
        targets=targets,
        most_steps=most_steps,
        seed=seed,
    )
    folder = folder_for(out, "collect-searches")
    with going_on(folder):
        data = collect_them(config, folder, console)
    tell({"searches": episodes, "data": str(data)}, folder)
    console.print(f"Wrote {counted(episodes, 'search', 'searches')} in {folder}")
    console.print(f"Next, in Python: minari.MinariDataset({str(data)!r})")
