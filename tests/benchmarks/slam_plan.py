"""What is measured of mapping and moving in one plan, kept in files so that a run which was killed goes on.

The plan is explored twice, from the same start and with the same seed: by the classical map, and by the learned one.
On the way of the first, everything is compared on the same frames: at every `EVERY`th one the truth ahead
(`robosim.datasets.true_patch`) with what is told of it by

- the frame alone: its scan entered into an empty classical grid that lies along the patch,
- the classical map, cut at the estimated pose, cell by cell and mixed between cells, whichever fits the truth better,
- the network,
- the learned map, into which its answers are fused, cut in the same way;

and at every frame the true pose with each way to know it (`pose_tracks`), among them the classical mapper
with one part left out, and with a radio that hears transmitters. The learned mapper runs along in the shadow of the
classical one there, and takes the poses of that one: what it adds is the map.
"""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from robosim.building.building import Building, make_building
from robosim.building.reach import Reach, reach
from robosim.camera.depth_noise import DepthNoise
from robosim.datasets.true_patch import MATTERS, OBSTACLE, SEEN, TruePatches
from robosim.episode import Decision, EpisodeConfig, run_episode
from robosim.generator.trial_floors import TRIAL_FLOORS, turned
from robosim.navigation import make_navigator
from robosim.parts import MapperPart, PhysicsPart
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FloorPlan
from robosim.policies.goals import Explore, PolicyContext
from robosim.radio.bearings import bearings_of
from robosim.robot.odometry import NoiseModel
from robosim.simulator import SimulatorConfig
from robosim.support.checks import LEVEL, SEED, STEPS, Range, checked
from robosim.support.files import npz_bytes
from robosim.support.stopwatch import LOOP_STAGES
from robosim.task.record import EpisodeLog
from robosim.task.tasks import Anchor, Task, make_task, with_anchors
from slam.grid import MapEstimate
from slam.mapping.classical import ClassicalMapper, MapperConfig
from slam.mapping.neural import NeuralMapper
from slam.mapping.occupancy import OccupancyGrid
from slam.mapping.odometry import OdometryConfig
from slam.mapping.relocalization import RelocalizationConfig
from slam.networks.scores import PatchScores
from slam.planning.paths import length
from slam.sensing.egocentric import AHEAD, belief_ahead, egocentric_map
from slam.sensing.projection import scan_from_depth
from tests.benchmarks.pose_tracks import (
    MapperTrack,
    OpenCVOdometry,
    RawOdometry,
    Track,
    UnbiasedOdometry,
    trajectory_errors,
)

#: Who tells of the patch.
TELLERS = ("frame alone", "classical map", "classical map, mixed", "network", "learned map")
#: One frame in so many is scored: neighbours show the same.
EVERY = 4
#: Decision at which pose errors are told.
TOLD_AT = 500
#: Ways to know the pose.
ODOMETRY, UNBIASED, OPENCV = "odometry", "odometry, unbiased", "OpenCV RGB-D"
LEARNED, MATCHED = "learned pose", "scan matching"
#: The classical mapper with a part left out: what is changed of its configuration.
LEFT_OUT: Mapping[str, Callable[[MapperConfig], MapperConfig]] = {
    "without calibration": lambda config: replace(config, odometry=OdometryConfig()),
    "without relocaliser": lambda config: replace(
        config, relocalization=RelocalizationConfig(contradiction=1.0)
    ),
    "without loops": lambda config: replace(config, tracking=replace(config.tracking, loops=False)),
}


class Floor(NamedTuple):
    """Where is measured."""

    source: str
    """File of a floor plan, or a name of `robosim.generator.trial_floors`."""
    degrees: float = 0.0
    """By how much it is turned against its grid."""

    def plan(self) -> FloorPlan:
        """Its plan, turned."""
        made = TRIAL_FLOORS.get(self.source)
        return turned(read_plan(self.source) if made is None else made(), self.degrees)


