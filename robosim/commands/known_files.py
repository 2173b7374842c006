"""Files of this project that are given as the log of a robot: the message names the command that reads them."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from shlex import quote

import pyarrow.parquet as pq

from robosim.plans.files import READERS
from robosim.plans.storey_plans import is_storeys
from robosim.recording.episode_file import EPISODE
from robosim.support.parts import Part
from robosim.support.reading import FileError, reading, shown

_NUMPY = "numpy.load in Python"
_LINKS, _FRAMES = "robosim train link-state --data", "robosim train mapper --data"
_PLAN = ("a floor plan", "robosim plan {file}, or robosim slam LOG --map {file} to locate a robot on it")
_ROBOT, _NONE = ("a robot", "robosim robot {file}"), ("", "")
#: Arrays of archives and columns of tables that each kind has, its name, and how it is read.
_CONTENT = (
    ({"head", "ring", "pose"}, "a recorded episode", "robosim replay {folder}"),
    ({"depth", "odometry", "belief"}, "frames of robosim collect", f"{_FRAMES} {{folder}}"),
    ({"path_gain_db", "link_state"}, "links of a data set", f"{_LINKS} {{folder}}"),
    ({"interaction", "delay_s", "power"}, "traced paths", "wireless.Paths.read_parquet in Python"),
    ({"is_best_server", "sinr_db"}, "coverage of robosim trace", "pandas.read_parquet in Python"),
    ({"best_server", "sinr_db"}, "coverage of robosim trace", _NUMPY),
    ({"response", "offset_hz"}, "frequency responses of robosim trace", _NUMPY),
    ({"doppler_hz", "time_s"}, "impulse responses of robosim trace", _NUMPY),
)
#: Files that folders have, and likewise.
_FOLDERS = (
    (EPISODE, "an episode", "robosim replay {file}"),
    ("episodes", "an evaluation", "robosim live {file}"),
    ("manifest.json", "a data set of links", f"{_LINKS} {{file}}"),
    ("home-*.npz", "frames of robosim collect", f"{_FRAMES} {{file}}"),
)
#: Words that show the kind of files of an ending that many kinds have, and how much of the file is searched [bytes].
_TREES = {b"image:": _PLAN, b'"verts"': _PLAN, b"radius_m": _ROBOT}
_TREES[b'"units"'] = ("the manifest of a data set", f"{_LINKS} {{folder}}")
_SCENE = {b"<scene": ("a Mitsuba scene", "robosim trace {file}"), b"<mujoco": _ROBOT, b"<robot": _ROBOT}
_MARKS = {".xml": _SCENE, ".yaml": _TREES, ".yml": _TREES, ".json": _TREES}
_HEAD_BYTES = 100_000
_WEIGHTS = ("weights of a network", "robosim episode PLAN --mapper {file}")
_ENDINGS = {".safetensors": _WEIGHTS, ".urdf": _ROBOT, **dict.fromkeys(READERS, _PLAN)}


@contextmanager
def naming_other_files(path: Path, log_reader: Part = "auto") -> Iterator[None]:
    """Replace errors on a log by what its file is and what reads it, if it is another file of this project."""
    try:
        yield
    except ValueError as error:
        kind, reader = _kind_of(path) if log_reader == "auto" else _NONE
        if not kind:
            raise
        folder = path.parent
        if (
            kind == "a recorded episode" and path.name != EPISODE
        ):  # of an evaluation: OUT/episodes/PLAN/NAME.npz
            folder, reader = folder.parent.parent, "robosim live {folder}"
        elif kind == "links of a data set":  # OUT/links/NAME.parquet
            folder = folder.parent
        command = reader.format(file=quote(str(path)), folder=quote(str(folder)))
        raise FileError(
            f"{shown(path)}: holds {kind}, expected a robot's log. Read it by {command}."
        ) from error


def _kind_of(path: Path) -> tuple[str, str]:
    """What a file or folder of this project is, and how it is read; empty for others."""
    ending = path.suffix.lower()
    if path.is_dir():
        return next(((kind, by) for name, kind, by in _FOLDERS if any(path.glob(name))), _NONE)
    if ending in (".npz", ".parquet"):
        names = _names(path)
        return next(((kind, by) for needed, kind, by in _CONTENT if needed <= names), _NONE)
    from robosim.evaluation.suite import is_suite  # which imports the whole simulator

    if is_suite(path):
        return "a suite", "robosim evaluate {file}"
    if is_storeys(path):
        return "a building of storeys", "robosim trace {file}"
    if ending in _MARKS:
        with suppress(FileError), reading(path, "a file") as file:
            head = file.read(_HEAD_BYTES)
            return next((kind for mark, kind in _MARKS[ending].items() if mark in head), _NONE)
        return _NONE
    return _ENDINGS.get(ending, _NONE) if path.is_file() else _NONE


def _names(path: Path) -> set[str]:
    """Names of the arrays of an archive or of the columns of a table; empty for a damaged one."""
    with suppress(OSError, ValueError, zipfile.BadZipFile):
        if path.suffix.lower() == ".parquet":
            return set(pq.read_schema(path).names)
        with zipfile.ZipFile(path) as archive:
            return {name.removesuffix(".npy") for name in archive.namelist()}
    return set()
