"""Mapping and moving: RGB-D and odometry in, map, pose, goals and actions out.

Knows nothing of the simulator or of radio: plain arrays come in and go out.

Mapping:

    ClassicalMapper   builds a map while finding the robot on it
    MapperConfig      its settings
    Mapper            what every mapper does
    NeuralMapper      also guesses what lies behind, by a network
    load_mapper       that network, from a file
    LearnedMatcher    finds the pose by a network instead of scan matching
    load_pose         that network, from a file
    MapEstimate       what a mapper believes: map and pose
    GridFrame         where the cells of a map lie
    CameraModel       the depth camera
    Band              heights above the floor that stop the robot
    OdometryConfig    what is known of odometry's errors

Moving:

    Planner           plans a path to a goal on a growing map
    PlannerConfig     costs of paths, and how often to plan again
    CostConfig        cost per metre
    Plan              a path to a goal
    Controller        chooses actions along it
    LocalPolicy       what every chooser of actions does
    ControlConfig     how actions are chosen
    load_steering     a controller that has learned to, from a file
    Action            what the robot can do in one decision

Exploring:

    FrontierExplorer  chooses goals until nothing is left to see
    Explorer          what every explorer does
    ExplorerConfig    how frontiers are found and rated
    load_chooser      a rating that was learned, from a file
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING

#: Module of each public name; imported at first access.
_MODULES = {
    "ClassicalMapper": "mapping.classical",
    "MapperConfig": "mapping.classical",
    "Mapper": "mapping.classical",
    "NeuralMapper": "mapping.neural",
    "load_mapper": "networks.files",
    "LearnedMatcher": "mapping.learned_matching",
    "load_pose": "networks.files",
    "MapEstimate": "grid",
    "GridFrame": "grid",
    "CameraModel": "sensing.projection",
    "Band": "sensing.projection",
    "OdometryConfig": "mapping.odometry",
    "Planner": "planning.planner",
    "PlannerConfig": "planning.planner",
    "CostConfig": "planning.cost_map",
    "Plan": "planning.planner",
    "Controller": "control.controller",
    "ControlConfig": "control.controller",
    "load_steering": "control.learned",
    "Action": "actions",
    "FrontierExplorer": "exploration.explorer",
    "ExplorerConfig": "exploration.explorer",
    "load_chooser": "exploration.choosing",
    "Explorer": "exploration.explorer",
    "LocalPolicy": "control.controller",
}
__all__ = ["__version__", *_MODULES]

if TYPE_CHECKING:
    from slam.actions import Action as Action
    from slam.control.controller import ControlConfig as ControlConfig
    from slam.control.controller import Controller as Controller
    from slam.control.controller import LocalPolicy as LocalPolicy
    from slam.control.learned import load_steering as load_steering
    from slam.exploration.choosing import load_chooser as load_chooser
    from slam.exploration.explorer import Explorer as Explorer
    from slam.exploration.explorer import ExplorerConfig as ExplorerConfig
    from slam.exploration.explorer import FrontierExplorer as FrontierExplorer
    from slam.grid import GridFrame as GridFrame
    from slam.grid import MapEstimate as MapEstimate
    from slam.mapping.classical import ClassicalMapper as ClassicalMapper
    from slam.mapping.classical import Mapper as Mapper
    from slam.mapping.classical import MapperConfig as MapperConfig
    from slam.mapping.learned_matching import LearnedMatcher as LearnedMatcher
    from slam.mapping.neural import NeuralMapper as NeuralMapper
    from slam.mapping.odometry import OdometryConfig as OdometryConfig
    from slam.networks.files import load_mapper as load_mapper
    from slam.networks.files import load_pose as load_pose
    from slam.planning.cost_map import CostConfig as CostConfig
    from slam.planning.planner import Plan as Plan
    from slam.planning.planner import Planner as Planner
    from slam.planning.planner import PlannerConfig as PlannerConfig
    from slam.sensing.projection import Band as Band
    from slam.sensing.projection import CameraModel as CameraModel

    __version__: str
else:

    def __getattr__(name: str) -> object:
        """A public name, imported at first access."""
        if name == "__version__":
            value: object = version("robosim-wireless")
        elif name in _MODULES:
            value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
