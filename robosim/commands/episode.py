"""`robosim episode`."""

import sys
from dataclasses import replace
from pathlib import Path
from shlex import quote
from signal import SIGINT, SIGTERM
from typing import Annotated

import numpy as np
from rich.text import Text
from tyro.conf import OmitArgPrefixes, Positional, UseAppendAction

from robosim.commands.episode_config import AS_PUBLISHED, DEFAULTS, Base, GoalOption, Settings
from robosim.commands.speaking import console, tell
from robosim.commands.terminal import (
    NO_OPTIONS,
    XY,
    NamedPlace,
    PlanOptions,
    Pose,
    folder_for,
    read,
)
from robosim.evaluation.ablations import configured
from robosim.run import FILES, record_episode
from robosim.support.checks import check_number
from robosim.support.installation import install_first
from robosim.support.interrupt import SIGNALLED, Interrupt
from robosim.task.tasks import Anchor
from wireless.support.counting import counted


def episode(
    plan: Positional[str],
    *,
    target: XY = None,
    start: Pose = None,
    anchor: Annotated[tuple[NamedPlace, ...], UseAppendAction] = (),
    unknown_anchor: Annotated[tuple[NamedPlace, ...], UseAppendAction] = (),
    goal: GoalOption = "fused",
    seed: int = 0,
    base: Base = AS_PUBLISHED,
    settings: Settings = DEFAULTS,
    reading: OmitArgPrefixes[PlanOptions] = NO_OPTIONS,
    video: bool = True,
    rerun: bool = False,
    out: Path | None = None,
) -> None:
    """Drive a robot through a building, and record what it did and saw.

    Writes result.json, trajectory.tum (true) and estimate.tum, the built map (map.yaml, map.pgm), map.png,
    decisions.npz, which `robosim replay` draws from, and episode.mp4. Ctrl-C or SIGTERM ends the episode and leaves the
    same files of what was done until then. One seed gives one result.

    Example: robosim episode flat --goal explore --seed 3 --robot.radius-m 0.18 --out out/explore

    Args:
        plan: Floor plan: a shipped one by name, a ROS map (.yaml), an image or mesh, a HouseExpo .json, .npy.
        target: Where the target stands [m], in the plan's frame; drawn from the seed if not given.
        start: Where the robot starts [m, m, degrees from +x]; drawn from the seed if not given.
        anchor: Another transmitter by name, at a place that the robot knows [m]; can be given several times.
        unknown_anchor: The same at a place that it does not know.
        goal: Who chooses the goals. oracle knows the target, shortest the building and its pose too; explore goes
            where the map ends; visual does so until the camera sees the target; snr, los and los-or-first follow the
            strongest radio path where there is one, in line of sight, or also where it is bent or reflected once;
            fused weighs all of that together, and its variants show what each part of it brings; learned is a network
            that chooses each action itself, until it gets no further and fused takes over. module:Name is one of your
            own, search.safetensors one of `robosim train search`.
        seed: Seed of everything random: task and noise.
        base: What the options below start from.
        settings: How the episode is run.
        reading: How to read the plan, where it does not say.
        video: Whether to write episode.mp4.
        rerun: Whether to write episode.rrd, which `robosim view` opens in 3D; needs the extra `viz`.
        out: Folder for the results; a new one under runs/ if not given.
    """
    config = replace(configured(settings, goal), seed=seed)
    if start is not None:
        check_number("yaw of --start", start[2], -360, 360, "degrees from +x")
    folder = folder_for(out, "episode")
    result = record_episode(
        read(plan, reading),
        config,
        folder,
        start=None if start is None else np.array([start[0], start[1], np.radians(start[2])]),
        target=None if target is None else np.array(target),
        anchors=[
            Anchor(name=name, place=np.array([x, y]), known=known)
            for known, some in ((True, anchor), (False, unknown_anchor))
            for name, x, y in some
        ],
        video=video,
        rerun=rerun,
        console=console,
    )
    tell(result, folder)
    seen = f"{100 * result['coverage']:.1f} % of the reachable floor seen"
    shortest = f" (shortest {result['shortest_m']:.2f} m, SPL {result['spl']:.2f})"
    told = (
        f" after {counted(result['steps'], 'step')} and {result['path_length_m']:.2f} m"
        f"{shortest if result['seeks_target'] else ''}, {seen}, "
        f"{counted(result['collisions'], 'collision')}, {result['timing']['decisions_per_s']:.0f} decisions/s"
    )
    console.print(Text.assemble((result["ended"], "bold"), told))
    # An episode that ends where it starts has no decision to film.
    console.print(f"Wrote {', '.join(name for name in FILES if (folder / name).exists())} in {folder}")
    true, estimated = (quote(str(folder / f"{name}.tum")) for name in ("trajectory", "estimate"))
    console.print(f"Next: {install_first('evo')}evo_ape tum {true} {estimated}")
    for number in (SIGINT, SIGTERM):
        if result["ended"] == Interrupt(number).word:
            sys.exit(SIGNALLED + number)
