"""A look at the machine: what works, how fast, and what to install where something does not.

Libraries are imported by the probe that needs them, so that a missing one is a finding and no crash.
"""

import importlib
import importlib.metadata
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Literal

import numpy as np
from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from robosim.building import Building


@dataclass(frozen=True)
class Finding:
    """The outcome of one check."""

    part: str
    works: bool
    detail: str
    """What was found and measured, or what went wrong."""
    fix: str = ""
    """What to install or do."""
    needed: bool = True
    """Whether robosim cannot do its main job without it."""


def examine() -> list[Finding]:
    """Run all checks; none of them raises."""
    return [
        _python(),
        _check("mujoco", _mujoco, "pip install 'mujoco>=4'"),
        _check("embree", _embree, "pip install embreex"),
        _check("pyrender on OSMesa", _camera("osmesa"), "apt-get install libosmesa6", needed=False),
        _check("pyrender on EGL", _camera("egl"), "apt-get install libegl1 libgl1-mesa-dri", needed=False),
        _check("opencv ArUco", _aruco, "pip install 'opencv-python-headless>=4.10'"),
        _check("fast marching", _fast_marching, "pip install 'numba>=0.61'"),
        _check("video (H.264)", _video, "pip install 'av>=14'"),
        _check("torch", _torch, "pip install torch (the CPU build is enough)", needed=False),
    ]


def report(findings: list[Finding], console: Console) -> bool:
    """Print the findings as a table, and return whether the main job can be done."""
    console.print(
        f"robosim {importlib.metadata.version('robosim')} on Python {platform.python_version()}, "
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    )
    table = Table(box=None, pad_edge=False)
    for column in ("part", "", "what was found", "what to do"):
        table.add_column(column)
    for finding in findings:
        state = "[green]works" if finding.works else "[red]missing" if finding.needed else "[yellow]missing"
        table.add_row(finding.part, state, finding.detail, "" if finding.works else finding.fix)
    console.print(table)
    sees = any(f.works for f in findings if f.part.startswith("pyrender"))
    able = sees and all(f.works for f in findings if f.needed)
    if able:
        console.print("All that the main job needs is here. Next: robosim episode flat --out out/first")
    elif not sees:
        console.print(
            "No way to draw pictures: install OSMesa (apt-get install libosmesa6). Until then pass "
            "--camera embree, which needs no OpenGL."
        )
    else:
        console.print("Install what is missing above, then run robosim doctor again.")
    return able


def _check(part: str, probe: Callable[[], str], fix: str, *, needed: bool = True) -> Finding:
    # A broken library may raise anything at all at import, and the report is there to say so.
    try:
        return Finding(part, True, probe(), needed=needed)
    except Exception as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        return Finding(part, False, reason[0][:90], fix, needed)


def _python() -> Finding:
    fits = (3, 11) <= sys.version_info[:2] < (3, 14)
    return Finding("python", fits, platform.python_version(), "use Python 3.11, 3.12 or 3.13")


def _rate(action: Callable[[], object], least_s: float = 0.3) -> float:
    """Calls per second of an action, after one to warm up."""
    action()
    count, begin = 0, perf_counter()
    while perf_counter() - begin < least_s:
        action()
        count += 1
    return count / (perf_counter() - begin)


def _version(name: str) -> str:
    return f"{name} {importlib.metadata.version(name)}"


def _mujoco() -> str:
    import mujoco

    from robosim.world import World

    world = World(_room())
    world.reset(np.array([1.0, 1.0, 0.0]))
    begin, steps = perf_counter(), 0
    for _ in range(36):
        steps += world.move(np.array([0.0, 0.0, np.radians(10)])).physics_steps
    return f"mujoco {mujoco.__version__}, {steps / (perf_counter() - begin):,.0f} physics steps/s in a room"


def _embree() -> str:
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    rays = RayMeshIntersector(_room().mesh)
    angle = np.linspace(0, 2 * np.pi, 20_000, endpoint=False)
    directions = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    origins = np.broadcast_to([1.0, 1.0, 1.0], directions.shape)
    if not rays.intersects_any(origins, directions).all():
        raise RuntimeError("rays escape from a closed room")
    rate = _rate(lambda: rays.intersects_first(origins, directions)) * len(angle)
    return f"{_version('embreex')}, {rate / 1e6:.1f} million rays/s"


def _camera(kind: Literal["osmesa", "egl"]) -> Callable[[], str]:
    # A process of its own: OpenGL serves one platform a process, and a broken driver may take it down.
    program = f"from robosim.doctor import measure_camera; measure_camera({kind!r})"

    def probe() -> str:
        command = [sys.executable, "-c", program]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        lines = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines()
        if done.returncode or not lines:
            raise RuntimeError(lines[-1] if lines else f"the probe ended with status {done.returncode}")
        return lines[-1]

    return probe


def measure_camera(kind: Literal["osmesa", "egl"]) -> None:
    """Draw a room on one OpenGL platform, check a depth, and write the frame rate to standard output."""
    from robosim.camera import CameraConfig, camera_pose, make_camera
    from robosim.rendering.shading import shaded_mesh

    config = CameraConfig()
    camera = make_camera([shaded_mesh(_room())], config, backend="pyrender", platform=kind)
    pose = camera_pose(np.array([1.0, 1.0, 0.0]), config)
    depth = float(camera.render(pose).depth[config.height // 2, config.width // 2])
    if abs(depth - 3.0) > 0.01:
        raise RuntimeError(f"a wall 3 m away is drawn at {depth:.3f} m")
    rate = _rate(lambda: camera.render(pose))
    camera.close()
    sys.stdout.write(f"{rate:,.0f} RGB-D frames/s at {config.width} x {config.height}\n")


def _aruco() -> str:
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    marker = np.pad(cv2.aruco.generateImageMarker(dictionary, 7, 60), 20, constant_values=255)
    _, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(marker)
    if ids is None or ids.ravel().tolist() != [7]:
        raise RuntimeError("a clean marker is not recognised")
    return f"opencv {cv2.__version__}, a marker is recognised"


def _fast_marching() -> str:
    from slam.marching import march

    speed = np.ones((240, 240))
    rate = _rate(lambda: march(speed, (120, 120), 1.0))
    return f"{_version('numba')}, {1000 / rate:.1f} ms for 240 x 240 cells"


def _video() -> str:
    import av

    av.codec.Codec("libx264", "w")
    return _version("av")


def _torch() -> str:
    torch = importlib.import_module("torch")
    return f"torch {torch.__version__}, {torch.get_num_threads()} threads"


def _room() -> "Building":
    """A room of 4 m by 3 m, for probes."""
    from robosim.building import make_building
    from robosim.floorplan import FloorPlan

    return make_building(FloorPlan(occupancy=np.zeros((60, 80), np.uint8), resolution_m=0.05, name="room"))
