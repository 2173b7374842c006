"""Public names of `slam`."""

from slam.robot import Robot as Robot

# Mapping
from slam.mapping.classical import ClassicalMapper as ClassicalMapper
from slam.mapping.classical import MapperConfig as MapperConfig
from slam.mapping.classical import Mapper as Mapper
from slam.mapping.neural import NeuralMapper as NeuralMapper
from slam.networks.files import load_mapper as load_mapper
from slam.grid import MapEstimate as MapEstimate
from slam.grid import GridFrame as GridFrame
from slam.sensing.projection import CameraModel as CameraModel
from slam.sensing.projection import Band as Band
from slam.odometry import OdometryConfig as OdometryConfig

# Moving
from slam.planning.planner import Planner as Planner
from slam.planning.planner import PlannerConfig as PlannerConfig
from slam.planning.cost_map import CostConfig as CostConfig
from slam.planning.planner import Plan as Plan
from slam.control.controller import Controller as Controller
from slam.control.controller import ControlConfig as ControlConfig
from slam.actions import Action as Action
from slam.control.controller import LocalPolicy as LocalPolicy

# Exploring
from slam.exploration.explorer import FrontierExplorer as FrontierExplorer
from slam.exploration.explorer import ExplorerConfig as ExplorerConfig
from slam.exploration.choosing import load_chooser as load_chooser
from slam.exploration.explorer import Explorer as Explorer

__version__: str
