"""Robots that see and hear in buildings made from floor plans.

Start reading at ``robosim.episode``: one episode, whole, on one page.

Floor plans:

    read_plan        a floor plan from a file of any known format, or a shipped one by name
    plan_from_array  a floor plan from a NumPy array
    generate_plan    an invented one, from a seed
    GeneratorConfig  what kind of building is invented
    FloorPlan        which cells are free, occupied or unknown, and where they lie
    MapError         a floor plan that cannot be read or used
    write_ros        writes one as a ROS map
    write_png        writes one as an image

Buildings:

    make_building    a building made from a floor plan
    BuildingConfig   how it is made
    Building         walls, floor, ceiling: geometry and radio materials
    Furnishing       a mesh at a place in it
    make_piece       a table, chair, shelf, sofa, bed, cupboard or plant at a place
    read_furnishings  what a YAML file says is placed
    write_furnishings  writes such a file
    furnishing_from_file  a mesh file at a place
    reach            where a robot's hull can be in it
    Reach            these places
    export_mesh      writes it as GLB, PLY, OBJ or STL
    export_mitsuba   writes it as a Mitsuba scene with radio materials
    export_mjcf      writes it with a robot in it for MuJoCo

Simulation:

    Simulator        one robot in one building, what it does and senses
    SimulatorConfig  what is simulated, and how faithfully
    Observation      what the robot senses after an action
    RobotConfig      the robot's body
    NoiseModel       noise of actuation and odometry
    CameraConfig     size and optics of its pictures
    DepthNoise       noise of its depth camera

Environments to learn in:

    TargetSearch     the search for a target as a Gymnasium environment
    TargetSearchVector  many of them in one process
    sb3_vec_env      the same as a vector environment of Stable-Baselines3
    SearchConfig     what is observed, what is rewarded, which tasks there are
    GeneratedHomes   generated homes as a source of plans

Episodes:

    make_task        from where to where, drawn at random or given
    Task             one search in one building
    Anchor           a transmitter that is not searched
    with_anchors     a task with some of them
    run_episode      drives one robot through one search
    record_episode   the same, with a video and files to look at
    EpisodeConfig    how an episode is run
    EpisodeLog       everything that happened in it
    Step             one step: what was sensed, estimated, decided, and is true
    read_episode     reads a recorded episode
    GoalPolicy       what a goal policy does: derive yours from it
    PolicyContext    what it is made from
    Estimates        what a robot makes of what it senses
    Measurement      what it makes of what its radio measured

Evaluation:

    evaluate         runs policies over a suite of tasks, and scores them
    Suite            plans, and tasks in them
    find_suite       a suite from a file, or drawn in floor plans
    read_suite       a suite from a file

Radio:

    RadioScene       a floor plan made ready for radio
    RadioConfig      what is traced and how
    receiver_grid    receivers all over a building

Data sets:

    trace_plan       traces radio paths over a whole floor plan into files
    make_dataset     a data set of links for many buildings
    LinkSetConfig    what is in it
    collect          a data set of frames that a robot senses as it explores
    CollectConfig    what is in it
    LinkDataset      links of a data set for PyTorch
    FrameDataset     frames of a data set for PyTorch
"""

import logging
import os
import signal
import sys

# As a program (its name is "-m" as long as this is loaded by `python -m robosim`) it takes a second to load, in which
# there is nothing to tidy up: Ctrl-C ends it without a word. `robosim.__main__` gives the signal back.
if (
    os.path.basename(sys.argv[0]) in ("-m", "robosim")
    and signal.getsignal(signal.SIGINT) is signal.default_int_handler
):
    signal.signal(signal.SIGINT, lambda number, frame: os._exit(128 + number))

from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium

# So, as every name that is imported here otherwise is one of the public ones below.
_installation = import_module("robosim.support.installation")

