"""Cameras to compare, ours and others', behind one interface: a pose in, a depth picture out.

All see the same triangles. Each peer is used as its documentation says, without what costs time here for
nothing: MuJoCo without multisampling, pyrender in its flat mode.

pyrender's own OSMesa platform needs two things that PyOpenGL has from 3.1.10 on, but not in the version that
pyrender pins (3.1.0): `OSMesaCreateContextAttribs`, and contexts that can be hashed; MuJoCo's needs the type of EGL's
devices. Where they are missing they are added here, the way the newer version has them; pyrender and MuJoCo stay as
they are. On EGL stock pyrender takes four samples a pixel and reports the depth of one of them, which is not at the
pixel's centre: that is where its error comes from.

Modules are imported when a camera is made, since each has its own idea of what OpenGL runs on.
"""

import ctypes
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh

from robosim.camera.model import CameraConfig
from robosim.camera.rendering.gl_systems import SYSTEM_NAMES, GLSystem, complete_egl, prepare_pyopengl

#: Takes a picture from a pose T_map_camera and returns its depth [m], 0 where nothing was hit.
Shot = Callable[[np.ndarray], np.ndarray]

_CAMERA_TO_GL = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Peer:
    """One way to take pictures."""

    make: Callable[[trimesh.Trimesh, CameraConfig], Shot]
    label: str
    """How tables call it."""
    images: str
    """What it takes: "rgb+depth" or "depth"."""
    system: GLSystem | None = None
    """What it draws on, if with OpenGL."""

    @property
    def environment(self) -> dict[str, str]:
        """Variables that choose what it draws on; set before anything is imported."""
        return {"PYOPENGL_PLATFORM": self.system, "MUJOCO_GL": self.system} if self.system else {}


def _pyrender_camera(mesh: trimesh.Trimesh, config: CameraConfig) -> Shot:
    from robosim.camera.cameras import make_camera

    camera = make_camera([mesh], config)
    return lambda T_map_camera: camera.render(T_map_camera).depth


def _pyrender_depth(mesh: trimesh.Trimesh, config: CameraConfig) -> Shot:
    from robosim.camera.cameras import make_camera

    return make_camera([mesh], config).render_depth


def _embree_camera(mesh: trimesh.Trimesh, config: CameraConfig) -> Shot:
    from robosim.camera.cameras import make_camera

    camera = make_camera([mesh], config, backend="embree")
    return lambda T_map_camera: camera.render(T_map_camera).depth


def _embree_depth(mesh: trimesh.Trimesh, config: CameraConfig) -> Shot:
    from robosim.camera.cameras import make_camera

    return make_camera([mesh], config, backend="embree").render_depth


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
    """`mujoco.Renderer`, which draws once for the colours and once more for the depth."""
    renderer, look = _mujoco_renderer(mesh, config)

    def shot(T_map_camera: np.ndarray) -> np.ndarray:
        look(T_map_camera)
        renderer.disable_depth_rendering()
        renderer.render()
        renderer.enable_depth_rendering()
        return renderer.render()

    return shot


def _mujoco_renderer(mesh: trimesh.Trimesh, config: CameraConfig) -> tuple[Any, Callable[[np.ndarray], None]]:
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

    def look(T_map_camera: np.ndarray) -> None:
        data.cam_xpos[0] = T_map_camera[:3, 3] - centre
        data.cam_xmat[0] = (T_map_camera @ _CAMERA_TO_GL)[:3, :3].ravel()
        renderer.update_scene(data, "robot")

    return renderer, look


def _on(system: GLSystem) -> dict[str, Peer]:
    """The cameras that draw with OpenGL, on one of its systems."""
    name, suffix = SYSTEM_NAMES[system], "" if system == "osmesa" else f"-{system}"
    ours = f"robosim, pyrender on {name}"
    return {
        f"pyrender{suffix}": Peer(_pyrender_camera, ours, "rgb+depth", system),
        f"pyrender-depth{suffix}": Peer(_pyrender_depth, ours, "depth", system),
        f"stock{suffix}": Peer(_stock_pyrender, f"pyrender on {name}, stock, flat", "rgb+depth", system),
        f"mujoco{suffix}": Peer(_mujoco, f"mujoco.Renderer on {name}", "rgb+depth", system),
    }


#: All cameras, by name.
PEERS = {
    **_on("osmesa"),
    **_on("egl"),
    "embree": Peer(_embree_camera, "robosim, Embree", "rgb+depth"),
    "embree-depth": Peer(_embree_depth, "robosim, Embree", "depth"),
}
