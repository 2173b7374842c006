"""`robosim robot`: what is read of a robot."""

import json
from pathlib import Path

import pytest

from robosim.cli import main
from tests.made_robots import TWO, URDF


def test_robot_prints_what_is_read_of_a_description(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "cart.urdf"
    path.write_text(
        URDF.replace("WHEELS", TWO).replace(
            'type="fixed"><parent link="base"/><child link="base_scan"/>',
            'type="revolute"><parent link="base"/><child link="base_scan"/>',
        )
    )
    main(["robot", str(path), "--json"])
    result = json.loads(capsys.readouterr().out)
    assert result["masses_kg"] == {"base": 3.0, "left": 0.2, "right": 0.2}
    assert result["total_mass_kg"] == pytest.approx(3.4)
    assert [(wheel["side"], wheel["link"]) for wheel in result["wheels"]] == [
        ("left", "left"),
        ("right", "right"),
    ]
    assert result["sensors"]["camera"]["name"] == "camera_link"
    assert result["sensors"]["lidar"]["place_m"] == pytest.approx([0.2, 0, 0.25])
    assert result["fixed_joints"] == ["scan_joint"] and any("speeds" in text for text in result["assumed"])
    main(["robot", str(path)])
    text = capsys.readouterr().out
    assert "left_joint" in text and "3.4 kg" in text and "scan_joint" in text


def test_robot_prints_a_robot_of_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    main(["robot", "turtlebot3_waffle", "--json"])
    robot = json.loads(capsys.readouterr().out)["robot"]
    assert robot["mass_kg"] == 1.743 and robot["camera"]["hfov_deg"] == 59
