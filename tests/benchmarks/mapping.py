"""Mapping over many plans: the classical mapper against the learned one, and methods to estimate the pose.

Each plan is explored by the classical map, and all methods get the same frames. At every fourth frame the truth ahead
(`robosim.datasets.true_patch`) is compared with the frame alone, the classical map (cell by cell, and mixed between
cells), the network, and the learned map. Obstacles in view are those within the field of view and 3.2 m; hidden ones
are in the rest of the patch. At every frame the true pose is compared with that of each method (`pose_tracks`), among
them the classical mapper with one part left out, and with a radio that receives transmitters.
"""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import Building, make_building
from robosim.building.reach import Reach, reach
from robosim.camera.depth_noise import DepthNoise
from robosim.datasets.true_patch import MATTERS, OBSTACLE, SEEN, TruePatches
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.episode_log import EpisodeLog
from robosim.evaluation.search_scores import bootstrap
from robosim.navigation import make_navigator
from robosim.parts import MapperPart
from robosim.plans.files import find_plans, read_plan
from robosim.plans.floorplan import FloorPlan
from robosim.policies.goals import Explore
from robosim.radio.measurement import bearings_of
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.step import Step
from robosim.support.stopwatch import LOOP_STAGES
from robosim.task.tasks import Anchor, Task, make_task, with_anchors
from slam.grid import MapEstimate
from slam.mapping.classical import ClassicalMapper, MapperConfig
from slam.mapping.neural import NeuralMapper
from slam.mapping.occupancy import OccupancyGrid
from slam.mapping.relocalization import RelocalizationConfig
from slam.networks.scores import PatchScores
from slam.robot import Robot
from slam.sensing.egocentric import AHEAD, belief_ahead
from slam.sensing.projection import scan_from_depth
from tests.benchmarks.harness import DEFAULT, Options, ratio_interval, run_units
from tests.benchmarks.pose_tracks import (
    MapperTrack,
    Odometry,
    OpenCVOdometry,
    Track,
    trajectory_errors,
)
from tests.benchmarks.results import Results
from tests.benchmarks.trial_floors import TRIAL_FLOORS, turned
from tests.slam.sensing.nearest_cells import egocentric_map

#: One frame in so many is scored: neighbours show the same.
EVERY = 4
#: Decision at which pose errors are reported.
REPORTED_AT = 500
MATCHED = "scan matching"
#: The classical mapper with a part left out.
LEFT_OUT: Mapping[str, Callable[[Robot, MapperConfig], ClassicalMapper]] = {
    "without calibration": lambda robot, config: ClassicalMapper(replace(robot, odometry=None), config),
    "without relocaliser": lambda robot, config: ClassicalMapper(
        robot, replace(config, relocalization=RelocalizationConfig(contradiction=1.0))
    ),
    "without loops": lambda robot, config: ClassicalMapper(
        robot, replace(config, tracking=replace(config.tracking, loops=False))
    ),
}


class Floor(NamedTuple):
    """A floor plan that is turned against its grid."""

    source: str
    """File, or a name of `tests.benchmarks.trial_floors`."""
    degrees: float = 0.0

    def plan(self) -> FloorPlan:
        """The plan, turned."""
        make = TRIAL_FLOORS.get(self.source)
        return turned(read_plan(self.source) if make is None else make(), self.degrees)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What is run in each plan."""

    mapper: MapperPart = "neural"
    """Learned mapper: neural, or a .safetensors file."""
    steps: int = 1000
    """Most decisions of each walk."""
    noise: float = 1.0
    """Level of actuation and odometry noise."""
    depth_noise: float = 1.0
    """Level of the depth camera's noise."""
    transmitters: int = 0
    """Transmitters whose radio more mappers receive: the first of them, and all."""

    @property
    def simulator(self) -> SimulatorConfig:
        """The simulation."""
        noise = NoiseModel(level=self.noise)
        return SimulatorConfig(
            physics="kinematic",
            robot=RobotConfig(noise=noise, depth_noise=DepthNoise(level=self.depth_noise)),
        )

    @property
    def sources(self) -> list[str]:
        """Names of the transmitters."""
        return ["target", *(f"anchor-{k}" for k in range(1, self.transmitters))][: self.transmitters]

    def episode(self, mapper: MapperPart, plan: str, seed: int) -> EpisodeConfig:
        """Exploring a plan by a mapper, frontiers rated by hand."""
        return EpisodeConfig(
            goal="explore",
            explorer="gain",
            mapper=mapper,
            seed=zlib.crc32(f"{seed} {plan}".encode()),
            max_steps=self.steps,
            simulator=self.simulator,
        )

    def task(self, places: Reach, seed: int) -> Task:
        """Where the robot begins, and where transmitters stand."""
        rng = np.random.default_rng([seed, 0])
        task = make_task(places, rng)
        others = [
            Anchor(name=name, place=make_task(places, rng).target, known=False) for name in self.sources[1:]
        ]
        return with_anchors(task, places, others)