@dataclass(frozen=True, kw_only=True)
@checked
class SlamSettings:
    """What is run in each plan."""

    mapper: MapperPart = "neural"
    """Learned mapper, as in `robosim.navigation`."""
    steps: Annotated[int, STEPS] = 1000
    """Most decisions of each walk."""
    seed: Annotated[int, SEED] = 1
    """Seed of tasks and noise."""
    noise: Annotated[float, LEVEL] = 1.0
    """Level of actuation and odometry noise."""
    depth_noise: Annotated[float, LEVEL] = 1.0
    """Level of the depth camera's noise."""
    physics: PhysicsPart = "kinematic"
    """How the robot is moved."""
    transmitters: Annotated[int, Range(0, 100, "transmitters")] = 0
    """How many are heard by mappers beside that of the walk; with none there is no radio."""

    @property
    def simulator(self) -> SimulatorConfig:
        """The simulation."""
        return SimulatorConfig(
            physics=self.physics,
            noise=NoiseModel(level=self.noise),
            depth_noise=DepthNoise(level=self.depth_noise),
        )

    def episode(self, mapper: MapperPart, plan: str) -> EpisodeConfig:
        """Exploring a plan by a mapper, frontiers rated by hand: the difference is that of the maps."""
        seed = zlib.crc32(f"{self.seed} {plan}".encode())
        return EpisodeConfig(
            goal="explore",
            explorer="gain",
            mapper=mapper,
            seed=seed,
            max_steps=self.steps,
            simulator=self.simulator,
        )

    def task(self, places: Reach, plan: str) -> Task:
        """Where the robot begins in a plan, and where transmitters stand."""
        rng = np.random.default_rng([self.episode("classical", plan).seed, 0])
        task = make_task(places, rng)
        others = [
            Anchor(name=name, place=make_task(places, rng).target, known=False) for name in self.sources[1:]
        ]
        return with_anchors(task, places, others)

    @property
    def sources(self) -> list[str]:
        """Names of the transmitters."""
        return ["target", *(f"anchor-{k}" for k in range(1, self.transmitters))][: self.transmitters]


class _Listening(Explore):
    """Explores with its radio on."""

    uses_radio = True

    def __init__(self, context: PolicyContext) -> None:
        super().__init__(context.explorer)


def _deaf(config: MapperConfig) -> ClassicalMapper:
    """The classical mapper, to which the radio says nothing."""
    return ClassicalMapper(replace(config, tracking=replace(config.tracking, radio=False)))


def measure_plan(floor: Floor, settings: SlamSettings) -> tuple[dict[str, Any], bytes]:
    """Everything about one plan.

    Args:
        floor: Floor plan.
        settings: What to run.

    Returns:
        What is told of it, and the built maps as a NumPy archive.
    """
    plan = floor.plan()
    building = make_building(plan)
    robot = settings.simulator.robot
    places = reach(building, robot.radius_m, robot.height_m)
    task = settings.task(places, plan.name)
    shadow = _Shadow(building, task, settings)
    # Whatever is compiled or loaded at first use is not to be found in the times.
    run_episode(building, places, task, replace(settings.episode(settings.mapper, plan.name), max_steps=3))
    walks = {}
    first = settings.episode(_deaf, plan.name)
    if settings.transmitters:
        first = replace(first, goal=_Listening)
    second = settings.episode(settings.mapper, plan.name)
    for name, config, watch in (
        ("classical", first, shadow.look),
        ("learned", second, lambda log, decision: None),
    ):
        log, estimate = run_episode(building, places, task, config, watch)
        walks[name] = _walk(log)
    row = {
        "plan": plan.name,
        "area_m2": building.free.area,
        "frames": shadow.frames,
        "maps": {teller: score.counts() for teller, score in shadow.scores.items()},
        "poses": shadow.pose_errors(),
        "walks": walks,
    }
    return row, _maps(estimate, log)


def _walk(log: EpisodeLog) -> dict[str, Any]:
    """What one walk came to."""
    loop_s = sum(log.seconds.get(stage, 0.0) for stage in LOOP_STAGES)
    poses, estimates = np.array(log.poses), np.array(log.estimates)
    decisions = len(log.coverage)
    return {
        "ended": log.ended,
        "steps": log.steps,
        "path_length_m": length(poses[:, :2]),
        "collisions": sum(motion.collided for motion in log.motions),
        "coverage": np.round(log.coverage, 4),
        "stage_ms": {stage: 1000 * log.seconds.get(stage, 0.0) / decisions for stage in LOOP_STAGES},
        "decisions_per_s": decisions / loop_s,
        **trajectory_errors(poses, estimates),
    }


def _maps(estimate: MapEstimate, log: EpisodeLog) -> bytes:
    """The maps in the end, in 255ths, and both ways."""
    guess = estimate.anticipated_probability
    observed = estimate.obstacle_probability
    return npz_bytes(
        {
            "observed": np.rint(255 * observed).astype(np.uint8),
            "anticipated": np.rint(255 * (observed if guess is None else guess)).astype(np.uint8),
            "explored": estimate.explored,
            "origin": np.array(estimate.frame.origin_xy),
            "resolution_m": estimate.frame.resolution_m,
            "poses": np.array(log.poses),
            "estimates": np.array(log.estimates),
        }
    )


