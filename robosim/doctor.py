"""Diagnosis of the machine: components that work, their speed, and remedies for the others.

Libraries are imported by the probe that needs them, so that a missing one is a finding and no crash. What to do
follows from the error (`remedy`), since any probe may stumble over what it shares with others: a package that cannot be
imported, or a folder that cannot be written.
"""

import importlib.metadata
import json
import os
import platform
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robosim.camera.rendering.gl_systems import (
    INSTALL,
    SYSTEM_NAMES,
    GLSystem,
    OpenGLError,
    bind_opengl,
    default_system,
    missing,
)
from robosim.support.installation import DISTRIBUTION, EXTRAS, install_command, is_installed, package_version

if TYPE_CHECKING:
    from robosim.building.building import Building

_CAMERA = "camera"
# A camera takes two seconds, where loops have to be compiled some minutes.
_PATIENCE_S = 900.0
#: No cache folder is writable.
CACHE_REMEDY = "set NUMBA_CACHE_DIR to a folder that you may write, so that compiled code is cached"

# Packages that are not called like their modules, or come with another one.
_PACKAGES = {
    "cv2": "opencv-contrib-python-headless",
    "PIL": "pillow",
    "yaml": "pyyaml",
    "OpenGL": "PyOpenGL==3.1.0",
}
_LIBRARY = re.compile(r"(lib[\w.+-]+\.so[.\d]*): cannot open shared object file")


@dataclass(frozen=True)
class Finding:
    """The outcome of one check."""

    component: str
    works: bool
    detail: str
    """Result and measured rate, or the error."""
    fix: str = ""
    """Package to install, or another remedy."""
    needed: bool = True
    """Whether robosim cannot do its main job without it."""


def examine() -> list[Finding]:
    """Run all checks; none of them raises."""
    systems = _systems()
    fits = (3, 11) <= sys.version_info[:2] < (3, 15)
    return [
        Finding("python", fits, platform.python_version(), "" if fits else "use Python 3.11 to 3.14"),
        _check("compiled loops", "numba", _compiled_loops, needed=False),
        _check("fast marching", "numba", _fast_marching),
        _check("mujoco", "mujoco", _mujoco),
        _check("embree", "embreex", _embree),
        *systems.values(),
        _camera(systems),
        _check("opencv ArUco", "cv2", _aruco),
        _check("video (H.264)", "av", _video),
        _check("learned mapper", "onnxruntime", _mapper),
        *(_extra(module) for module in EXTRAS),
    ]


def report(findings: list[Finding], console: Console) -> bool:
    """Print the findings as a table, and return whether the main job can be done."""
    console.print(
        f"robosim {package_version()} on Python {platform.python_version()}, "
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    )
    table = Table(box=None, pad_edge=False)
    for column in ("part", "", "what was found", "what to do"):
        table.add_column(column, overflow="fold")
    for finding in findings:
        colour = "green" if finding.works else "red" if finding.needed else "yellow"
        absent = not finding.needed and finding.detail.endswith("is not installed.")
        state = Text("works" if finding.works else "absent" if absent else "fails", colour)
        # As they are, whether or not the console takes brackets for markup.
        table.add_row(Text(finding.component), state, Text(finding.detail), Text(finding.fix))
    console.print(table)
    broken = [finding.component for finding in findings if finding.needed and not finding.works]
    if not broken:
        console.print("All that the main job needs is here. Next: robosim episode flat --out out/first")
    elif broken == [_CAMERA]:
        console.print("No pictures by OpenGL. Until then pass --camera embree, which needs none.")
    else:
        console.print(f"Mend first: {', '.join(broken)}. Then run robosim doctor again.")
    return not broken


def _check(
    component: str, module: str, probe: Callable[[], str | Finding], *, needed: bool = True
) -> Finding:
    # A broken library may raise anything at all at import, and the report is there to say so.
    try:
        outcome = probe()
    except Exception as error:
        said = str(error).strip().splitlines() or [type(error).__name__]
        trouble = error.trouble if isinstance(error, OpenGLError) else said[0]
        return Finding(component, False, trouble, remedy(error, module), needed)
    return outcome if isinstance(outcome, Finding) else Finding(component, True, outcome, needed=needed)


