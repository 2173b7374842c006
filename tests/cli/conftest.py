"""What tests of the command line share."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from robosim.cli import main
from robosim.plans.files import write_ros
from tests.plans import two_rooms


@pytest.fixture(scope="session")
def plan_file(tmp_path_factory) -> Path:
    """Two rooms with a door of 0.8 m, as a ROS map."""
    path = tmp_path_factory.mktemp("plan") / "pair.yaml"
    write_ros(two_rooms(0.8), path)
    return path


@pytest.fixture
def fails(capsys) -> Callable[..., str]:
    """Runs a command that must end with status 2 and no traceback; returns its message in one line."""

    def run(*arguments: object) -> str:
        with pytest.raises(SystemExit) as stop:
            main([str(argument) for argument in arguments])
        assert stop.value.code == 2
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return re.sub(r"\s+", " ", captured.err)

    return run