class _Shadow:
    """Looks on as the classical mapper explores."""

    def __init__(self, building: Building, task: Task, settings: SlamSettings) -> None:
        config = settings.simulator
        learned = make_navigator(config, mapper=settings.mapper).mapper
        if not isinstance(learned, NeuralMapper):
            raise ValueError(
                f"mapper is {settings.mapper!r}, expected a learned one: neural, or a .safetensors file."
            )
        self._learned = learned
        self._learned.reset(task.start)
        self._truth = TruePatches(building, hfov_deg=config.image.hfov_deg, height_m=config.robot.height_m)
        self.frames = 0
        self.scores = {teller: PatchScores() for teller in TELLERS}
        self._true: list[np.ndarray] = []
        self._matched: list[np.ndarray] = []
        other = make_navigator(config, mapper="learned-pose").mapper
        self._tracks: dict[str, Track | MapperTrack] = {
            ODOMETRY: Track(RawOdometry(), task.start),
            UNBIASED: Track(UnbiasedOdometry(config.noise), task.start),
            LEARNED: MapperTrack(other, task.start),
        }
        whole = self._learned.classical.config
        for name, changed in LEFT_OUT.items():
            self._tracks[name] = MapperTrack(ClassicalMapper(changed(whole)), task.start)
        for count in sorted({1, settings.transmitters}) if settings.transmitters else ():
            name = f"with radio, {count} transmitter{'s' if count > 1 else ''}"
            self._tracks[name] = MapperTrack(ClassicalMapper(whole), task.start, settings.sources[:count])
        self._radio = config.radio
        self._opencv = OpenCVOdometry(config.image, config.noise) if OpenCVOdometry.available() else None
        if self._opencv is not None:
            self._tracks[OPENCV] = Track(self._opencv, task.start)

    def look(self, log: EpisodeLog, decision: Decision) -> None:
        """Take in one decision."""
        view, pose, action = decision.view, decision.pose, decision.before
        estimate = self._learned.update(view.depth, action, view.odometry)
        situation = decision.situation
        measured = situation.measurement
        heard = {} if measured is None else {"target": measured, **situation.anchors}
        bearings = bearings_of(heard, self._radio, {})
        for track in self._tracks.values():
            track.update(view, action)
            if isinstance(track, MapperTrack):
                track.listen(bearings)
        self._true.append(np.array(pose))
        self._matched.append(np.array(decision.estimate.pose))
        if self.frames % EVERY == 0:
            patch = self._truth.at(pose)
            for teller, told in told_ahead(self._learned, estimate, view.depth).items():
                self.scores[teller].add(told, patch[OBSTACLE], patch[SEEN], patch[MATTERS])
        self.frames += 1

    def pose_errors(self) -> dict[str, dict[str, float]]:
        """Errors of each way to know the pose, over the whole walk and after `TOLD_AT` decisions."""
        told = {name: np.array(track.poses) for name, track in self._tracks.items()}
        told[MATCHED] = np.array(self._matched)
        true = np.array(self._true)
        some = slice(0, TOLD_AT + 1)
        rows = {}
        for name, poses in told.items():
            then = trajectory_errors(true[some], poses[some])
            rows[name] = {
                **trajectory_errors(true, poses),
                "then_m": then["last_m"],
                "then_deg": then["last_deg"],
            }
        for name, track in self._tracks.items():
            rows[name]["ms"] = 1000 * float(np.median(track.seconds)) if track.seconds else 0.0
        if self._opencv is not None:
            rows[OPENCV]["lost"] = self._opencv.lost
        return rows


def told_ahead(
    learned: NeuralMapper, estimate: MapEstimate, depth: Float[np.ndarray, "h w"]
) -> dict[str, Float[np.ndarray, "ny nx"]]:
    """Obstacle probability of the patch ahead, by each teller.

    Args:
        learned: The mapper after the frame.
        estimate: What it returned.
        depth: The frame [m].
    """
    classical = learned.classical.estimate()
    config = learned.classical.config
    frame = OccupancyGrid(AHEAD, config.occupancy)
    scan = scan_from_depth(depth, config.camera, config.band)
    lowest = float(config.camera.slopes(depth.shape)[1][-1])
    frame.integrate(scan, np.zeros(3), config.camera.height_m, lowest)
    mixed = belief_ahead(classical)
    nearest = np.where(egocentric_map(classical)[0], 1.0, np.minimum(mixed, 0.5))
    answer = learned.prediction
    return {
        "frame alone": frame.probability,
        "classical map": nearest,
        "classical map, mixed": mixed,
        "network": 1 / (1 + np.exp(-answer.obstacle)),
        "learned map": belief_ahead(estimate, anticipated=True),
    }
