"""Every part of the system that somebody may want to replace, and those of each kind that come with this package.

A part is given by its name, as an object, or as `module:Name`: see `robosim.support.parts`. What a part of a kind has
to do says its protocol:

    GOAL         goal policy             robosim.policies.goals.GoalPolicy
    EXPLORER     explorer                slam.exploration.explorer.Explorer
    MAPPER       mapper                  slam.mapping.classical.Mapper
    CONTROLLER   controller              slam.control.controller.LocalPolicy
    PHYSICS      physics                 robosim.robot.motion.Physics
    ROBOT        robot                   robosim.robot.robots.RobotConfig
    CAMERA       camera                  robosim.camera.model.Camera
    LIDAR        2D lidar                robosim.lidar.Lidar
    RECOGNISER   recogniser              robosim.camera.target.Recogniser
    MOVER        mover                   robosim.movers.mover.Mover
    TERMINAL     antennas of one end     wireless.antennas.codebook.Terminal
    ESTIMATOR    path estimator          wireless.estimation.estimators.PathEstimator
    CLASSIFIER   link-state classifier   wireless.linkstate.classifier.LinkStateClassifier
    MATERIAL     material                wireless.em.materials.Material
    READER       reader of floor plans   robosim.plans.files.PlanReader
    LOG_READER   reader of logs          robosim.logs.robot_log.LogReader

This module imports none of them: it is what the command line knows before it knows what it will need.
"""

from typing import Annotated

from robosim.support.installation import shipped_weights
from robosim.support.parts import Kind, Part
from wireless.em.materials import MATERIALS, WALLS

GOAL = Kind(
    "goal policy",
    {
        "oracle": "robosim.policies.goals:Oracle",
        "shortest": "robosim.policies.shortest:Shortest",
        "explore": "robosim.policies.goals:Explore",
        "visual": "robosim.policies.goals:Visual",
        "snr": "robosim.policies.goals:snr",
        "los": "robosim.policies.goals:los",
        "los-or-first": "robosim.policies.goals:los_or_first",
        "rss": "robosim.policies.goals:rss",
        "fused": "robosim.policies.goals:fused",
        "learned": "robosim.policies.learned:learned",
    },
    has=("goal",),
    made_from="a robosim.policies.goals.PolicyContext",
    suffixes=(".safetensors",),
    from_file="robosim.policies.learned:learned_of_file",
    protocol="robosim.policies.goals:GoalPolicy",
)
EXPLORER = Kind(
    "explorer",
    {
        "nearest": "robosim.navigation:nearest_explorer",
        "cheapest": "robosim.navigation:cheapest_explorer",
        "gain": "robosim.navigation:gain_explorer",
        "tour": "robosim.navigation:tour_explorer",
        "learned": "robosim.navigation:learned_explorer",
    },
    has=("goal",),
    made_from="a slam.robot.Robot",
    protocol="slam.exploration.explorer:Explorer",
)
MAPPER = Kind(
    "mapper",
    {
        "neural": "robosim.navigation:neural_mapper",
        "classical": "slam.mapping.classical:ClassicalMapper",
    },
    has=("reset", "update"),
    made_from="a slam.robot.Robot and a slam.mapping.classical.MapperConfig",
    suffixes=(".safetensors",),
    from_file="robosim.navigation:mapper_of_file",
    protocol="slam.mapping.classical:Mapper",
)
CONTROLLER = Kind(
    "controller",
    {
        "planned": "slam.control.controller:Controller",
        "velocity": "slam.control.velocity:VelocityController",
    },
    has=("act",),
    made_from="a slam.robot.Robot",
    protocol="slam.control.controller:LocalPolicy",
)
PHYSICS = Kind(
    "physics",
    {
        "dynamic": "robosim.robot.dynamic:World",
        "kinematic": "robosim.robot.kinematic:KinematicWorld",
    },
    has=("pose", "reset", "move", "drive"),
    made_from="a Building, and robot=RobotConfig",
    protocol="robosim.robot.motion:Physics",
)
ROBOT = Kind(
    "robot",
    {
        "turtlebot": "robosim.robot.robots:TURTLEBOT",
        "locobot": "robosim.robot.robots:LOCOBOT",
        "turtlebot3_burger": "robosim.robot.named:TURTLEBOT3_BURGER",
        "turtlebot3_waffle": "robosim.robot.named:TURTLEBOT3_WAFFLE",
        "turtlebot4": "robosim.robot.named:TURTLEBOT4",
        "create3": "robosim.robot.named:CREATE3",
        "jackal": "robosim.robot.named:JACKAL",
    },
    has=("mast_m", "height_m", "hull", "hull_m", "profile", "within_reach"),
    made_from="nothing",
    suffixes=(".yaml", ".yml", ".json", ".urdf", ".xml"),
    from_file="robosim.robot.robot_files:read_robot",
)
CAMERA = Kind(
    "camera",
    {
        "pyrender": "robosim.camera.cameras:pyrender_camera",
        "embree": "robosim.camera.rendering.embree_camera:EmbreeCamera",
        "plan": "robosim.camera.rendering.plan_camera:PlanCamera",
        "none": "robosim.camera.cameras:NoCamera",
    },
    has=("render", "close"),
    made_from="a list of meshes and a CameraConfig",
)
LIDAR = Kind(
    "2D lidar",
    {
        "none": "",  # the robot has none: nothing is made
        "rplidar-a1": "robosim.lidar:rplidar_a1",
        "lds-01": "robosim.lidar:lds_01",
        "ust-10lx": "robosim.lidar:ust_10lx",
        "ring-64": "robosim.lidar:ring_64",
        "rangers-4": "robosim.lidar:rangers_4",
        "vl53l5cx": "robosim.lidar:vl53l5cx",
    },
    has=("scan", "true_scan"),
    made_from="a list of meshes and a LidarConfig",
)
RECOGNISER = Kind(
    "recogniser",
    {
        "marker": "robosim.camera.target:MarkerRecogniser",
        "perfect": "robosim.camera.target:PerfectRecogniser",
    },
    has=("find",),
    made_from="a CameraConfig",
)
MOVER = Kind(
    "mover",
    {"none": ""},  # nothing else moves: nothing is made
    has=("bodies", "reset", "poses"),
    made_from="nothing",
    suffixes=(".csv", ".parquet", ".tum", ".yaml"),
    from_file="robosim.movers.mover_file:mover_of_file",
)
TERMINAL = Kind(
    "terminal",
    {
        "gnb": "wireless.antennas.codebook:gnb",
        "ue": "wireless.antennas.codebook:ue",
        "tag": "wireless.antennas.codebook:tag",
        "ring-8": "wireless.antennas.codebook:ring_8",
    },
    has=("platform", "n_beams", "beam_response"),
    made_from="nothing",
)
ESTIMATOR = Kind(
    "path estimator",
    {"sage": "wireless.estimation.sage:SageEstimator", "pca": "wireless.estimation.pca:PcaEstimator"},
    has=("estimate",),
    made_from="a Sounder",
)
CLASSIFIER = Kind(
    "link-state classifier",
    {
        **{name: str(path) for name, path in shipped_weights().items()},
        "true": "robosim.radio.link_state:TrueStates",
    },
    has=("predict",),
    made_from="nothing",
    suffixes=(".safetensors",),
    from_file="robosim.radio.link_state:classifier_of_file",
)
MATERIAL = Kind(
    "material",
    dict.fromkeys((*MATERIALS, *WALLS), ""),  # the tracer takes their names
    has=("name", "layers"),
    made_from="nothing",
    suffixes=(".yaml", ".yml"),
    from_file="robosim.building.wall_materials:read_material",
)
READER = Kind(
    "reader of floor plans",
    {
        "ros": "robosim.plans.formats.ros_map:read_ros",
        "image": "robosim.plans.formats.plan_image:read_image_plan",
        "array": "robosim.plans.formats.plan_array:read_npy",
        "mmwrobotnav": "robosim.plans.formats.mmwrobotnav:read_mmwrobotnav",
        "houseexpo": "robosim.plans.formats.houseexpo:read_houseexpo",
        "mesh": "robosim.plans.formats.mesh_slice:read_mesh",
        "dxf": "robosim.plans.formats.dxf:read_dxf",
        "svg": "robosim.plans.formats.svg:read_svg",
        "ifc": "robosim.plans.formats.ifc:read_ifc",
    },
    has=("__call__",),
    made_from="nothing",
)

