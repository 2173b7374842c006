"""Run of an episode with a progress display and output files."""

import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress

from robosim.agent import check_weights
from robosim.building.building import Building, make_building
from robosim.building.reach import Reach, reach
from robosim.drawing.picture import Picture, status_line
from robosim.drawing.plan_view import building_rings
from robosim.drawing.team_picture import TeamPicture
from robosim.entrants import make_entrants
from robosim.episode import run_team
from robosim.episode_config import EpisodeConfig
from robosim.episode_log import EpisodeLog
from robosim.plans.files import write_ros
from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, FloorPlan
from robosim.recording.bag_export import BAG, LAYOUT
from robosim.recording.episode_file import EPISODE, EpisodeWriter, Head, robots_of_team
from robosim.step import Step
from robosim.support.files import plain, write_json, write_whole
from robosim.support.installation import package_version
from robosim.support.interrupt import noted_interrupt
from robosim.support.parts import part_name, to_dict
from robosim.support.progress import text_column
from robosim.support.run_folder import run_folder
from robosim.support.stopwatch import LOOP_STAGES, Stopwatch
from robosim.task.tasks import Anchor, Task, make_task, with_anchors
from robosim.team.team_log import TeamLog
from slam.grid import MapEstimate

#: Files of an episode, in the order in which they are listed.
FILES = (
    "result.json",
    "map.png",
    "map.yaml",
    "map.pgm",
    "trajectory.tum",
    "estimate.tum",
    EPISODE,
    "episode.mp4",
)


def record_episode(
    plan: FloorPlan,
    config: EpisodeConfig,
    out: Path,
    *,
    start: Float[np.ndarray, "3"] | None = None,
    target: Float[np.ndarray, "2"] | None = None,
    anchors: Sequence[Anchor] = (),
    video: bool = True,
    console: Console | None = None,
) -> dict[str, Any]:
    """Run an episode and write its files into a folder; returns the content of `result.json`.

    The files: `result.json`, `trajectory.tum` and `estimate.tum`, the built map as `map.yaml` and `map.pgm`,
    `map.png`, `episode.npz` (all steps, from which `robosim replay` draws), and `episode.mp4`. An interrupted episode
    leaves the same files, of the steps until then. Start and target are drawn from the seed if they are not given.
    Without `video` the loop is faster.

    Raises:
        MapError: If the task cannot be done in the plan.
        FolderError: If the folder cannot be used.
        ValueError: If weights cannot be read.
    """
    check_weights(config)
    hull_m = config.robots[0].hull_m
    console = console or Console(quiet=True)
    with run_folder(out, "episode") as out:
        robots = robots_of_team(out)
        if robots or (out / EPISODE).exists():
            console.print(f"Replacing the episode in {out}")
        # Files of an earlier episode would be mistaken for new ones.
        for folder in (out, *(out / name for name in robots)):
            for name in (*FILES, "replay.mp4", "sheet.png", LAYOUT):
                (folder / name).unlink(missing_ok=True)
            rmtree(folder / BAG, ignore_errors=True)
        watch = Stopwatch()
        with watch.stage("scene"):
            building = make_building(plan, config=config.building)
            places = reach(building, *hull_m)
            task = make_task(places, np.random.default_rng([config.seed, 0]), start=start, target=target)
            task = with_anchors(task, places, anchors)
        _print_cut_off(places, task.start, console)
        entrants = make_entrants(building, places, task, config)
        alone = len(entrants) == 1
        folders = {name: out if alone else out / name for name in entrants}
        rings, title = building_rings(building), f"{plan.name}  {part_name(config.goal)}"
        steps = {name: EpisodeWriter(rings) for name in entrants}
        picture: Picture | TeamPicture
        if alone:
            picture = Picture(rings, task.target, title=title, anticipates=config.mapper != "classical")
        else:
            picture = TeamPicture(rings, task.target, list(entrants), title=title)
        ends = text_column("{task.description}"), text_column("{task.fields[note]}")
        columns = ends[0], BarColumn(bar_width=12), MofNCompleteColumn(), ends[1]
        with ExitStack() as files, Progress(*columns, console=console, refresh_per_second=4) as progress:
            writer = None
            if video:
                from robosim.drawing.video import VideoWriter  # brings ffmpeg

                writer = VideoWriter(out / "episode.mp4", picture.size)
                files.callback(_timed, writer.close, watch, "video")
            bar = progress.add_task(plan.name, total=config.max_steps, note="")

            def record(log: EpisodeLog, step: Step) -> None:
                picture.target = task.target if log.seeks_target else None
                progress.update(bar, completed=log.steps, note=status_line(step, picture.target))
                with watch.stage("log"):
                    steps[log.robot].add(step)
                if writer is not None:
                    with watch.stage("video"):
                        image = picture.add(log.robot, step)
                        if image is not None:
                            writer.add(image)

            team = run_team(building, entrants, record, watch)
            if writer is not None:
                with watch.stage("video"):
                    image = picture.last()
                    if image is not None:
                        writer.add(image)
        with noted_interrupt("writing the files"):
            about = {"plan": plan.name, "goal": part_name(config.goal), "seed": config.seed}
            about |= {} if alone else {"robots": len(entrants)}
            run = _run_digest(plan, task, config)
            for name, folder in folders.items():
                folder.mkdir(exist_ok=True)
                head = about if alone else {**about, "run": run, "robot": name}
                _write_robot(folder, building, team.robots[name], team.maps[name], head, steps[name])
                if not alone:
                    content = {
                        **head,
                        **team.robots[name].result(),
                        "config": to_dict(entrants[name].config),
                    }
                    write_json(folder / "result.json", plain(content))
            return _write_team(out, building, config, team, watch, about)


