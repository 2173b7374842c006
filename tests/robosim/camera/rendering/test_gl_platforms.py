"""OpenGL contexts: memory, processes, threads, and other programs that draw in the same process."""

import multiprocessing
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from robosim.camera.cameras import make_camera
from robosim.camera.model import RGBD, CameraConfig
from robosim.camera.rendering.gl_systems import SYSTEM_NAMES, bind_opengl, default_system, missing
from tests.robosim.camera.pictures import room, same


def test_cameras_of_different_sizes_take_turns(view):
    """Two contexts used in turns, and again after a third came and went, give what each gives alone."""
    small, wide = CameraConfig(width=48, height=48), CameraConfig(width=100, height=37, hfov_deg=60.0)
    with make_camera([room()], small) as one, make_camera([room((9.0, 9.0, 2.5))], wide) as other:
        first, second = one.render(view), other.render(view)
        for _ in range(3):
            with make_camera([room()], wide) as third:
                assert not same(third.render(view), second)
            assert same(one.render(view), first)
            assert same(other.render(view), second)


def test_frames_are_the_callers_own(view):
    """A frame does not change when the next one is taken."""
    with make_camera([room()], CameraConfig()) as camera:
        stored = camera.render(view)
        copy = RGBD(stored.rgb.copy(), stored.depth.copy())
        view[0, 3] += 0.5
        assert not same(camera.render(view), copy)
    assert same(stored, copy)


def resident_kib() -> int:
    """Memory of this process [KiB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs Linux to measure memory")
def test_memory_does_not_grow_with_frames_or_cameras(view):
    """2000 frames and 30 cameras: less than 2 and 6 MiB (measured 0 and 1).

    Stock pyrender on OSMesa keeps the shaders of each frame, 0.5 MiB of them.
    """
    config = CameraConfig(width=32, height=32)
    with make_camera([room()], config) as camera:
        for _ in range(50):
            camera.render(view)
        before = resident_kib()
        for _ in range(2000):
            camera.render(view)
        assert resident_kib() - before < 2048
    for count in range(40):
        if count == 10:
            before = resident_kib()
        with make_camera([room()], config) as camera:
            camera.render(view)
    assert resident_kib() - before < 6144


def shoot(queue: multiprocessing.Queue, T: np.ndarray) -> None:
    """Take a picture of the empty room with a new camera, and send it."""
    with make_camera([room()], CameraConfig()) as camera:
        queue.put(tuple(camera.render(T)))


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_worker_processes_take_the_same_picture(method, view, monkeypatch):
    """Also where the parent has drawn before it forks: llvmpipe's threads would not be there in the child."""
    with make_camera([room()], CameraConfig()) as camera:
        expected = camera.render(view)
        context = multiprocessing.get_context(method)
        queue = context.Queue()
        monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)
        worker = context.Process(target=shoot, args=(queue, view))
        worker.start()
        got = RGBD(*queue.get(timeout=1200))
        worker.join(60)
        assert worker.exitcode == 0
        assert same(got, expected)
        assert same(camera.render(view), expected)


def test_threads_with_a_camera_each_do_not_disturb_each_other(view):
    """Three threads of 50 frames; and a camera made in one thread works in another."""
    results: list[bool] = []
    with make_camera([room()], CameraConfig()) as made_here:
        expected = made_here.render(view)

        def work() -> None:
            with make_camera([room()], CameraConfig()) as own:
                results.append(all(same(own.render(view), expected) for _ in range(50)))

        threads = [threading.Thread(target=work) for _ in range(3)]
        threads.append(
            threading.Thread(target=lambda: results.append(same(made_here.render(view), expected)))
        )
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert results == [True] * 4


