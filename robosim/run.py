"""One episode with everything a person wants of it: progress while it runs, and files to look at afterwards."""

import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress

from robosim.building.building import Building, make_building
from robosim.building.reach import Reach, reach
from robosim.compiling import compiled_beside
from robosim.drawing.picture import Picture, building_rings
from robosim.drawing.snapshot import Snapshot, arrivals, belief_layer, built_layer, whole_mm
from robosim.episode import Decision, EpisodeConfig, check_weights, run_episode
from robosim.plans.files import write_ros
from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, FloorPlan
from robosim.policies.reason import decisions_along
from robosim.recording.decision_log import DECISIONS, DecisionWriter
from robosim.recording.rerun_recording import RECORDING, RerunRecording, rerun_sdk
from robosim.support.files import write_json
from robosim.support.installation import package_version
from robosim.support.interrupt import noted_interrupt
from robosim.support.parts import described, told
from robosim.support.progress import text_column
from robosim.support.run_folder import run_folder
from robosim.support.stopwatch import LOOP_STAGES, Stopwatch
from robosim.task.record import EpisodeLog
from robosim.task.tasks import Anchor, Task, make_task, with_anchors
from slam.grid import MapEstimate

#: What an episode leaves, in the order in which it is told.
FILES = (
    "result.json",
    "map.png",
    "map.yaml",
    "map.pgm",
    "trajectory.tum",
    "estimate.tum",
    DECISIONS,
    "episode.mp4",
)


#: Mappers that guess nothing where they have not looked.
_OBSERVERS = ("classical", "learned-pose")


def record_episode(
    plan: FloorPlan,
    config: EpisodeConfig,
    out: Path,
    *,
    start: Float[np.ndarray, "3"] | None = None,
    target: Float[np.ndarray, "2"] | None = None,
    anchors: Sequence[Anchor] = (),
    video: bool = True,
    rerun: bool = False,
    console: Console | None = None,
) -> dict[str, Any]:
    """Run an episode and write its files into a folder.

    The files: `result.json`, `trajectory.tum` and `estimate.tum`, the built map as `map.yaml` and `map.pgm`,
    `map.png`, `decisions.npz` (the log that `robosim replay` draws from), and `episode.mp4`. An interrupted episode
    leaves the same files, of what was done until then.

    Args:
        plan: Where.
        config: How.
        out: The folder, made if it is missing.
        start: Pose of the robot at first; drawn from the seed if not given.
        target: Where the target stands; drawn from the seed if not given.
        anchors: Other transmitters.
        video: Whether to draw the video; without it the loop is faster.
        rerun: Whether to record `episode.rrd` for the Rerun viewer.
        console: Where progress is shown; nowhere if not given.

    Returns:
        What `result.json` holds.

    Raises:
        MapError: If the task cannot be done in the plan.
        FolderError: If the folder cannot be used.
        ValueError: If weights cannot be read, or a Rerun recording is asked for and Rerun is not installed.
    """
    if rerun:
        rerun_sdk()
    check_weights(config)
    with run_folder(out, "episode") as folder:
        # Files of an earlier episode must not stand beside this one's.
        for name in (*FILES, "replay.mp4", "sheet.png", RECORDING):
            (folder / name).unlink(missing_ok=True)
        with compiled_beside(config):
            return _record(
                plan, config, folder, start, target, anchors, video, rerun, console or Console(quiet=True)
            )


def _record(
    plan: FloorPlan,
    config: EpisodeConfig,
    out: Path,
    start: Float[np.ndarray, "3"] | None,
    target: Float[np.ndarray, "2"] | None,
    anchors: Sequence[Anchor],
    video: bool,
    rerun: bool,
    console: Console,
) -> dict[str, Any]:
    watch = Stopwatch()
    with watch.stage("scene"):
        building = make_building(plan, config=config.building)
        robot = config.simulator.robot
        places = reach(building, robot.radius_m, robot.height_m)
        task = make_task(places, np.random.default_rng([config.seed, 0]), start=start, target=target)
        task = with_anchors(task, places, anchors)
    _tell_cut_off(places, task.start, console)
    rings = building_rings(building)
    picture = Picture(rings, task.target, anticipates=config.mapper not in _OBSERVERS)
    decisions = DecisionWriter(rings, task.target)
    with ExitStack() as files, _progress(console) as progress:
        writer = None
        if video:
            from robosim.drawing.video import VideoWriter  # brings ffmpeg

            writer = VideoWriter(out / "episode.mp4", picture.size)
            files.callback(_timed, writer.close, watch, "video")
        recording = _recording(out, building, task, config) if rerun else None
        if recording is not None:
            files.callback(_timed, recording.close, watch, "rerun")
        bar = progress.add_task(plan.name, total=config.max_steps, note="")

        def look(log: EpisodeLog, decision: Decision) -> None:
            picture.seeks_target = decisions.seeks_target = log.seeks_target
            text = status_line(log, decision)
            progress.update(bar, completed=log.steps, note=text)
            with watch.stage("log"):
                snapshot = snapshot_of(
                    log, decision, f"{plan.name}  {told(config.goal)}  step {log.steps}  {text}"
                )
                decisions.add(snapshot)
            if writer is not None:
                with watch.stage("video"):
                    writer.add(picture.draw(snapshot))
            if recording is not None:
                with watch.stage("rerun"):
                    recording.add(log, decision)

        log, estimate = run_episode(building, places, task, config, look, watch)
    from robosim.drawing.plots import plot_episode  # brings matplotlib, which takes a second

    # The result last: where it is, all is. An impatient second Ctrl-C shall not cost it.
    with noted_interrupt("writing the files"):
        log.save_trajectories(out)
        decisions.save(out / DECISIONS)
        write_ros(built_plan(estimate, plan.name), out / "map.yaml")
        plot_episode(out / "map.png", building, log, estimate)
        result = _result(plan, building, config, log, watch)
        write_json(out / "result.json", result)
    return result


