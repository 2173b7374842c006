"""Furnished buildings on the command line: homes made so, and lists of what is added to any plan."""

import json

import pytest

from robosim.cli import main
from robosim.plans.files import read_plan
from robosim.plans.formats.furnishing_file import read_furnishings


def output(capsys, *words) -> dict:
    main([*map(str, words), "--json"])
    return json.loads(capsys.readouterr().out)


def test_a_home_is_made_with_heights_and_looked_at(tmp_path, capsys):
    """The map names the list next to it; a low robot gets to more of the floor; radio leaves the plan's engine."""
    main(["generate", "--seed", "2", "--heights", "--out", str(tmp_path / "homes")])
    home = tmp_path / "homes" / "home-2.yaml"
    assert read_plan(home).furnishings
    capsys.readouterr()
    found = output(capsys, "plan", home, "--mast", "0.3", "--out", tmp_path / "plan")
    assert found["radio"] == "space"
    assert found["furnishings"] == len(read_plan(home).furnishings)
    assert found["height_m"] == pytest.approx(0.315)
    # What the command wrote is furnished too.
    assert read_plan(tmp_path / "plan" / "home-2.yaml").digest() == read_plan(home).digest()


def test_a_list_is_placed_in_addition_to_those_of_a_plan(tmp_path, capsys):
    """Without it the same plan is traced as one."""
    (tmp_path / "room.yaml").write_text("- {piece: table, at: [6.0, 9.3], yaw_deg: 55}\n")
    assert len(read_furnishings(tmp_path / "room.yaml")) == 1
    words = ("trace", "cottage", "--tx", "6.5,8.5", "--rx", "5.6,9.9,0.5", "--max-reflections", "0")
    bare = output(capsys, *words, "--out", tmp_path / "bare")
    table = output(capsys, *words, "--furnishings", tmp_path / "room.yaml", "--out", tmp_path / "furnished")
    assert bare["states"] == ["los"]
    assert table["states"] != ["los"]  # the receiver stands behind the top
    assert output(capsys, "plan", "cottage", "--out", tmp_path / "plan")["radio"] == "plan"


def test_a_thing_in_a_wall_ends_a_command_with_one_sentence(tmp_path, capsys):
    (tmp_path / "room.yaml").write_text("- {piece: table, at: [1.0, 1.0]}\n")
    with pytest.raises(SystemExit) as ended:
        main(
            ["plan", "cottage", "--furnishings", str(tmp_path / "room.yaml"), "--out", str(tmp_path / "plan")]
        )
    assert ended.value.code == 2
    expected = f"{tmp_path}/room.yaml: entry 1: table at (1, 1) m stands in a wall or outside of the building"
    assert expected in capsys.readouterr().err