LOG_READER = Kind(
    "reader of logs",
    {
        "bag": "robosim.logs.bag:BagReader",
        "tum": "robosim.logs.log_files:TumReader",
        "carmen": "robosim.logs.carmen:CarmenReader",  # the last: it matches any file
    },
    has=("matches", "read"),
    made_from="nothing",
    protocol="robosim.logs.robot_log:LogReader",
)

#: Types of fields that hold a part, as the command line reads them.
GoalPart = Annotated[Part, GOAL, GOAL.option()]
ExplorerPart = Annotated[Part, EXPLORER, EXPLORER.option()]
MapperPart = Annotated[Part, MAPPER, MAPPER.option()]
ControllerPart = Annotated[Part, CONTROLLER, CONTROLLER.option()]
PhysicsPart = Annotated[Part, PHYSICS, PHYSICS.option()]
RobotPart = Annotated[Part, ROBOT, ROBOT.option()]
CameraPart = Annotated[Part, CAMERA, CAMERA.option()]
LidarPart = Annotated[Part, LIDAR, LIDAR.option()]
RecogniserPart = Annotated[Part, RECOGNISER, RECOGNISER.option()]
MoverPart = Annotated[Part, MOVER, MOVER.option()]
TerminalPart = Annotated[Part, TERMINAL, TERMINAL.option()]
EstimatorPart = Annotated[Part, ESTIMATOR, ESTIMATOR.option()]
ClassifierPart = Annotated[Part, CLASSIFIER, CLASSIFIER.option()]
MaterialPart = Annotated[Part, MATERIAL.option()]
#: Parts for options of a command that has one of those already, so that its help lists the names once.
NextMaterialPart = Annotated[Part, MATERIAL.option(metavar="MATERIAL")]
ReaderPart = Annotated[Part, READER.option("auto")]
LogReaderPart = Annotated[Part, LOG_READER.option("auto")]