DEFAULT_SETTINGS = Settings()


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    turned: tuple[float, ...] = (0.0,),
    settings: OmitArgPrefixes[Settings] = DEFAULT_SETTINGS,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Mapping: overlap and calibration of learned and classical maps, and pose errors of several methods.

    About a minute a plan. Goes on after a kill if it is given the same folder.

    Args:
        plans: Floor plans, or folders of them; or floors with little to match, by name: hall, pillars, corridor, ring,
            large-1, large-2.
        turned: Angles by which each plan is turned against its grid [degrees].
        settings: What is run in each plan.
        options: Of every benchmark.
    """
    sources = [word for word in plans if word in TRIAL_FLOORS]
    files = [word for word in plans if word not in TRIAL_FLOORS]
    sources += [str(path) for path in (find_plans(files) if files else ())]
    floors = [Floor(source, degrees) for source in sources for degrees in turned]
    units = {floor.plan().name: (floor, settings, options.seed) for floor in floors}
    rows = run_units(measure, units, options.folder("mapping"), workers=options.workers)
    return options.finish("mapping", summarise(rows))


def summarise(rows: Mapping[str, dict[str, Any]]) -> Results:
    """Tables of all plans together, and of poses plan by plan; intervals by bootstrap over plans, turned or not."""
    results, first = Results(), next(iter(rows.values()))
    homes = len({name.partition("@")[0] for name in rows})
    for method in first["maps"]:
        score = PatchScores()
        for row in rows.values():
            score.add_counts(row["maps"][method])
        for name, value in score.result().items():
            region, spread = name.removeprefix("iou_"), None
            if region != name:
                overlap = np.array([row["maps"][method]["overlap"][region] for row in rows.values()])
                _, spread = ratio_interval(*overlap.reshape(homes, -1, 2).sum(axis=1).T)
            results.add(
                "maps", method, name.replace("_", " "), value, digits=3, spread=spread, cases=len(rows)
            )
    for method in first["poses"]:
        own = [row["poses"][method] for row in rows.values() if method in row["poses"]]
        for key, name, factor, unit in (
            ("then_m", "place", 100, "cm"), ("then_deg", "heading", 1, "°"), ("ate_m", "ATE", 100, "cm"),
            ("rpe_m", "RPE", 1000, "mm"),
        ):  # fmt: skip
            values = factor * np.array([pose[key] for pose in own])
            median, low, high = bootstrap(values.reshape(homes, -1), 0.5)
            spread = (low, high) if homes > 1 else None
            results.add(
                "poses", method, f"{name}, median", median, unit, digits=1, spread=spread, cases=len(own)
            )
            results.add("poses", method, f"{name}, 95 %", np.quantile(values, 0.95), unit, digits=1)
    for plan, row in rows.items():
        for key, name, factor, unit in (
            ("ate_m", "ATE", 100, "cm"), ("worst_m", "worst", 100, "cm"), ("worst_deg", "worst heading", 1, "°"),
        ):  # fmt: skip
            results.add(
                "plans", plan, name, factor * row["poses"][MATCHED][key], unit, digits=1, cases=row["frames"]
            )
        for method in row["poses"]:
            if method.startswith("with"):
                results.add(
                    "plans", plan, f"ATE {method}", 100 * row["poses"][method]["ate_m"], "cm", digits=1
                )
    for stage in LOOP_STAGES:
        ms = [row["stage_ms"][stage] for row in rows.values()]
        results.add("stages", stage, "a decision", np.median(ms), "ms", digits=2, cases=len(ms))
    return results


class _ExploreWithRadio(Explore):
    """Explores with its radio on."""

    uses_radio = True


def _without_radio(robot: Robot, config: MapperConfig) -> ClassicalMapper:
    """The classical mapper, which does not use the radio."""
    return ClassicalMapper(robot, replace(config, tracking=replace(config.tracking, radio=False)))


def measure(floor: Floor, settings: Settings, seed: int) -> dict[str, Any]:
    """Scores of maps and errors of poses in one plan, on the frames of one walk."""
    plan = floor.plan()
    building = make_building(plan)
    robot = settings.simulator.robot
    places = reach(building, *robot.hull_m)
    config = settings.episode(_without_radio, plan.name, seed)
    if settings.transmitters:
        config = replace(config, goal=_ExploreWithRadio)
    task = settings.task(places, config.seed)
    observer = _Observer(building, task, settings)
    # What is compiled or loaded at first use does not count.
    run_episode(building, places, task, replace(config, mapper=settings.mapper, max_steps=3))
    log, _ = run_episode(building, places, task, config, observer.look)
    decisions = len(log.coverage)
    return {
        "frames": observer.frames,
        "maps": {method: score.counts() for method, score in observer.scores.items()},
        "poses": observer.pose_errors(),
        "stage_ms": {stage: 1000 * log.seconds.get(stage, 0.0) / decisions for stage in LOOP_STAGES},
    }


class _Observer:
    """Gets each decision of the walk, and gives its frames to all methods."""

    def __init__(self, building: Building, task: Task, settings: Settings) -> None:
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
        self.scores: dict[str, PatchScores] = {}
        self._true: list[np.ndarray] = []
        self._matched: list[np.ndarray] = []
        self._radio = config.radio
        self._tracks: dict[str, Track | MapperTrack] = {
            "raw odometry": Track(Odometry(), task.start),
            "odometry without its constant errors": Track(Odometry(less=config.robot.noise), task.start),
        }
        if OpenCVOdometry.available():
            self._tracks["RGB-D odometry of OpenCV"] = Track(
                OpenCVOdometry(config.image, config.robot.noise), task.start
            )
        robot, whole = learned.classical.robot, learned.classical.config
        for name, changed in LEFT_OUT.items():
            self._tracks[name] = MapperTrack(changed(robot, whole), task.start)
        for count in sorted({1, settings.transmitters}) if settings.transmitters else ():
            name = f"with radio of {count}"
            self._tracks[name] = MapperTrack(
                ClassicalMapper(robot, whole), task.start, settings.sources[:count]
            )

    def look(self, log: EpisodeLog, step: Step) -> None:
        """Take in one step."""
        view, estimated = step.sensed, step.estimated
        estimate = self._learned.update(view.depth, view.action, view.odometry)
        measured = estimated.measurement
        received = {} if measured is None else {"target": measured, **estimated.anchors}
        bearings = bearings_of(received, self._radio, {})
        for track in self._tracks.values():
            track.update(view, view.action)
            if isinstance(track, MapperTrack):
                track.listen(bearings)
        self._true.append(np.array(step.true.pose))
        self._matched.append(np.array(step.estimated.pose))
        if self.frames % EVERY == 0:
            patch = self._truth.at(step.true.pose)
            for method, predicted in predicted_ahead(self._learned, estimate, view.depth).items():
                score = self.scores.setdefault(method, PatchScores())
                score.add(predicted, patch[OBSTACLE], patch[SEEN], patch[MATTERS])
        self.frames += 1

    def pose_errors(self) -> dict[str, dict[str, float]]:
        """Errors of each method over the whole walk, and after `REPORTED_AT` decisions (`then_m`, `then_deg`)."""
        true, some = np.array(self._true), slice(0, REPORTED_AT + 1)
        tracks = {MATCHED: self._matched, **{name: track.poses for name, track in self._tracks.items()}}
        rows = {}
        for name, poses in tracks.items():
            then = trajectory_errors(true[some], np.array(poses)[some])
            whole = trajectory_errors(true, np.array(poses))
            rows[name] = {**whole, "then_m": then["last_m"], "then_deg": then["last_deg"]}
        return rows


def predicted_ahead(
    learned: NeuralMapper, estimate: MapEstimate, depth: Float[np.ndarray, "h w"]
) -> dict[str, Float[np.ndarray, "ny nx"]]:
    """Obstacle probability of the patch ahead, by each method.

    Args:
        learned: The mapper after the frame.
        estimate: What it returned.
        depth: The frame [m].
    """
    classical = learned.classical.estimate()
    config, camera = learned.classical.config, learned.classical.camera
    frame = OccupancyGrid(AHEAD, config.occupancy)
    scan = scan_from_depth(depth, camera, config.band)
    lowest = float(camera.slopes(depth.shape)[1][-1])
    frame.integrate(scan, np.zeros(3), camera.height_m, lowest)
    mixed = belief_ahead(classical)
    return {
        "frame alone": frame.probability,
        "classical map": np.where(egocentric_map(classical)[0], 1.0, np.minimum(mixed, 0.5)),
        "classical map, mixed": mixed,
        "network": 1 / (1 + np.exp(-learned.prediction.obstacle)),
        "learned map": belief_ahead(estimate, anticipated=True),
    }
