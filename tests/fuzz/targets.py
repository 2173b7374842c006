"""Every reader of robosim, and the commands that stand on them: what is damaged for each, and how it is called."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from rich.console import Console

from robosim.building.building import make_building
from robosim.building.multi_storey import make_storeys
from robosim.building.wall_materials import read_material
from robosim.calibration.measured_paths import read_measured_paths
from robosim.cli import main
from robosim.commands.episode_config import read_config
from robosim.datasets.collect import collect
from robosim.environments.collect import collect_searches
from robosim.episode_config import EpisodeConfig
from robosim.evaluation.episodes import read_job_episode, read_job_head
from robosim.evaluation.evaluate import settings_of
from robosim.evaluation.search_scores import score, summarise
from robosim.evaluation.suite import is_suite, read_suite
from robosim.live.link_model import MOST_BYTES, plan_of
from robosim.live.recordings import read_evaluation, read_recording
from robosim.logs.log_files import read_log
from robosim.movers.mover_file import mover_of_file
from robosim.plans.files import find_plans, read_plan
from robosim.plans.floorplan import MapError
from robosim.plans.formats.furnishing_file import furnishing_from_file, read_furnishings
from robosim.plans.storeys_file import read_storeys
from robosim.policies.search_network import load_search
from robosim.radio.link_state import classifier_of_file
from robosim.radio.table import RadioTable
from robosim.recording.episode_file import read_episode
from robosim.robot.calibration import read_runs
from robosim.robot.robot_files import read_robot
from robosim.support.run_folder import run_folder
from robosim.support.text_in import read_json
from robosim.training.explorer import resume
from robosim.training.generated_links import read_homes
from robosim.training.mapper import read_frames
from robosim.training.policy_weights import Checkpoint
from robosim.training.search import Training as SearchTraining
from slam.exploration.choosing import initial_weights, load_chooser
from slam.networks.files import load_mapper
from tests.fuzz.checkpoint_seeds import EXPLORER_RECIPE, SEARCH_RECIPE, teach_classifier, teach_mapper
from tests.fuzz.seeds import COLLECTED, SEARCHES, small_plan
from tests.fuzz.small_files import COMMANDS, STOPS
from tests.plans import two_rooms
from wireless.antennas.pattern_files import read_pattern
from wireless.antennas.sphere import sphere
from wireless.formats.link_records import read_columns, read_rays
from wireless.formats.link_records import read_links as read_records
from wireless.formats.mmwrobotnav_measurements import read_tx_positions
from wireless.linkstate.data import read_links
from wireless.paths import Paths
from wireless.tracing.mitsuba_scene import read_mitsuba

SCALELESS = (".png", ".pgm", ".gif", ".bmp", ".tif", ".tiff", ".jpg", ".webp", ".ppm", ".pbm", ".npy")


@dataclass(frozen=True)
class Target:
    """A reader or a command."""

    seed: str
    """Folder of the seed."""
    files: str
    """Which of its files are damaged, as a glob pattern."""
    call: Callable[[Path, Path], Any]
    """Reads; is given the folder and the damaged file."""
    weight: float = 1.0
    """Share of the cases."""
    is_command: bool = False
    """Whether it goes through the command line, which reports by exit status and standard error."""
    names: str = ""
    """What a rejection may name instead of the damaged file: the file that was requested."""


class EnoughError(BaseException):
    """All has been read; what a command would go on to do is not tried here. No error that a command would report."""


def _stop(*args: Any, **kwargs: Any) -> Any:
    raise EnoughError


@contextmanager
def _only_reading(*names: str) -> Iterator[None]:
    """Functions that begin the work end it."""
    patches = [patch(name, _stop) for name in names]
    for each in patches:
        each.start()
    try:
        yield
    except EnoughError:
        pass
    finally:
        for each in patches:
            each.stop()


def _plan(folder: Path, file: Path) -> None:
    read_plan(file, resolution_m=0.05 if file.suffix in SCALELESS else None)


def _upload(folder: Path, file: Path) -> None:
    """What is dropped onto the page is a name and bytes, however large."""
    if file.is_file() and file.stat().st_size <= 4 * MOST_BYTES:
        try:
            plan_of(file.name, file.read_bytes(), 0.05)
        except MapError as error:
            # The page knows the file's name, and no folder.
            assert str(error).startswith(file.name) and str(file.parent) not in str(error)
            raise MapError(f"{file}: {error}") from None


def _looked_back(folder: Path, file: Path) -> None:
    """Episodes as the page opens them; a damaged result is passed over, for the log is enough."""
    recording = read_recording(folder)
    assert len(recording[0].true.pose) == 3


def _looked_back_on_many(folder: Path, file: Path) -> None:
    for searched in read_evaluation(folder):
        searched.read()


def _ros(folder: Path, file: Path) -> None:
    read_plan(next(iter(sorted(folder.glob("*.yaml"))), folder / "map.yaml"))


def _map(folder: Path, file: Path) -> None:
    read_plan(folder / "map.yaml")


def _furnishings(folder: Path, file: Path) -> None:
    for one in read_furnishings(folder / "room.yaml"):
        assert np.isfinite(one.triangles).all()


def _storeys(folder: Path, file: Path) -> None:
    make_storeys(read_storeys(folder / "building.yaml"))


def _found_plans(folder: Path, file: Path) -> None:
    """What is damaged is passed over in a folder, or said to be."""
    for plan in find_plans([folder]):
        read_plan(plan)


def _log(folder: Path, file: Path) -> None:
    for _ in read_episode(folder).steps():
        pass


def _episode(folder: Path, file: Path) -> None:
    episode = read_job_episode(file)
    assert episode.head == read_job_head(file)
    for _ in episode.steps():
        pass
    summarise(score([{**episode.head.row, "policy": "oracle"}]))


def _suite(folder: Path, file: Path) -> None:
    is_suite(file)
    read_suite(file)


def _settings(folder: Path, file: Path) -> None:
    settings = settings_of(read_suite(folder / "suite.json"), EpisodeConfig())
    with run_folder(folder, "evaluate", settings, grows=("plans", "tasks")):
        pass


def _shard(folder: Path, file: Path) -> None:
    read_frames([file])


def _collected(folder: Path, file: Path) -> None:
    collect(COLLECTED, folder, workers=1, console=Console(quiet=True))


def _records(folder: Path, file: Path) -> None:
    read_records(file)
    read_rays(file)
    read_columns(file, ["link_state", "n_paths"])


def _paths(folder: Path, file: Path) -> None:
    paths = Paths.read_parquet(file)
    Paths.read_parquet(file, 1)
    paths.link_state(), paths.digits


def _mapper_checkpoint(folder: Path, file: Path) -> None:
    teach_mapper(Checkpoint(file))


def _link_checkpoint(folder: Path, file: Path) -> None:
    teach_classifier(Checkpoint(file))


def _explorer_checkpoint(folder: Path, file: Path) -> None:
    first = initial_weights(np.random.default_rng(0))
    weights = {name: torch.from_numpy(value.copy()).requires_grad_() for name, value in first.items()}
    optimiser = torch.optim.Adam(weights.values(), lr=EXPLORER_RECIPE.ppo.rate)
    resume(Checkpoint(file), EXPLORER_RECIPE, weights, optimiser)
    sum(value.sum() for value in weights.values()).backward()  # type: ignore[union-attr]
    optimiser.step()


def _search_checkpoint(folder: Path, file: Path) -> None:
    training = SearchTraining(SEARCH_RECIPE, folder)
    Checkpoint(file).restore(training.restore)


def _homes(folder: Path, file: Path) -> None:
    read_homes(1, folder)


def _replay(folder: Path, file: Path) -> None:
    main(["replay", str(folder), "--out", str(folder / "out"), "--frames", "2"])


def _evaluate(folder: Path, file: Path) -> None:
    with _only_reading("robosim.evaluation.evaluate.run_jobs"):
        suite, out = str(folder / "suite.yaml"), str(folder)
        main(["evaluate", suite, "--policies", "snr", "los-or-first", "--workers", "1", "--out", out])


def _evaluate_finished(folder: Path, file: Path) -> None:
    """All episodes are there, and their rows are scored."""
    with (
        _only_reading("robosim.evaluation.evaluate.write_results"),
        patch("robosim.evaluation.evaluate.run_jobs", lambda *a, **k: []),
    ):
        suite, out = str(folder / "suite.yaml"), str(folder)
        main(["evaluate", suite, "--policies", "snr", "los-or-first", "--workers", "1", "--out", out])


def _train_mapper(folder: Path, file: Path) -> None:
    with _only_reading("robosim.training.mapper.train"):
        main(["train", "mapper", "--data", str(folder), "--out", str(folder / "out")])


def _train_link_state(folder: Path, file: Path) -> None:
    with (
        _only_reading("robosim.training.link_state.generate_homes"),
        patch("robosim.training.link_state.links_of", read_links),
    ):
        words = f"train link-state --data {folder} --folds 0 --n-folds 1 --test {folder} --out {folder}/out"
        main(words.split())


def _episode_with_mapper(folder: Path, file: Path) -> None:
    """The weights are looked at before anything else is."""
    _command_episode(folder, "--mapper")


def _episode_with_classifier(folder: Path, file: Path) -> None:
    _command_episode(folder, "--link-states")


def _command_episode(folder: Path, option: str) -> None:
    with _only_reading("robosim.run.make_building"):
        main(f"episode flat {option} {folder}/a.safetensors --no-video --out {folder}/out".split())


def _slam(folder: Path, file: Path) -> None:
    """All of it: what is read goes on to be mapped."""
    with (
        patch("robosim.drawing.plots.draw_maps", lambda *a: None),
        patch("robosim.drawing.plots.draw_trajectories", lambda *a: None),
    ):
        main(["slam", str(file), "--out", str(folder / "out")])


def _calibrate(folder: Path, file: Path) -> None:
    with patch("robosim.drawing.plots.draw_errors", lambda *a: None):
        main(["calibrate", str(file), "--out", str(folder / "out")])


def _furnished_building(folder: Path, file: Path) -> None:
    make_building(two_rooms(0.8), furnishings=read_furnishings(folder / "room.yaml"))


def _collect_searches(folder: Path, file: Path) -> None:
    collect_searches(replace(SEARCHES, episodes=2), folder, Console(quiet=True))


def _radio_table(folder: Path, file: Path) -> None:
    RadioTable.read(file, make_building(small_plan()))


def _furnishing(folder: Path, file: Path) -> None:
    furnishing_from_file(file, at=(1.0, 1.0))


def _episode_with_config(folder: Path, file: Path) -> None:
    with _only_reading("robosim.run.make_building"):
        main(["episode", "flat", "--config", str(file), "--no-video", "--out", str(folder / "out")])


def _antenna(folder: Path, file: Path) -> None:
    """Whatever is read has a gain everywhere."""
    assert np.isfinite(read_pattern(file).amplitude(sphere(8)[0])).all()


def _command(words: str) -> Callable[[Path, Path], None]:
    """A command that is given the damaged file as {1} and its folder as {0}, and ends where the work begins."""

    def call(folder: Path, file: Path) -> None:
        with _only_reading(*STOPS):
            main(words.format(folder, file).split())

    return call


def _bag_folder(folder: Path, file: Path) -> None:
    read_log(file.parent if file.parent.is_dir() else folder)


TARGETS: dict[str, Target] = {
    "ros map": Target("ros-pgm", "map.*", _ros, names=".yaml"),
    "ros map with png": Target("ros-png", "map.*", _ros, names=".yaml"),
    "ros map in full": Target("ros-rich", "map.*", _ros, names=".yaml"),
    "furnished ros map": Target("ros-furnished", "map*", _map, 0.5, names=".yaml"),
    "furnishings": Target("furnishings", "*", _furnishings, 2, names="room.yaml"),
    "ros map with materials": Target("ros-materials", "map*", _map, names=".yaml"),
    "real ros map": Target("real-ros", "*", _ros, names=".yaml"),
    "building of storeys": Target("storeys", "*", _storeys, names=".yaml"),
    "image": Target("images", "*", _plan, 3),
    "grid, house, array": Target("plans", "*", _plan, 3),
    "real grid": Target("real-grid", "*", _plan, 0.5),
    "plans of a folder": Target("plans", "*", _found_plans, 0.3),
    "mesh": Target("meshes", "*", _plan, 3),
    "drawing": Target("drawings", "*", _plan, 3),
    "building model": Target("models", "*", _plan, 3),
    "robosim plan, building model": Target("models", "ifc4.ifc", _command("plan {1} --out {0}/out"), 0.3, True),
    "plan on the page": Target("plans", "*", _upload),
    "picture on the page": Target("images", "*", _upload),
    "mesh on the page": Target("meshes", "*", _upload),
    "episode on the page": Target("episode", "*", _looked_back),
    "team on the page": Target("team", "*/*", _looked_back, names="robot"),
    "evaluation on the page": Target("evaluation", "episodes/pair/*", _looked_back_on_many),
    "mesh dialects": Target("dialects", "*", _furnishing, 3),
    "furnished building": Target("furnishings", "*", _furnished_building, 2, names="room.yaml"),
    "configuration": Target("config", "result.json", lambda folder, file: read_config(file), 2),
    "radio table": Target("radio-table", "table.parquet", _radio_table),
    "collected searches": Target("searches", "data/metadata.json", _collect_searches, 2),
    "settings of searches": Target("searches", "settings.json", _collect_searches, 0.5, names="results of"),
    "gltf": Target("gltf", "*", lambda folder, file: read_plan(folder / "a.gltf"), names="a.gltf"),
    "mapper": Target("weights-mapper", "*", lambda folder, file: load_mapper(folder / "a.safetensors")),
    "explorer": Target("weights-explorer", "*.s*", lambda folder, file: load_chooser(file), 0.5),
    "search": Target("weights-search", "*.s*", lambda folder, file: load_search(file), 0.5),
    "link states": Target("weights-link-state", "*", lambda folder, file: classifier_of_file(folder / "a.safetensors")),
    "log": Target("episode", "*", _log, 3),
    "suite": Target("evaluation", "suite.*", _suite, 2),
    "settings": Target("evaluation", "settings.json", _settings, names="results of"),
    "episode": Target("evaluation", "episodes/pair/*", _episode, 2),
    "shard": Target("shards", "home-*", _shard),
    "collected": Target("shards", "settings.json", _collected, 0.3, names="results of"),
    "links": Target("dataset", "links/*", _records, 2),
    "data set": Target("dataset", "manifest.json", lambda folder, file: read_links(folder), 0.5),
    "paths": Target("paths", "*", _paths, 2),
    "measurements": Target("measurements", "pair/*", lambda folder, file: read_links(folder), 2),
    "real measurements": Target("real-measurements", "*/*", lambda folder, file: read_links(folder), 0.5),
    "transmitters": Target("measurements", "pair/*_tx_pos.csv", lambda folder, file: read_tx_positions(file), 0.3),
    "checkpoint of a mapper": Target("checkpoints", "mapper.pt", _mapper_checkpoint, 0.7),
    "checkpoint of an explorer": Target("checkpoints", "explorer.pt", _explorer_checkpoint, 0.7),
    "checkpoint of a classifier": Target("checkpoints", "link-state.pt", _link_checkpoint, 0.7),
    "checkpoint of a search": Target("checkpoints", "search.pt", _search_checkpoint, 0.7),
    "homes": Target("arrays", "home-*", _homes, 0.3),
    "bench": Target("arrays", "bench.json", lambda folder, file: read_json(file, "results", keys=("rows",)), 0.3),
    "robot's log": Target("logs", "*.[lc]*", lambda folder, file: read_log(file), 2),
    "robot": Target("robots", "robot.*", lambda folder, file: read_robot(file), 0.5),
    "layers of a wall": Target("small", "wall.yaml", lambda folder, file: read_material(file), 0.5),
    "antenna": Target("small", "[sg]*.[mc]s*", _antenna, 2),
    "crowd": Target("robots", "crowd.*", lambda folder, file: mover_of_file(file), 0.5),
    "runs": Target("robots", "runs.csv", lambda folder, file: read_runs(file), 0.5),
    "measured paths": Target("robots", "paths.csv", lambda folder, file: read_measured_paths(file), 0.5),
    "bag": Target("bags", "*", lambda folder, file: read_log(file)),
    "bag folder": Target("bag-folder", "*/*", _bag_folder, names="case"),
    "mitsuba scene": Target("scenes", "scene.xml", lambda folder, file: read_mitsuba(file), 0.5),
    "robosim slam --inspect": Target("bags", "*", _command("slam --inspect {1} --json"), 0.7, True),
    "robosim export": Target("exported", "*", _command("export {0} --out {0}/out"), 0.5, True),
    "robosim export, team": Target("team", "*/*", _command("export {0} --out {0}/out"), 0.5, True, "robot"),
    "robosim slam": Target("logs", "*.[lc]*", _slam, 0.7, True),
    "robosim calibrate": Target("robots", "runs.csv", _calibrate, 0.3, True),
    "robosim episode --config": Target("config", "result.json", _episode_with_config, 0.5, True),
    "robosim replay": Target("episode", "*", _replay, 0.7, True),
    "robosim replay, team": Target("team", "*/*", _replay, 0.5, True, "robot"),
    "robosim evaluate": Target("evaluation", "[!e]*", _evaluate, 1, True, "results of"),
    "robosim evaluate, again": Target("evaluation", "episodes/pair/*", _evaluate_finished, 0.7, True),
    "robosim train mapper": Target("shards", "home-*", _train_mapper, 0.5, True),
    "robosim train link-state": Target("dataset", "**/*.*", _train_link_state, 0.5, True),
    "robosim train link-state, published": Target("measurements", "pair/*", _train_link_state, 0.5, True),
    "robosim episode --mapper": Target("weights-mapper", "*", _episode_with_mapper, 0.4, True, "a.safetensors"),
    "robosim episode --link-states": Target(
        "weights-link-state", "*", _episode_with_classifier, 0.4, True, "a.safetensors"
    ),
}  # fmt: skip
TARGETS |= {
    f"robosim {words.split()[0]}, {name}": Target(
        "small", name, _command(words), 0.5, True, words.split("{0}/")[1].split()[0]
    )
    for name, words in COMMANDS.items()
}
