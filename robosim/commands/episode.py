"""`robosim episode`."""

import sys
from dataclasses import replace
from pathlib import Path
from shlex import quote
from signal import SIGINT, SIGTERM
from typing import Annotated, Any

import numpy as np
from rich.text import Text
from tyro.conf import Positional, UseAppendAction

from robosim.commands.episode_config import DEFAULT_START, DEFAULTS, Base, Settings
from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import NO_OPTIONS, XY, NamedPlace, Pose, Reading, output_folder, read
from robosim.parts import GoalPart
from robosim.recording.bag_export import BAG, LAYOUT, export_bag, require_rosbags
from robosim.recording.episode_file import robots_of_team
from robosim.run import FILES, record_episode
from robosim.support.checks import ADVANCED, check_number
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
    goal: GoalPart = "learned",
    seed: int = 0,
    base: Base = DEFAULT_START,
    settings: Settings = DEFAULTS,
    reading: Reading = NO_OPTIONS,
    video: bool = True,
    mcap: Annotated[bool, ADVANCED] = False,
    out: Path | None = None,
) -> None:
    """Drive a robot through a building, and record the episode.

    Writes result.json, trajectory.tum (true) and estimate.tum, the map (map.yaml, map.pgm), map.png, episode.npz,
    which `robosim replay` draws from, and episode.mp4. Ctrl-C or SIGTERM ends the episode; the same files are written
    of the steps until then. One seed gives one result. With --robots 3 three robots search together, and each has a
    folder with its files; the team's are result.json, map.png and episode.mp4.

    Example: robosim episode flat --goal explore --seed 3 --robot.radius-m 0.18 --out out/explore

    Args:
        plan: Floor plan: one shipped, by name, or a ROS map (.yaml), image, mesh, .dxf, .svg, .ifc, .json, .npy.
        target: Place of the target [m] in the plan's frame; by default drawn from the seed.
        start: Start pose of the robot [m, m, degrees from +x]; by default drawn from the seed.
        anchor: Additional transmitter by name, at a place that the robot knows [m]; can be given several times.
        unknown_anchor: The same at a place that the robot does not know.
        goal: Goal policy. oracle knows the target, shortest the building and its pose too; explore drives to the edge
            of the map; visual does so until the camera sees the target; snr, los and los-or-first follow the strongest
            radio path, if there is one, in line of sight, or also diffracted or reflected once; fused weighs all of
            that; learned is a network that chooses each action itself, and
            falls back to fused where it is stuck, or without a camera. module:Name is your own,
            search.safetensors comes from `robosim train search`.
        seed: Seed of task and noise.
        base: Values that the options below start from.
        settings: How the episode is run.
        reading: How to read the plan.
        video: Whether to write episode.mp4.
        mcap: Whether to write the episode as a ROS 2 bag too, as `robosim export` does; needs the extra `bags`.
        out: Output folder; by default a new one under runs/.
    """
    config = replace(settings, goal=goal, seed=seed)
    if start is not None:
        check_number("yaw of --start", start[2], -360, 360, "degrees from +x")
    if mcap:
        require_rosbags()
    folder = output_folder(out, "episode")
    result = record_episode(
        read(plan, reading),
        config,
        folder,
        start=None if start is None else np.array([start[0], start[1], np.radians(start[2])]),
        target=None if target is None else np.array(target),
        anchors=[
            Anchor(name=name, place=np.array([x, y]), known=known)
            for known, places in ((True, anchor), (False, unknown_anchor))
            for name, x, y in places
        ],
        video=video,
        console=console,
    )
    if mcap:
        export_bag(folder)
    emit_result(result, folder)
    seen = f"{100 * result['coverage']:.1f} % of the reachable floor seen"
    shortest = f" (shortest {result['shortest_m']:.2f} m, SPL {result['spl']:.2f})"
    details = (
        f" after {counted(result['steps'], 'step')} and {result['path_length_m']:.2f} m"
        f"{shortest if result['seeks_target'] else ''}, {seen}, "
        f"{counted(result['collisions'], 'collision')}, {_of_team(result)}"
        f"{result['timing']['decisions_per_s']:.0f} decisions/s"
    )
    console.print(Text.assemble((result["ended"], "bold"), details))
    # An episode that ends where it starts has no video.
    names = (*FILES, *((BAG, LAYOUT) if mcap else ()))
    console.print(f"Wrote {', '.join(name for name in names if (folder / name).exists())} in {folder}")
    first = next(iter(robots_of_team(folder)), "")
    true, estimated = (quote(str(folder / first / f"{name}.tum")) for name in ("trajectory", "estimate"))
    console.print(f"Next: {install_first('evo')}evo_ape tum {true} {estimated}")
    for number in (SIGINT, SIGTERM):
        if result["ended"] == Interrupt(number).word:
            sys.exit(SIGNALLED + number)


def _of_team(result: dict[str, Any]) -> str:
    """Words about a team; none about a single robot."""
    if "robots" not in result:
        return ""
    contacts = counted(result["contacts_between_robots"], "contact")
    return f"{counted(result['robots'], 'robot')}, {contacts} between them, {result['sent_bytes'] / 1e3:.0f} kB sent, "