def _systems() -> dict[GLSystem, Finding]:
    """Whether pyrender draws on each OpenGL system; one that is not installed is not needed if another draws."""
    findings = {system: _system(system) for system in SYSTEM_NAMES}
    drawing = [SYSTEM_NAMES[system] for system, finding in findings.items() if finding.works]
    return {
        system: replace(finding, fix=f"nothing: {drawing[0]} draws")
        if drawing and missing(system)
        else finding
        for system, finding in findings.items()
    }


def _system(system: GLSystem) -> Finding:
    """Whether pyrender draws on an OpenGL system, in a process of its own, which a broken driver may take down."""
    name = f"pyrender on {SYSTEM_NAMES[system]}"
    if lack := missing(system):
        return Finding(name, False, lack.trouble, lack.remedy, needed=False)
    program = f"from robosim.doctor import print_camera_finding; print_camera_finding({system!r})"
    try:
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=_PATIENCE_S
        )
    except subprocess.TimeoutExpired:
        detail = f"no picture within {_PATIENCE_S:.0f} s"
        return Finding(name, False, detail, f"reinstall Mesa's driver: {INSTALL[system]}", needed=False)
    try:
        return Finding(name, **json.loads(done.stdout.splitlines()[-1]), needed=False)
    except (IndexError, TypeError, ValueError):
        last = [line for line in done.stderr.splitlines() if line.strip()][-1:]
        detail = " ".join([f"the driver ended the process with status {done.returncode}.", *last])
        return Finding(name, False, detail, f"reinstall Mesa's driver: {INSTALL[system]}", needed=False)


def print_camera_finding(system: GLSystem) -> None:
    """Draw a room on one OpenGL system, check a depth, and write what came of it to standard output as JSON."""
    finding = _check("", "pyrender", lambda: _measure_camera(system))
    result = {"works": finding.works, "detail": finding.detail, "fix": finding.fix}
    sys.stdout.write(json.dumps(result) + "\n")


