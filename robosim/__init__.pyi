"""Public names of `robosim`."""

# Floor plans
from robosim.plans.files import read_plan as read_plan
from robosim.plans.formats.plan_array import plan_from_array as plan_from_array
from robosim.generator.generate import generate_plan as generate_plan
from robosim.generator.generate import GeneratorConfig as GeneratorConfig
from robosim.plans.floorplan import FloorPlan as FloorPlan
from robosim.plans.floorplan import MapError as MapError
from robosim.plans.formats.ros_map import write_ros as write_ros
from robosim.plans.formats.plan_image import write_png as write_png

# Buildings
from robosim.building.building import make_building as make_building
from robosim.building.building import BuildingConfig as BuildingConfig
from robosim.building.building import Building as Building
from robosim.plans.furnishings.furnishing import Furnishing as Furnishing
from robosim.plans.furnishings.pieces import make_piece as make_piece
from robosim.plans.formats.furnishing_file import read_furnishings as read_furnishings
from robosim.plans.formats.furnishing_file import write_furnishings as write_furnishings
from robosim.plans.formats.furnishing_file import furnishing_from_file as furnishing_from_file
from robosim.building.reach import reach as reach
from robosim.building.reach import Reach as Reach
from robosim.building.mesh_export import export_mesh as export_mesh
from robosim.building.mesh_export import export_mitsuba as export_mitsuba
from robosim.robot.mjcf import export_mjcf as export_mjcf

# Simulation
from robosim.simulator import Simulator as Simulator
from robosim.simulator import SimulatorConfig as SimulatorConfig
from robosim.simulator import Observation as Observation
from robosim.robot.robots import RobotConfig as RobotConfig
from robosim.robot.odometry import NoiseModel as NoiseModel
from robosim.camera.model import CameraConfig as CameraConfig
from robosim.camera.depth_noise import DepthNoise as DepthNoise

# Environments to learn in
from robosim.environments.target_search import TargetSearch as TargetSearch
from robosim.environments.target_search_vector import TargetSearchVector as TargetSearchVector
from robosim.environments.target_search_vector import sb3_vec_env as sb3_vec_env
from robosim.environments.parallel import parallel_env as parallel_env
from robosim.environments.config import SearchConfig as SearchConfig
from robosim.environments.sources import GeneratedHomes as GeneratedHomes

# Episodes
from robosim.task.tasks import make_task as make_task
from robosim.task.tasks import Task as Task
from robosim.episode import run_episode as run_episode
from robosim.episode import run_team as run_team
from robosim.entrants import make_entrants as make_entrants
from robosim.entrants import Entrant as Entrant
from robosim.team.team_config import TeamConfig as TeamConfig
from robosim.team.team_log import TeamLog as TeamLog
from robosim.run import record_episode as record_episode
from robosim.episode_config import EpisodeConfig as EpisodeConfig
from robosim.episode_log import EpisodeLog as EpisodeLog
from robosim.step import Step as Step
from robosim.recording.episode_file import read_episode as read_episode
from robosim.task.tasks import Anchor as Anchor
from robosim.task.tasks import with_anchors as with_anchors
from robosim.policies.goals import GoalPolicy as GoalPolicy
from robosim.policies.goals import PolicyContext as PolicyContext
from robosim.policies.estimates import Estimates as Estimates
from robosim.radio.measurement import Measurement as Measurement

# Evaluation
from robosim.evaluation.evaluate import evaluate as evaluate
from robosim.evaluation.suite import Suite as Suite
from robosim.evaluation.evaluate import find_suite as find_suite
from robosim.evaluation.suite import read_suite as read_suite

# Radio
from robosim.radio.scene import RadioScene as RadioScene
from robosim.radio.scene import RadioConfig as RadioConfig
from robosim.radio.receivers import receiver_grid as receiver_grid

# Data sets
from robosim.datasets.trace import trace_plan as trace_plan
from robosim.datasets.links import make_dataset as make_dataset
from robosim.datasets.link_units import LinkSetConfig as LinkSetConfig
from robosim.datasets.collect import collect as collect
from robosim.datasets.collect import CollectConfig as CollectConfig
from robosim.datasets.torch_data import LinkDataset as LinkDataset
from robosim.datasets.torch_data import FrameDataset as FrameDataset

__version__: str