#: Where each public name is: imported when it is first asked for, since not everybody needs everything.
_MODULES = {
    "read_plan": "plans.files",
    "plan_from_array": "plans.formats.plan_array",
    "generate_plan": "generator.generate",
    "GeneratorConfig": "generator.generate",
    "FloorPlan": "plans.floorplan",
    "MapError": "plans.floorplan",
    "write_ros": "plans.formats.ros_map",
    "write_png": "plans.formats.plan_image",
    "make_building": "building.building",
    "BuildingConfig": "building.building",
    "Building": "building.building",
    "Furnishing": "plans.furnishings.furnishing",
    "make_piece": "plans.furnishings.pieces",
    "read_furnishings": "plans.formats.furnishing_file",
    "write_furnishings": "plans.formats.furnishing_file",
    "furnishing_from_file": "plans.formats.furnishing_file",
    "reach": "building.reach",
    "Reach": "building.reach",
    "export_mesh": "building.mesh_export",
    "export_mitsuba": "building.mesh_export",
    "export_mjcf": "robot.mjcf",
    "Simulator": "simulator",
    "SimulatorConfig": "simulator",
    "Observation": "simulator",
    "RobotConfig": "robot.robots",
    "NoiseModel": "robot.odometry",
    "CameraConfig": "camera.model",
    "DepthNoise": "camera.depth_noise",
    "TargetSearch": "environments.target_search",
    "TargetSearchVector": "environments.target_search_vector",
    "sb3_vec_env": "environments.sb3",
    "SearchConfig": "environments.config",
    "GeneratedHomes": "environments.sources",
    "make_task": "task.tasks",
    "Task": "task.tasks",
    "run_episode": "episode",
    "record_episode": "run",
    "EpisodeConfig": "episode",
    "EpisodeLog": "episode_log",
    "Step": "step",
    "read_episode": "recording.episode_file",
    "evaluate": "evaluation.evaluate",
    "Suite": "evaluation.suite",
    "find_suite": "evaluation.evaluate",
    "read_suite": "evaluation.suite",
    "RadioScene": "radio.scene",
    "RadioConfig": "radio.scene",
    "receiver_grid": "radio.receivers",
    "trace_plan": "datasets.trace",
    "make_dataset": "datasets.links",
    "LinkSetConfig": "datasets.link_units",
    "collect": "datasets.collect",
    "CollectConfig": "datasets.collect",
    "LinkDataset": "datasets.torch_data",
    "FrameDataset": "datasets.torch_data",
    "Anchor": "task.tasks",
    "with_anchors": "task.tasks",
    "GoalPolicy": "policies.goals",
    "PolicyContext": "policies.goals",
    "Estimates": "policies.estimates",
    "Measurement": "radio.measurement",
}
#: What `from robosim import *` brings: data sets for PyTorch only where that is installed.
__all__ = ["__version__", *_MODULES]
if not _installation.is_installed("torch"):
    __all__ = [name for name in __all__ if _MODULES.get(name) != "datasets.torch_data"]

if (_trouble := _installation.namesake()) is not None:
    logging.getLogger(__name__).warning(_trouble)

# MuJoCo's EGL needs a newer PyOpenGL than the one that pyrender asks for: with MUJOCO_GL=egl, as many servers have it
# set, `import mujoco` would fail. Its renderer is not used here but to compare with.
if os.environ.get("MUJOCO_GL", "").lower() == "egl" and version("PyOpenGL") == "3.1.0":
    del os.environ["MUJOCO_GL"]

# MuJoCo imports glfw, which starts another Python to ask its library for the version. That costs time, and a signal in
# that moment leaves that Python's traceback on the terminal. Told where the library is, glfw starts none.
if (
    "PYGLFW_LIBRARY" not in os.environ
    and (_glfw := find_spec("glfw")) is not None
    and _glfw.origin is not None
):
    _windows = "wayland" if os.environ.get("XDG_SESSION_TYPE") == "wayland" else "x11"
    _library = Path(_glfw.origin).with_name(_windows) / "libglfw.so"
    if _library.is_file():
        os.environ["PYGLFW_LIBRARY"] = str(_library)

gymnasium.register(
    id="robosim/TargetSearch-v0",
    entry_point="robosim.environments.target_search:target_search_v0",
    max_episode_steps=1000,
)
gymnasium.register(
    id="robosim/TargetSearch-v1",
    entry_point="robosim.environments.target_search:TargetSearch",
    vector_entry_point="robosim.environments.target_search_vector:TargetSearchVector",
    max_episode_steps=1000,
)

