"""What is measured of mapping and moving in one plan, kept in files so that a run which was killed goes on.

The plan is explored twice, from the same start and with the same seed: by the classical map, and by the learned one.
On the way of the first, everything is compared on the same frames: at every `EVERY`th one the truth ahead
(`robosim.datasets.true_patch`) with what is told of it by

- the frame alone: its scan entered into an empty classical grid that lies along the patch,
- the classical map, cut at the estimated pose, cell by cell and mixed between cells, whichever fits the truth better,
- the network,
- the learned map, into which its answers are fused, cut in the same way;

and at every frame the true pose with each way to know it (`robosim.bench.pose_tracks`). The learned mapper runs along
in the shadow of the classical one there, and takes the poses of that one: what it adds is the map.
"""

import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.bench.pose_tracks import (
    MapperTrack,
    OpenCVOdometry,
    RawOdometry,
    Track,
    UnbiasedOdometry,
    trajectory_errors,
)
from robosim.building.building import Building, make_building
from robosim.building.reach import Reach, reach
from robosim.camera.depth_noise import DepthNoise
from robosim.datasets.true_patch import MATTERS, OBSTACLE, SEEN, TruePatches
from robosim.episode import Decision, EpisodeConfig, run_episode
from robosim.navigation import make_navigator
from robosim.parts import MAPPER, PHYSICS, MapperPart, PhysicsPart
from robosim.plans.files import read_plan
from robosim.robot.odometry import NoiseModel
from robosim.simulator import SimulatorConfig
from robosim.support.checks import LEVEL, SEED, STEPS, check_numbers
from robosim.support.files import npz_bytes
from robosim.support.stopwatch import LOOP_STAGES
from robosim.task.record import EpisodeLog
from robosim.task.tasks import Task, make_task
from slam.grid import MapEstimate
from slam.mapping.neural import NeuralMapper
from slam.mapping.occupancy import OccupancyGrid
from slam.networks.scores import PatchScores
from slam.sensing.egocentric import AHEAD, belief_ahead, egocentric_map
from slam.sensing.projection import scan_from_depth

#: Who tells of the patch.
TELLERS = ("frame alone", "classical map", "classical map, mixed", "network", "learned map")
#: One frame in so many is scored: neighbours show the same.
EVERY = 4
#: Decision at which pose errors are told.
TOLD_AT = 500
#: Ways to know the pose.
ODOMETRY, UNBIASED, OPENCV = "odometry", "odometry, unbiased", "OpenCV RGB-D"
LEARNED, MATCHED = "learned pose", "scan matching"


@dataclass(frozen=True, kw_only=True)
class SlamSettings:
    """What is run in each plan."""

    mapper: MapperPart = "neural"
    """Learned mapper, as in `robosim.navigation`."""
    steps: int = 1000
    """Most decisions of each walk."""
    seed: int = 1
    """Seed of tasks and noise."""
    noise: float = 1.0
    """Level of actuation and odometry noise."""
    depth_noise: float = 1.0
    """Level of the depth camera's noise."""
    physics: PhysicsPart = "kinematic"
    """How the robot is moved."""

    def __post_init__(self) -> None:
        MAPPER.check("mapper", self.mapper)
        PHYSICS.check("physics", self.physics)
        check_numbers(self, seed=SEED, noise=LEVEL, depth_noise=LEVEL, steps=STEPS)

    @property
    def simulator(self) -> SimulatorConfig:
        """The simulation."""
        return SimulatorConfig(
            physics=self.physics,
            noise=NoiseModel(level=self.noise),
            depth_noise=DepthNoise(level=self.depth_noise),
        )

    def episode(self, mapper: str, plan: str) -> EpisodeConfig:
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
        """Where the robot begins in a plan."""
        return make_task(places, np.random.default_rng([self.episode("classical", plan).seed, 0]))


def measure_plan(path: str | Path, settings: SlamSettings) -> tuple[dict[str, Any], bytes]:
    """Everything about one plan.

    Args:
        path: Floor plan.
        settings: What to run.

    Returns:
        What is told of it, and the built maps as a NumPy archive.
    """
    plan = read_plan(path)
    building = make_building(plan)
    places = reach(building, settings.simulator.robot.radius_m)
    task = settings.task(places, plan.name)
    shadow = _Shadow(building, task, settings)
    # Whatever is compiled or loaded at first use is not to be found in the times.
    run_episode(building, places, task, replace(settings.episode(settings.mapper, plan.name), max_steps=3))
    walks = {}
    for mapper, watch in (("classical", shadow.look), (settings.mapper, lambda log, decision: None)):
        log, estimate = run_episode(building, places, task, settings.episode(mapper, plan.name), watch)
        walks["classical" if mapper == "classical" else "learned"] = _walk(log)
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
        self._truth = TruePatches(building, hfov_deg=config.image.hfov_deg)
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
        self._opencv = OpenCVOdometry(config.image, config.noise) if OpenCVOdometry.available() else None
        if self._opencv is not None:
            self._tracks[OPENCV] = Track(self._opencv, task.start)

    def look(self, log: EpisodeLog, decision: Decision) -> None:
        """Take in one decision."""
        view, pose, action = decision.view, decision.pose, decision.before
        estimate = self._learned.update(view.depth, action, view.odometry)
        for track in self._tracks.values():
            track.update(view, action)
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
