"""Folders of results: one command, one set of settings, one process at a time, and nothing left of what failed."""

import json
import os

import pytest

from robosim.support.files import partial_path
from robosim.support.run_folder import SETTINGS, FolderError, check_folder, run_folder

ONE = {"seed": 1, "tracer": {"reflections": 3}}


def _write(folder, name="result.txt"):
    (folder / name).write_text("done")


def settings_in(folder):
    return json.loads((folder / SETTINGS).read_text())["settings"]


def test_the_same_settings_go_on(tmp_path):
    for _ in range(2):
        with run_folder(tmp_path / "a", "dataset", ONE) as folder:
            _write(folder)
    assert settings_in(tmp_path / "a") == ONE


def test_other_settings_are_named_and_change_nothing(tmp_path):
    with run_folder(tmp_path, "dataset", ONE) as folder:
        _write(folder)
    before = (tmp_path / "settings.json").read_bytes()
    with (
        pytest.raises(FolderError, match=r"tracer\.reflections 3 there, 1 now"),
        run_folder(tmp_path, "dataset", {"seed": 1, "tracer": {"reflections": 1}}),
    ):
        pass
    assert (tmp_path / "settings.json").read_bytes() == before


def test_settings_may_grow_where_that_is_meant(tmp_path):
    """Plans may be added or left out, the ones in both have to be the same."""
    with run_folder(tmp_path, "evaluate", {"plans": {"a": 1}}, grows=("plans",)) as folder:
        _write(folder)
    with run_folder(tmp_path, "evaluate", {"plans": {"b": 2}}, grows=("plans",)):
        pass
    assert settings_in(tmp_path) == {"plans": {"a": 1, "b": 2}}
    with (
        pytest.raises(FolderError, match=r"plans\.a 1 there, 9 now"),
        run_folder(tmp_path, "evaluate", {"plans": {"a": 9}}, grows=("plans",)),
    ):
        pass


@pytest.mark.parametrize("settings", [None, ONE])
def test_the_results_of_another_command_are_left_alone(tmp_path, settings):
    with run_folder(tmp_path, "collect", settings) as folder:
        _write(folder)
    for check in (
        lambda: check_folder(tmp_path, "dataset"),
        lambda: run_folder(tmp_path, "dataset").__enter__(),
    ):
        with pytest.raises(FolderError, match="holds the results of `robosim collect`"):
            check()


def test_what_came_to_nothing_leaves_nothing(tmp_path):
    """A folder that was made is removed again, one that was there is empty, and its settings do not bind."""
    (tmp_path / "there").mkdir()
    for name in ("there", "new"):
        with pytest.raises(ValueError, match="no good"), run_folder(tmp_path / name, "dataset", ONE):
            raise ValueError("no good")
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
    with run_folder(tmp_path / "there", "collect", {"seed": 2}) as folder:
        _write(folder)


def test_what_a_killed_process_left_is_removed(tmp_path):
    with run_folder(tmp_path, "dataset", ONE) as folder:
        _write(folder)
        (folder / "units").mkdir()
    left = partial_path(tmp_path / "units" / "a.parquet")
    left.write_bytes(b"PAR1")
    partial_path(tmp_path / "scene").mkdir()
    with run_folder(tmp_path, "dataset", ONE):
        assert not left.exists()
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["result.txt", "settings.json", "units"]


def test_two_do_not_work_in_one_folder(tmp_path):
    with (
        run_folder(tmp_path, "dataset", ONE),
        pytest.raises(FolderError, match="Another process is at work"),
        run_folder(tmp_path, "dataset", ONE),
    ):
        pass


def test_files_of_unknown_settings_are_not_mixed_in(tmp_path):
    """A run that would go on from what it finds must know of which settings that is."""
    _write(tmp_path)
    (tmp_path / "settings.json").write_text("{")
    with pytest.raises(FolderError, match="does not say of which"), run_folder(tmp_path, "dataset", ONE):
        pass
    assert (tmp_path / "settings.json").read_text() == "{"


def test_files_of_a_person_do_not_matter(tmp_path):
    """The log of a batch job, say, which is there before the command is."""
    _write(tmp_path, "job.log")
    with run_folder(tmp_path, "dataset", ONE) as folder:
        _write(folder)
    assert settings_in(tmp_path) == ONE


def test_a_claimed_folder_inside_is_its_own(tmp_path):
    """Frames that a training collects for itself are no results of the training."""
    with run_folder(tmp_path / "frames", "collect", ONE) as folder:
        _write(folder)
    with run_folder(tmp_path, "train mapper", ONE) as folder:
        _write(folder)


@pytest.mark.parametrize("kind", ["file", "below a file", "dangling link", "long"])
def test_what_cannot_be_a_folder_is_an_error_before_the_work(tmp_path, kind):
    _write(tmp_path, "file")
    os.symlink("nowhere", tmp_path / "dangling link")
    path = {"below a file": tmp_path / "file" / "x", "long": tmp_path / ("x" * 300)}.get(
        kind, tmp_path / kind
    )
    with pytest.raises(FolderError, match="out is '"):
        check_folder(path, "plan")
    assert json.dumps(sorted(p.name for p in tmp_path.iterdir())) == '["dangling link", "file"]'