if TYPE_CHECKING:
    from robosim.building.building import Building as Building
    from robosim.building.building import BuildingConfig as BuildingConfig
    from robosim.building.building import make_building as make_building
    from robosim.building.mesh_export import export_mesh as export_mesh
    from robosim.building.mesh_export import export_mitsuba as export_mitsuba
    from robosim.building.reach import Reach as Reach
    from robosim.building.reach import reach as reach
    from robosim.camera.depth_noise import DepthNoise as DepthNoise
    from robosim.camera.model import CameraConfig as CameraConfig
    from robosim.datasets.collect import CollectConfig as CollectConfig
    from robosim.datasets.collect import collect as collect
    from robosim.datasets.link_units import LinkSetConfig as LinkSetConfig
    from robosim.datasets.links import make_dataset as make_dataset
    from robosim.datasets.torch_data import FrameDataset as FrameDataset
    from robosim.datasets.torch_data import LinkDataset as LinkDataset
    from robosim.datasets.trace import trace_plan as trace_plan
    from robosim.environments.config import SearchConfig as SearchConfig
    from robosim.environments.sb3 import sb3_vec_env as sb3_vec_env
    from robosim.environments.sources import GeneratedHomes as GeneratedHomes
    from robosim.environments.target_search import TargetSearch as TargetSearch
    from robosim.environments.target_search_vector import TargetSearchVector as TargetSearchVector
    from robosim.episode import EpisodeConfig as EpisodeConfig
    from robosim.episode import run_episode as run_episode
    from robosim.episode_log import EpisodeLog as EpisodeLog
    from robosim.evaluation.evaluate import evaluate as evaluate
    from robosim.evaluation.evaluate import find_suite as find_suite
    from robosim.evaluation.suite import Suite as Suite
    from robosim.evaluation.suite import read_suite as read_suite
    from robosim.generator.generate import GeneratorConfig as GeneratorConfig
    from robosim.generator.generate import generate_plan as generate_plan
    from robosim.plans.files import read_plan as read_plan
    from robosim.plans.floorplan import FloorPlan as FloorPlan
    from robosim.plans.floorplan import MapError as MapError
    from robosim.plans.formats.furnishing_file import furnishing_from_file as furnishing_from_file
    from robosim.plans.formats.furnishing_file import read_furnishings as read_furnishings
    from robosim.plans.formats.furnishing_file import write_furnishings as write_furnishings
    from robosim.plans.formats.plan_array import plan_from_array as plan_from_array
    from robosim.plans.formats.plan_image import write_png as write_png
    from robosim.plans.formats.ros_map import write_ros as write_ros
    from robosim.plans.furnishings.furnishing import Furnishing as Furnishing
    from robosim.plans.furnishings.pieces import make_piece as make_piece
    from robosim.policies.estimates import Estimates as Estimates
    from robosim.policies.goals import GoalPolicy as GoalPolicy
    from robosim.policies.goals import PolicyContext as PolicyContext
    from robosim.radio.measurement import Measurement as Measurement
    from robosim.radio.receivers import receiver_grid as receiver_grid
    from robosim.radio.scene import RadioConfig as RadioConfig
    from robosim.radio.scene import RadioScene as RadioScene
    from robosim.recording.episode_file import read_episode as read_episode
    from robosim.robot.mjcf import export_mjcf as export_mjcf
    from robosim.robot.odometry import NoiseModel as NoiseModel
    from robosim.robot.robots import RobotConfig as RobotConfig
    from robosim.run import record_episode as record_episode
    from robosim.simulator import Observation as Observation
    from robosim.simulator import Simulator as Simulator
    from robosim.simulator import SimulatorConfig as SimulatorConfig
    from robosim.step import Step as Step
    from robosim.task.tasks import Anchor as Anchor
    from robosim.task.tasks import Task as Task
    from robosim.task.tasks import make_task as make_task
    from robosim.task.tasks import with_anchors as with_anchors

    __version__: str
else:

    def __getattr__(name: str) -> object:
        """A public name, imported when it is first asked for."""
        if name == "__version__":
            value: object = _installation.package_version()
        elif name in _MODULES:
            value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