def _measure_camera(system: GLSystem) -> str:
    from robosim.camera.cameras import make_camera
    from robosim.camera.model import CameraConfig, camera_pose
    from robosim.camera.rendering.shading import shaded_mesh

    config = CameraConfig()
    bind_opengl(system)
    camera = make_camera([shaded_mesh(_room())], config, backend="pyrender")
    pose = camera_pose(np.array([1.0, 1.0, 0.0]), config)
    depth = float(camera.render(pose).depth[config.height // 2, config.width // 2])
    if abs(depth - 3.0) > 0.01:
        raise RuntimeError(f"a wall 3 m away is drawn at {depth:.3f} m")
    rate = _rate(lambda: camera.render(pose))
    camera.close()
    return f"{rate:,.0f} RGB-D frames/s at {config.width} x {config.height}"


def _camera(systems: dict[GLSystem, Finding]) -> Finding:
    """Report the OpenGL system that a camera takes, why, and whether it works."""
    setting = os.environ.get("PYOPENGL_PLATFORM", "")
    is_set = setting.lower() in SYSTEM_NAMES
    working = [system for system, finding in systems.items() if finding.works]
    try:
        taken = default_system()
    except OpenGLError as error:
        fix = f"unset PYOPENGL_PLATFORM: {SYSTEM_NAMES[working[0]]} works" if working else error.remedy
        return Finding(_CAMERA, False, error.trouble, fix)
    name = SYSTEM_NAMES[taken]
    if is_set:
        why = f"PYOPENGL_PLATFORM={setting} selects it"
    elif taken == "osmesa":
        why = "the first choice"
    else:
        why = "OSMesa, the first choice, is not installed"
    if setting and not is_set:
        why += f"; PYOPENGL_PLATFORM={setting} is neither osmesa nor egl, and is left aside"
    if systems[taken].works:
        return Finding(_CAMERA, True, f"draws on {name}: {why}")
    if not working:
        fix = systems[taken].fix or INSTALL["osmesa"]
    elif is_set:
        fix = f"unset PYOPENGL_PLATFORM: {SYSTEM_NAMES[working[0]]} works"
    else:
        fix = f"set PYOPENGL_PLATFORM={working[0]}, which works"
    return Finding(_CAMERA, False, f"would draw on {name} ({why}), which does not work", fix)


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


def _compiled_loops() -> Finding:
    import_module("numba")
    from robosim.support.compiled import cache_folders, writable_folder

    folder = writable_folder(cache_folders())
    if folder is not None:
        return Finding("compiled loops", True, f"{_version('numba')}, cached in {folder}", needed=False)
    detail = f"{_version('numba')}, compiled by each process (about a minute)"
    return Finding("compiled loops", False, detail, CACHE_REMEDY, needed=False)


def _fast_marching() -> str:
    from slam.planning.marching import march

    speed = np.ones((240, 240))
    rate = _rate(lambda: march(speed, (120, 120), 1.0))
    return f"{1000 / rate:.1f} ms for 240 x 240 cells"


def _mujoco() -> str:
    from robosim.robot.dynamic import World
    from robosim.robot.physics_engine import mujoco

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


def _aruco() -> str:
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    marker = np.pad(cv2.aruco.generateImageMarker(dictionary, 7, 60), 20, constant_values=255)
    _, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(marker)
    if ids is None or ids.ravel().tolist() != [7]:
        raise RuntimeError("a clean marker is not recognised")
    return f"opencv {cv2.__version__}, a marker is recognised"


def _video() -> str:
    import av

    av.codec.Codec("libx264", "w")
    return _version("av")


def _mapper() -> str:
    from robosim.support.installation import shipped_network
    from slam.networks.files import load_mapper
    from slam.networks.map_network import MapPredictor
    from slam.sensing.egocentric import AHEAD
    from slam.sensing.projection import CameraModel, scan_from_depth

    predictor = MapPredictor(load_mapper(shipped_network("mapper"))[0])
    scan = scan_from_depth(np.full((128, 128), 2.0, np.float32), CameraModel())
    unknown = np.full(AHEAD.shape, 0.5, np.float32)
    rate = _rate(lambda: predictor.predict(scan, unknown))
    return f"{_version('onnxruntime')}, {1000 / rate:.1f} ms a frame"


def _extra(module: str) -> Finding:
    name = f"extra {EXTRAS[module]}"
    if not is_installed(module):
        return Finding(
            name, False, f"{module} is not installed.", install_command(EXTRAS[module]), needed=False
        )

    def version() -> str:
        number = getattr(import_module(module), "__version__", None)
        return f"{module} {number or package_version(module)}"

    return _check(name, module, version, needed=False)


def _room() -> "Building":
    """A room of 4 m by 3 m, for probes."""
    from robosim.building.building import make_building
    from robosim.plans.floorplan import FloorPlan

    return make_building(FloorPlan(occupancy=np.zeros((60, 80), np.uint8), resolution_m=0.05, name="room"))


def remedy(error: BaseException, module: str) -> str:
    """Remedy for an error that was raised while a Python module was being tried."""
    text = str(error)
    if isinstance(error, PermissionError) and error.filename:
        return f"get permission to use {error.filename}"
    if isinstance(error, OpenGLError):
        return error.remedy
    name = error.name if isinstance(error, ImportError) else None
    if name and (
        _installed(name) or not name.startswith("_")
    ):  # a package, and not a part of one, as torch's _C
        module = name
    if (extra := EXTRAS.get(module.partition(".")[0])) and not _installed(module):
        return install_command(extra)
    if not _installed(module):
        return f"pip install '{_requirement(module)}'"
    again = f"pip install --force-reinstall --no-deps '{_requirement(module)}'"
    if library := _LIBRARY.search(text):
        return f"install the system's package that has {library[1]}; if it is one of {module}'s own: {again}"
    return again if isinstance(error, ImportError | OSError) else f"not known; perhaps {again}"


def _installed(module: str) -> bool:
    try:
        importlib.metadata.version(_package(module).partition("==")[0])
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def _package(module: str) -> str:
    top = module.partition(".")[0]
    return _PACKAGES.get(top, top)


def _requirement(module: str) -> str:
    """Requirement of pip for a module, by this project's own requirements if they have one."""
    package = _package(module)
    try:
        stated = importlib.metadata.requires(DISTRIBUTION) or []
    except importlib.metadata.PackageNotFoundError:
        stated = []
    for requirement in stated:
        if "extra ==" not in requirement and re.match(
            rf"{re.escape(package)}(?![\w.-])", requirement, re.IGNORECASE
        ):
            return requirement
    return package
