"""`robosim replay`, `robosim export` and `robosim live`."""

from pathlib import Path
from typing import Annotated

from rich.text import Text
from tyro.conf import OmitArgPrefixes, Positional

from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import (
    DEFAULT_RADIO,
    NO_OPTIONS,
    RadioOptions,
    Reading,
    output_folder,
    read_place,
)
from robosim.support.checks import Range
from robosim.support.run_folder import run_folder
from robosim.team.team_config import TeamConfig


def replay(
    episode: Positional[Path], *, frames: Annotated[int, Range(1, 1000)] = 12, out: Path | None = None
) -> None:
    """Draw an episode again from its log: the same video, and a sheet of frames. Nothing is simulated.

    Example: robosim replay out/a

    Args:
        episode: Folder of `robosim episode`, or file of an episode of `robosim evaluate`, which has no camera pictures
            and only the last map.
        frames: Frames of the sheet.
        out: Folder for replay.mp4 and sheet.png; by default that of the episode.
    """
    from robosim.recording.replay import replay as draw

    with run_folder(output_folder(out or episode, "episode"), "episode") as folder:
        files = draw(episode, folder, frames)
    emit_result({"files": [file.name for file in files]}, folder)
    console.print(f"Wrote {' and '.join(str(file) for file in files)}", soft_wrap=True)


def export(episode: Positional[Path], *, mcap: bool = True, out: Path | None = None) -> None:
    """Write an episode as a ROS 2 bag in MCAP, with a layout for Foxglove; no ROS is needed.

    The bag has transforms, odometry, scans of the lidar, colour and depth, map, path, goal, belief, link states and
    angles of arrival, at simulated times. Needs the extra `bags`.

    Example: robosim export out/a

    Args:
        episode: Folder of `robosim episode`.
        mcap: Whether to write MCAP, the only format.
        out: Folder for the bag; by default that of the episode.
    """
    if not mcap:
        raise ValueError("--no-mcap leaves nothing to write: MCAP is the only format.")
    from robosim.recording.bag_export import LAYOUT, export_bag

    with run_folder(output_folder(out or episode, "episode"), "episode") as folder:
        bag = export_bag(episode, folder)
    emit_result({"bag": bag}, folder)
    console.print(f"Wrote {bag} and {LAYOUT}", soft_wrap=True)


def live(
    plan: Positional[str] = "flat",
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    browser: bool = True,
    export: Path | None = None,
    people: Annotated[int, Range(0, 1000, "people")] = 0,
    robots: str = "1",
    radio: OmitArgPrefixes[RadioOptions] = DEFAULT_RADIO,
    reading: Reading = NO_OPTIONS,
) -> None:
    """Open a local web page: drag a transmitter through a building, watch a search, replay an episode.

    Given a folder of `robosim episode` or `robosim evaluate`, the page replays its episodes. Needs the extra `live`.
    Ctrl-C ends the server.

    Example: robosim live office

    Args:
        plan: Floor plan: one shipped, by name, or a ROS map (.yaml), image, mesh, .dxf, .svg, .ifc, .json, .npy; the
            .yaml of a building of several storeys; or the folder of an episode or an evaluation.
        host: Address to serve at; 0.0.0.0 for all addresses of this machine, open to other machines.
        port: Port to serve at; 0 for any free one.
        browser: Whether to open a browser, if there is one.
        export: File (.html) to write the episode of a folder to, as a page that plays without Python; nothing is
            served then.
        people: People who walk in the building during searches.
        robots: Robots that search together: their number, or their names, such as jackal,turtlebot4.
        radio: Which paths are traced.
        reading: How to read the plan.
    """
    from robosim.live.server import check_address, viser_module

    config, team = radio.config(), TeamConfig(robots=robots)
    if export is not None and (export.suffix.lower() != ".html" or not Path(plan).is_dir()):
        raise ValueError(
            f"export is {str(export)!r} for {plan!r}, expected a name that ends in .html, and the folder of an episode."
        )
    folder = Path(plan) if Path(plan).is_dir() else None
    for name, value, default in (("robots", robots, "1"), ("people", people, 0)):
        if folder is not None and value != default:
            raise ValueError(
                f"{name} is {value}, but {plan} is a recording of its {name}. Leave --{name} out."
            )
    viser_module()
    check_address(host, 0 if export is not None else port)
    if export is not None:
        _export(Path(plan), export)
        return
    floor_plan = None if folder else read_place(plan, reading)
    from robosim.episode_config import EpisodeConfig
    from robosim.live.page import Page
    from robosim.live.recordings import check_results
    from robosim.movers.movers import MoversConfig
    from robosim.plans.storey_plans import StoreysPlan
    from robosim.simulator import SimulatorConfig

    if folder is not None:
        check_results(folder)
    name = folder.resolve().name if folder else floor_plan.name if floor_plan else ""
    with Page(host, port, f"robosim live: {name}") as page:
        if folder is not None:
            page.replay(folder)
        elif floor_plan is not None:
            page.explore(floor_plan, config)
            if not isinstance(floor_plan, StoreysPlan):
                simulator = SimulatorConfig(movers=MoversConfig(people=people))
                page.search(EpisodeConfig(simulator=simulator, team=team))
        emit_result({"url": page.url, "shown": name})
        console.print(
            Text.assemble("Open ", (page.url, "bold"), " in a browser. Ctrl-C ends it."), soft_wrap=True
        )
        if browser:
            _open(page.url)
        page.wait()


def _export(folder: Path, file: Path) -> None:
    """Write the episode of a folder as a page."""
    from robosim.live.page_export import export
    from robosim.live.recordings import check_results, is_episode, read_recording

    check_results(folder)
    if not is_episode(folder):
        raise ValueError(
            f"{folder} is an evaluation: give the folder of one episode, or export from the page."
        )
    export([read_recording(folder)], file)
    emit_result({"page": file, "bytes": file.stat().st_size})
    console.print(
        f"Wrote {file}, {file.stat().st_size / 1e6:.1f} MB, which plays in any browser", soft_wrap=True
    )


def _open(url: str) -> None:
    """Open a browser, if there is a display."""
    import os
    import webbrowser

    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)