def run_alone(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run Python code in a process of its own, which has imported nothing yet."""
    unset = {"PYOPENGL_PLATFORM", "MUJOCO_GL", "LP_NUM_THREADS"}
    clean = {name: value for name, value in os.environ.items() if name not in unset}
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=1200, env=clean | environment
    )


ROOM_FROM_TRIMESH = """
import numpy as np, trimesh
room = trimesh.creation.box((4.0, 3.0, 2.5)); room.invert(); room.apply_translation((0, 0, 1.25))
room.visual.vertex_colors = np.full((8, 4), 255, np.uint8)
"""


def test_a_servers_setting_for_mujoco_is_no_obstacle():
    """MUJOCO_GL=egl made `import mujoco` fail with the old PyOpenGL that pyrender requires."""
    result = run_alone("import robosim.robot.dynamic", MUJOCO_GL="egl")
    assert result.returncode == 0, result.stderr


def test_names_of_mesa_stay_its_own():
    """PyTorch's compiler (Triton) brings an LLVM as Mesa does: with Mesa's names for all, it crashed when imported."""
    drawn = """
import ctypes
from robosim.camera.cameras import make_camera
with make_camera([room]) as camera:
    camera.render(np.eye(4))
everybodys = ctypes.CDLL(None)
names = "OSMesaCreateContextAttribs", "LLVMContextCreate", "eglInitialize"
print([name for name in names if hasattr(everybodys, name)])
"""
    result = run_alone(ROOM_FROM_TRIMESH + drawn)
    assert result.stdout == "[]\n", result.stderr


def test_mujocos_renderer_works_in_the_same_process():
    """On the same system, frames in turns, both closed: a wall 2 m ahead is at 2 m for both, every time.

    MuJoCo is configured after robosim has been imported, which clears MUJOCO_GL=egl (see above).
    """
    system = default_system()
    result = run_alone(
        ROOM_FROM_TRIMESH
        + f"""
import os
from robosim.camera.cameras import make_camera
from robosim.camera.model import CameraConfig, camera_pose
os.environ["MUJOCO_GL"] = {system!r}
camera = make_camera([room], CameraConfig())
T = camera_pose(np.zeros(3), CameraConfig())
depths = [camera.render(T).depth[64, 64]]
import mujoco
model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
<geom type="box" size=".1 9 9" pos="2.1 0 0"/><camera name="c" xyaxes="0 -1 0 0 0 1"/></worldbody></mujoco>''')
data = mujoco.MjData(model); mujoco.mj_forward(model, data)
renderer = mujoco.Renderer(model, 64, 64); renderer.enable_depth_rendering()
for _ in range(3):
    renderer.update_scene(data, "c")
    depths += [renderer.render()[32, 32], camera.render(T).depth[64, 64]]
renderer.render(); renderer.close()  # closed while it is the current one, it asks PyOpenGL which one is
depths.append(camera.render(T).depth[64, 64]); camera.close()
assert np.abs(np.array(depths) - 2).max() < 1e-3, depths
""",
        PYOPENGL_PLATFORM=system,
    )
    assert result.returncode == 0, result.stderr


def test_the_other_system_draws_the_same_picture(view, tmp_path):
    """Depth and colours of OSMesa and EGL agree on a machine that has both; two cameras, one closed early."""
    (other,) = set(SYSTEM_NAMES) - {default_system()}
    if lack := missing(other):
        pytest.skip(str(lack))
    with make_camera([room()], CameraConfig()) as camera:
        expected = camera.render(view)
    np.savez(tmp_path / "room.npz", view=view, colours=room().visual.vertex_colors)
    result = run_alone(
        ROOM_FROM_TRIMESH
        + f"""
from robosim.camera.cameras import make_camera
from robosim.camera.model import CameraConfig
from robosim.camera.rendering.gl_systems import bind_opengl
bind_opengl({other!r})
saved = np.load({str(tmp_path / "room.npz")!r})
room.visual.vertex_colors = saved["colours"]
first, second = (make_camera([room], CameraConfig()) for _ in range(2))
first.render(saved["view"]); first.close()
rgb, depth = second.render(saved["view"])
np.savez({str(tmp_path / "other.npz")!r}, rgb=rgb, depth=depth); second.close()
"""
    )
    assert result.returncode == 0, result.stderr
    got = np.load(tmp_path / "other.npz")
    assert np.abs(got["depth"] - expected.depth).max() < 1e-3
    assert np.abs(got["rgb"].astype(int) - expected.rgb).max() <= 1


def test_a_process_can_use_one_opengl_only():
    """After OSMesa, EGL is rejected by name instead of drawing nothing; and the reverse."""
    used = bind_opengl()
    (other,) = set(SYSTEM_NAMES) - {used}
    with (
        make_camera([room()], CameraConfig()),
        pytest.raises(RuntimeError, match=f"'{other}', but this process already uses '{used}'"),
    ):
        bind_opengl(other)


def test_pyopengl_for_a_display_is_reported(monkeypatch):
    """Where something bound PyOpenGL to a display first, the message says what to do."""
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    result = run_alone(
        """
import sys, types
class GLXPlatform: pass
sys.modules["OpenGL.platform"] = types.SimpleNamespace(PLATFORM=GLXPlatform())
from robosim.camera.rendering.gl_systems import bind_opengl
bind_opengl()
"""
    )
    assert f"set PYOPENGL_PLATFORM={default_system()} before Python starts" in result.stderr
