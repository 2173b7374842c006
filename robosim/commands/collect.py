"""`robosim collect` and `robosim collect-searches`."""

from pathlib import Path
from shlex import quote

from tyro.conf import OmitArgPrefixes

from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import ALL_CORES, Work, output_folder, resume_hint
from robosim.environments.collect import CollectSearchesConfig
from robosim.environments.collect import collect_searches as collect_data_set
from robosim.support.installation import install_first
from wireless.support.counting import counted

_DEFAULTS = CollectSearchesConfig()


def collect_searches(
    *, config: OmitArgPrefixes[CollectSearchesConfig] = _DEFAULTS, out: Path | None = None
) -> None:
    """Collect searches to learn from: trajectories with all observations, as a Minari data set.

    The same command resumes an interrupted run, and adds searches if more are given. Needs the extra `minari`.

    Example: robosim collect-searches --plan flat --episodes 20 --out out/searches

    Args:
        config: Which searches are collected.
        out: Output folder, also of a run to resume; by default a new one under runs/.
    """
    folder = output_folder(out, "collect-searches")
    with resume_hint(folder):
        data = collect_data_set(config, folder, console)
    emit_result({"searches": config.episodes, "data": str(data)}, folder)
    console.print(f"Wrote {counted(config.episodes, 'search', 'searches')} in {folder}")
    console.print(f"Next, in Python: minari.MinariDataset({str(data)!r})")


def collect(
    *,
    homes: int = 400,
    seed: int = 0,
    steps: int = 120,
    depth_noise: float = 1.0,
    noise: float = 1.0,
    work: Work = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Collect frames to train a mapper: sensor data and ground truth of a robot that explores generated homes.

    Writes one file per home, the same for any number of workers. The same command resumes an interrupted run, and adds
    homes if more are given.

    Example: robosim collect --homes 400 --out out/frames

    Args:
        homes: Number of homes.
        seed: Seed of homes and noise.
        steps: Frames of each home.
        depth_noise: Level of depth noise: 0 for none, 1 as published for a Kinect.
        noise: Level of actuation and odometry noise: 0 for none, 1 as published for a LoCoBot.
        work: Worker processes.
        out: Output folder, also of a run to resume; by default a new one under runs/.
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
    folder = output_folder(out, "collect")
    with resume_hint(folder):
        shards = collect_frames(config, folder, workers=work.count, cluster=work.cluster, console=console)
    emit_result({"homes": len(shards), "steps": steps, "files": [path.name for path in shards]}, folder)
    console.print(f"Wrote {counted(len(shards), 'home')} of {counted(steps, 'frame')} each in {folder}")
    console.print(f"Next: {install_first('torch')}robosim train mapper --data {quote(str(folder))}")
