"""Cameras of others, and ours, behind one interface: a pose in, a depth picture out.

All draw the same triangles, each as documented, without what costs time here for nothing: MuJoCo without
multisampling, pyrender in its flat mode. pyrender's OSMesa platform and MuJoCo's EGL need parts that the PyOpenGL of
pyrender's version (3.1.0) lacks; they are added as PyOpenGL 3.1.10 has them. On EGL stock pyrender takes four samples a
pixel and reports the depth of one of them, which is not at the pixel's centre.
"""

import ctypes
import os
from collections.abc import Callable
from typing import Literal

import numpy as np
import trimesh

from robosim.camera.model import CameraConfig
from robosim.camera.rendering.gl_systems import complete_egl, prepare_pyopengl

#: Takes a picture from a pose T_map_camera and returns its depth [m], 0 where nothing was hit.
Shot = Callable[[np.ndarray], np.ndarray]

_CAMERA_TO_GL = np.diag([1.0, -1.0, -1.0, 1.0])


def _ours(
    backend: Literal["pyrender", "embree"],
) -> Callable[[trimesh.Trimesh, CameraConfig], Shot]:
    def make(mesh: trimesh.Trimesh, config: CameraConfig) -> Shot:
        from robosim.camera.cameras import make_camera

        camera = make_camera([mesh], config, backend=backend)
        return lambda pose: camera.render(pose).depth

    return make


def _stock_pyrender(mesh: trimesh.Trimesh, config: CameraConfig) -> Shot:
    """`pyrender.OffscreenRenderer` in flat mode, about the mesh's centre to spare it single precision."""
    _complete_pyopengl()
    import pyrender

    near = mesh.copy()
    near.vertices -= mesh.bounds.mean(axis=0)
    scene = pyrender.Scene(bg_color=(0.0, 0.0, 0.0, 1.0))
    scene.add(pyrender.Mesh.from_trimesh(near))
    f = config.focal_px
    lens = pyrender.IntrinsicsCamera(
        f, f, 0.5 * config.width, 0.5 * config.height, znear=config.near_m, zfar=config.far_m
    )
    node = scene.add(lens)
    renderer = pyrender.OffscreenRenderer(config.width, config.height)
    shift = np.eye(4)
    shift[:3, 3] = -mesh.bounds.mean(axis=0)

    def shot(T_map_camera: np.ndarray) -> np.ndarray:
        scene.set_pose(node, shift @ T_map_camera @ _CAMERA_TO_GL)
        return renderer.render(scene, flags=pyrender.RenderFlags.FLAT)[1]

    return shot


def _complete_pyopengl() -> None:
    """Give an old PyOpenGL what newer ones have of OSMesa and EGL; without a display's libraries."""
    prepare_pyopengl()
    if os.environ["PYOPENGL_PLATFORM"] == "egl":
        complete_egl()
        return
    from OpenGL import osmesa, platform
    from OpenGL.raw.osmesa._types import OSMesaContext

    if hasattr(osmesa, "OSMesaCreateContextAttribs"):
        return

    class HashedContext(OSMesaContext):
        _type_ = OSMesaContext._type_

        def __hash__(self) -> int:
            return ctypes.addressof(self.contents)

    platform.GetCurrentContext.restype = HashedContext
    create = platform.PLATFORM.OSMesa.OSMesaCreateContextAttribs
    create.restype, create.argtypes = OSMesaContext, [ctypes.c_void_p, ctypes.c_void_p]
    osmesa.OSMesaCreateContextAttribs = create
    constants = {"FORMAT": 0x22, "RGBA": 0x1908, "DEPTH_BITS": 0x30, "PROFILE": 0x33, "CORE_PROFILE": 0x34}
    constants |= {"CONTEXT_MAJOR_VERSION": 0x36, "CONTEXT_MINOR_VERSION": 0x37}
    for name, value in constants.items():
        setattr(osmesa, f"OSMESA_{name}", value)


def _mujoco(mesh: trimesh.Trimesh, config: CameraConfig) -> Shot:
    """`mujoco.Renderer`, which draws once for the colours and once for the depth."""
    _complete_pyopengl()
    import mujoco

    centre = mesh.bounds.mean(axis=0)
    spec = mujoco.MjSpec()
    spec.add_mesh(
        name="building",
        uservert=(mesh.vertices - centre).ravel(),
        userface=mesh.faces.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="building", contype=0, conaffinity=0)
    half = 0.5 * config.height / config.focal_px
    spec.worldbody.add_camera(name="robot", fovy=2 * np.degrees(np.arctan(half)))
    model = spec.compile()
    model.vis.quality.offsamples = 0
    model.vis.global_.offwidth, model.vis.global_.offheight = config.width, config.height
    model.vis.map.znear = config.near_m / model.stat.extent
    model.vis.map.zfar = config.far_m / model.stat.extent
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer = mujoco.Renderer(model, config.height, config.width)

    def shot(T_map_camera: np.ndarray) -> np.ndarray:
        data.cam_xpos[0] = T_map_camera[:3, 3] - centre
        data.cam_xmat[0] = (T_map_camera @ _CAMERA_TO_GL)[:3, :3].ravel()
        renderer.update_scene(data, "robot")
        renderer.disable_depth_rendering()
        renderer.render()
        renderer.enable_depth_rendering()
        return renderer.render()

    return shot


#: The camera that others are compared with.
OURS = "robosim"
#: What makes a camera from a mesh: ours and others, on the OpenGL system of the environment, and Embree.
CAMERAS: dict[str, Callable[[trimesh.Trimesh, CameraConfig], Shot]] = {
    OURS: _ours("pyrender"),
    "pyrender": _stock_pyrender,
    "mujoco.Renderer": _mujoco,
    "Embree": _ours("embree"),
}