def _run_digest(plan: FloorPlan, task: Task, config: EpisodeConfig) -> str:
    """A text that only robots of the same run share."""
    run = [plan.digest(), task.start, task.target, to_dict(config)]
    return hashlib.sha256(json.dumps(plain(run)).encode()).hexdigest()[:16]


def _write_robot(
    out: Path,
    building: Building,
    log: EpisodeLog,
    estimate: MapEstimate,
    about: dict[str, Any],
    steps: EpisodeWriter,
) -> None:
    """Write the files of one robot: trajectories, steps and map."""
    from robosim.drawing.plots import plot_episode  # brings matplotlib, which takes a second

    log.save_trajectories(out)
    row = {"policy" if key == "goal" else key: value for key, value in about.items()} | plain(log.result())
    seconds = {stage: round(value, 3) for stage, value in log.seconds.items()}
    head = Head(row=row, seeks_target=log.seeks_target, timing=plain(seconds))
    write_whole(out / EPISODE, steps.content(head, log.poses[-1], log.coverage[-1], estimate, log.times()))
    write_ros(built_plan(estimate, about["plan"]), out / "map.yaml")
    plot_episode(out / "map.png", building, log, estimate)


def _write_team(
    out: Path,
    building: Building,
    config: EpisodeConfig,
    team: TeamLog,
    watch: Stopwatch,
    about: dict[str, Any],
) -> dict[str, Any]:
    """Write the result, and return it: times are under `timing`, the rest depends on the seed."""
    from robosim.drawing.plots import plot_team

    loop = sum(watch.seconds[stage] for stage in LOOP_STAGES)
    steps = sum(log.steps for log in team.robots.values())
    result: dict[str, Any] = {
        **about,
        "seeks_target": team.first.seeks_target,
        **team.result(),
        "walls": len(building.walls_2d),
        "config": to_dict(config),
        "versions": {name: package_version(name) for name in ("robosim", "mujoco", "numpy")},
        "timing": {
            "seconds": {stage: round(value, 3) for stage, value in watch.seconds.items()},
            "decisions_per_s": steps / loop if loop else 0.0,
            "decisions_per_s_with_video": steps / (loop + watch.seconds["video"]) if loop else 0.0,
        },
    }
    if len(team.robots) > 1:
        plot_team(out / "map.png", building, team)
    write_json(out / "result.json", plain(result))  # the last: it shows that all files are there
    return plain(result)


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


def _print_cut_off(places: Reach, start: Float[np.ndarray, "3"], console: Console) -> None:
    rooms = places.cut_off(places.part_at(start[:2]))
    if rooms:
        listed = ", ".join(f"{r.area_m2:.1f} m2 at ({r.centre[0]:.1f}, {r.centre[1]:.1f})" for r in rooms[:5])
        more = f" and {len(rooms) - 5} more" if len(rooms) > 5 else ""
        console.print(f"The hull (radius {places.radius_m} m) cannot enter: {listed}{more}.")
