"""Every OpenGL system that the machine has passes the rendering tests, and nothing of a display is needed.

A process can use one system only, so the other one is tested in processes of their own.
"""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from robosim.camera.rendering import gl_systems
from robosim.camera.rendering.gl_systems import SYSTEM_NAMES, bind_opengl, default_system, missing

ROOT = Path(__file__).resolve().parents[4]
RENDERING_TESTS = (
    "robosim/camera/test_cameras.py",
    "robosim/camera/rendering/test_gl_platforms.py",
)
# Far more than the half minute that they take, for a busy machine; and less than for ever.
LIMIT_S = 1800.0


def environment(**settings: str) -> dict[str, str]:
    """This process's environment without what it has chosen itself, and with some settings."""
    own = ("PYOPENGL_PLATFORM", "MUJOCO_GL", "LP_NUM_THREADS", "PYTEST_")
    return {name: value for name, value in os.environ.items() if not name.startswith(own)} | settings


def test_the_other_system_passes_the_rendering_tests_too(tmp_path):
    """On a machine with OSMesa and EGL: this run takes the first, and a child process the second."""
    (other,) = set(SYSTEM_NAMES) - {default_system()}
    if lack := missing(other):
        pytest.skip(str(lack))
    options = ["-q", "-p", "no:cacheprovider", "--basetemp", str(tmp_path / "child"), "-k", "not embree"]
    child = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *(str(ROOT / "tests" / name) for name in RENDERING_TESTS)],
        cwd=ROOT,
        env=environment(PYOPENGL_PLATFORM=other),
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
    )
    assert child.returncode == 0, f"on {SYSTEM_NAMES[other]}:\n{child.stdout}{child.stderr}"


ALL_THAT_DRAWS = """
import sys
import numpy as np, trimesh
from robosim.camera.cameras import make_camera
from robosim.camera.model import CameraConfig, camera_pose
room = trimesh.creation.box((4.0, 3.0, 2.5)); room.invert()
room.visual.vertex_colors = np.full((8, 4), 255, np.uint8)
with make_camera([room]) as camera:
    T = camera_pose(np.array([0.0, 0.0, 0.0]), CameraConfig(height_m=0.1))
    assert abs(camera.render(T).depth[64, 64] - 2.0) < 1e-3
print("pyglet" in sys.modules)
print(*{line.split()[-1] for line in open("/proc/self/maps") if ".so" in line})
"""


@pytest.mark.skipif(
    not Path("/proc/self/maps").exists(), reason="needs Linux to see what a process has loaded"
)
@pytest.mark.parametrize("system", SYSTEM_NAMES)
def test_pictures_need_nothing_of_a_display(system):
    """A camera loads neither pyglet nor libGL nor X.

    As it comes, pyrender imports its viewer, so that `import pyrender` fails in a bare container; and PyOpenGL
    loads libGL for EGL. Mesa's own EGL is linked with X's libraries in most distributions, which install them
    with it: there, only libGL counts. Libraries that come inside of Python packages do not count.
    """
    if lack := missing(system):
        pytest.skip(str(lack))
    command = [sys.executable, "-c", ALL_THAT_DRAWS]
    done = subprocess.run(
        command, env=environment(PYOPENGL_PLATFORM=system), capture_output=True, text=True, timeout=LIMIT_S
    )
    assert done.returncode == 0, done.stderr
    pyglet, libraries = done.stdout.splitlines()
    assert pyglet == "False"
    unwanted = ("libGL.", "libGLX") if system == "egl" else ("libGL.", "libGLX", "libX", "libxcb", "libEGL")
    installed = [Path(path).name for path in libraries.split() if "site-packages" not in path]
    assert any(name.startswith("libOSMesa" if system == "osmesa" else "libOpenGL") for name in installed)
    assert [name for name in installed if name.startswith(unwanted)] == []


@pytest.fixture
def bare_machine(monkeypatch) -> pytest.MonkeyPatch:
    """A machine without OSMesa and EGL."""
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    for system, libraries in gl_systems._LIBRARIES.items():
        absent = tuple((("libnone.so.1",), trouble) for _, trouble in libraries)
        monkeypatch.setitem(gl_systems._LIBRARIES, system, absent)
    return monkeypatch


def test_without_opengl_the_message_names_packages_and_the_fallback(bare_machine):
    """Both systems with what to install, and the engine that needs none."""
    with pytest.raises(OSError, match=r"libosmesa6.*libegl1 libopengl0 libgl1-mesa-dri.*--camera embree"):
        default_system()


def test_a_system_that_is_asked_for_but_missing_is_named(bare_machine):
    """PYOPENGL_PLATFORM=egl left over in an environment: EGL's packages are named, and that it can be unset."""
    bare_machine.setenv("PYOPENGL_PLATFORM", "egl")
    with pytest.raises(OSError, match=r"^PYOPENGL_PLATFORM=egl, but EGL is not installed\..*libegl1.* unset"):
        default_system()


def test_the_other_system_is_named_where_that_is_installed(bare_machine):
    """PYOPENGL_PLATFORM=osmesa, but EGL alone is there: the remedy names egl. So does that of a display's PyOpenGL."""
    bare_machine.setitem(gl_systems._LIBRARIES, "egl", ((("libc.so.6",), ""),) * 2)
    bare_machine.setenv("PYOPENGL_PLATFORM", "osmesa")
    with pytest.raises(OSError, match="or set PYOPENGL_PLATFORM=egl, which is installed"):
        default_system()
    bare_machine.setitem(sys.modules, "OpenGL.platform", SimpleNamespace(PLATFORM=object()))
    with pytest.raises(RuntimeError, match=r"could choose EGL.* PYOPENGL_PLATFORM=egl before Python starts"):
        bind_opengl()


def test_a_setting_that_names_no_system_is_left_aside(bare_machine):
    """PYOPENGL_PLATFORM=x11, as another program may need it, does not hinder a camera where EGL is there."""
    bare_machine.setenv("PYOPENGL_PLATFORM", "x11")
    bare_machine.setitem(gl_systems._LIBRARIES, "egl", ((("libc.so.6",), ""),) * 2)
    assert default_system() == "egl"
