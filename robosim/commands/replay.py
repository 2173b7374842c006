"""`robosim replay` and `robosim view`."""

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import output_folder
from robosim.support.checks import Range
from robosim.support.run_folder import run_folder


def replay(
    episode: Positional[Path], *, frames: Annotated[int, Range(1, 1000)] = 12, out: Path | None = None
) -> None:
    """Draw an episode again from its log: the same video, and a sheet of frames. Nothing is simulated.

    Example: robosim replay out/a

    Args:
        episode: Folder of `robosim episode`.
        frames: Frames of the sheet.
        out: Folder for replay.mp4 and sheet.png; by default that of the episode.
    """
    from robosim.recording.replay import replay as draw

    with run_folder(output_folder(out or episode, "episode"), "episode") as folder:
        files = draw(episode, folder, frames)
    emit_result({"files": [file.name for file in files]}, folder)
    console.print(f"Wrote {' and '.join(str(file) for file in files)}", soft_wrap=True)


def view(episode: Positional[Path], *, web: bool = False) -> None:
    """Open an episode's recording in the Rerun viewer: maps, rays, angles of arrival and belief over time, in 3D.

    Needs the extra `viz`, and an episode that was run with --rerun.

    Example: robosim view out/a

    Args:
        episode: Folder of `robosim episode`.
        web: Whether to serve the viewer to a browser, for machines without a display.
    """
    import subprocess
    import sys

    from robosim.recording.rerun_recording import RECORDING, rerun_sdk

    path = episode / RECORDING
    if not path.is_file():
        raise ValueError(f"{path}: no such file. Run the episode with --rerun.")
    rerun_sdk()
    emit_result({"recording": path})
    sys.exit(subprocess.call([sys.executable, "-m", "rerun", str(path), *(["--web-viewer"] if web else [])]))