def _timed(action: Callable[[], None], watch: Stopwatch, stage: str) -> None:
    with watch.stage(stage):
        action()


def built_plan(estimate: MapEstimate, name: str) -> FloorPlan:
    """The map that a robot has built, as a floor plan."""
    occupancy = np.full(estimate.obstacle.shape, UNKNOWN, np.uint8)
    occupancy[estimate.explored] = FREE
    occupancy[estimate.obstacle | estimate.blocked] = OCCUPIED
    x, y = estimate.frame.origin_xy
    return FloorPlan(
        occupancy=occupancy,
        resolution_m=estimate.frame.resolution_m,
        origin=(float(x), float(y), 0.0),
        name=name,
    )


def _recording(out: Path, building: Building, task: Task, config: EpisodeConfig) -> RerunRecording:
    c = config.simulator
    return RerunRecording(out / RECORDING, building, task, c.image, c.radio.height_m)


def snapshot_of(log: EpisodeLog, decision: Decision, text: str) -> Snapshot:
    """What is drawn and kept of a decision."""
    path = decision.plan.path
    return Snapshot(
        rgb=decision.view.rgb,
        depth_mm=whole_mm(decision.view.depth),
        pose=decision.pose,
        estimate=decision.estimate.pose,
        built=built_layer(decision.estimate),
        goal=decision.goal,
        path=path,
        arrivals=None if decision.situation.measurement is None else arrivals(decision.situation.measurement),
        belief=None if decision.belief is None else belief_layer(decision.belief),
        text=text,
        reason=decision.reason,
        decisions=decisions_along(path, float(decision.estimate.pose[2])) if len(path) else math.nan,
        coverage=log.coverage[-1],
        true_state=log.links[-1].state if log.links else None,
    )


def status_line(log: EpisodeLog, decision: Decision) -> str:
    """How far a search is, in words."""
    gap = np.hypot(*(log.poses[-1][:2] - log.task.target))
    error = np.hypot(*(log.poses[-1] - log.estimates[-1])[:2])
    text = f"{100 * log.coverage[-1]:.0f} % seen, pose error {100 * error:.0f} cm"
    if not log.seeks_target:
        return text
    text = f"{gap:.1f} m to target, {text}"
    if decision.situation.measurement is None:
        return text
    return f"{text}, {decision.situation.measurement.state.name.lower().replace('_', ' ')}"


def _progress(console: Console) -> Progress:
    return Progress(
        text_column("{task.description}"),
        BarColumn(bar_width=12),
        MofNCompleteColumn(),
        text_column("{task.fields[note]}"),
        console=console,
        refresh_per_second=4,
    )


def _tell_cut_off(places: Reach, start: Float[np.ndarray, "3"], console: Console) -> None:
    rooms = places.cut_off(places.part_at(start[:2]))
    if rooms:
        listed = ", ".join(f"{r.area_m2:.1f} m2 at ({r.centre[0]:.1f}, {r.centre[1]:.1f})" for r in rooms[:5])
        more = f" and {len(rooms) - 5} more" if len(rooms) > 5 else ""
        console.print(f"The hull (radius {places.radius_m} m) cannot enter: {listed}{more}.")


def _result(
    plan: FloorPlan, building: Building, config: EpisodeConfig, log: EpisodeLog, watch: Stopwatch
) -> dict[str, Any]:
    """Scores, configuration and versions; all times are under `timing`, all else depends on the seed alone."""
    loop = sum(watch.seconds[stage] for stage in LOOP_STAGES)
    return {
        "plan": plan.name,
        "goal": told(config.goal),
        "seed": config.seed,
        "seeks_target": log.seeks_target,
        **log.result(),
        "walls": len(building.walls_2d),
        "config": described(config),
        "versions": {name: package_version(name) for name in ("robosim", "mujoco", "numpy")},
        "timing": {
            "seconds": {stage: round(value, 3) for stage, value in watch.seconds.items()},
            "decisions_per_s": log.steps / loop if loop else 0.0,
            "decisions_per_s_with_video": log.steps / (loop + watch.seconds["video"]) if loop else 0.0,
        },
    }
