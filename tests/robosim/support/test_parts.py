"""Parts of a user: errors in them name the user's file and line."""

import sys

import numpy as np
import pytest

from robosim.parts import READER
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FloorPlan, MapError
from robosim.support.parts import imported, place_in_part
from robosim.support.workers import Workers

OWN = """def fails(path, said):
    return helper({})


def helper(values):
    return values["no such key"]


def nothing(path, said):
    return None


def count(*given):
    raise ZeroDivisionError(f"after {len(given)}")
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    """The file of a user's module, in the current folder."""
    (tmp_path / "own_parts.py").write_text(OWN)
    (tmp_path / "plan.mine").write_text("a plan")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield tmp_path / "own_parts.py"
    sys.modules.pop("own_parts", None)


def call_part(name):
    """Runs in a process of its own, as each part of an evaluation does."""
    return imported("part", name)()


def raised(call, *given):
    with pytest.raises(Exception) as caught:
        call(*given)
    return caught.value


def test_an_error_names_the_innermost_line_of_the_users_file(own):
    error = raised(imported("reader", "own_parts:fails"), None, None)
    assert place_in_part(error) == f"{own}, line 6, in helper"


def test_an_error_of_a_library_called_by_the_user_names_the_users_line(own):
    own.write_text("import numpy as np\n\n\ndef shape(*given):\n    return np.zeros(-1)\n")
    assert place_in_part(raised(imported("part", "own_parts:shape"))) == f"{own}, line 5, in shape"


def test_an_error_of_this_package_is_of_no_part(own):
    imported("reader", "own_parts:fails")
    assert place_in_part(raised(np.zeros, -1)) == ""
    assert place_in_part(raised(read_plan, "no such plan")) == ""


def test_an_error_in_another_process_names_the_users_line_too(own):
    with Workers(2, what="counts") as pool:
        error = raised(lambda: list(pool.run(call_part, [("own_parts:count",)] * 2)))
    assert place_in_part(error) == f"{own}, line 14, in count"


def test_a_command_prints_the_users_line(own, capsys):
    from robosim.cli import main

    with pytest.raises(SystemExit) as ended:
        main(["plan", "plan.mine", "--reader", "own_parts:fails", "--out", "out"])
    message = capsys.readouterr().err
    assert ended.value.code == 1
    assert f"KeyError in your own part, {own}, line 6, in helper: 'no such key'" in message
    assert "internal error" not in message and "Traceback" not in message


def test_a_reader_that_returns_no_plan_is_named_with_the_file(own):
    with pytest.raises(MapError) as error:
        read_plan("plan.mine", reader="own_parts:nothing")
    assert str(error.value) == "plan.mine: reader own_parts:nothing gave a NoneType, expected a FloorPlan"


def test_a_reader_as_an_object_is_used(own):
    plan = FloorPlan(occupancy=np.zeros((4, 4), np.uint8), resolution_m=0.1, name="mine")
    assert read_plan("plan.mine", reader=lambda path, said: plan) is plan
    assert READER.shipped
