"""Driven wheels: pairs of round bodies on the floor; steered wheels and rollers are errors, casters are left out."""

import math
from pathlib import Path

import numpy as np
import pytest

from robosim.robot.calibration import open_floor
from robosim.robot.dynamic import World
from robosim.robot.model_file import Model, model_of, read_model
from robosim.support.reading import FileError
from slam.poses import between
from tests.made_robots import TWO, URDF, WHEEL

LIMIT = '<limit lower="-0.6" upper="0.6"/>'


def _swivel(x: float, y: float, trail: float, limit: str, side: str, radius: float = 0.05) -> str:
    kind = "revolute" if limit else "continuous"
    wheel = WHEEL.format(side=f"{side}_wheel", x=-trail, y=0, axis=1).replace(
        '<parent link="base"/>', f'<parent link="{side}"/>'
    )
    wheel = wheel.replace('radius="0.05"', f'radius="{radius}"').replace(
        f"{-trail} 0 0.04", f"{-trail} 0 {radius - 0.01}"
    )
    return (
        f'<joint name="{side}_steer" type="{kind}"><parent link="base"/><child link="{side}"/>'
        f'<origin xyz="{x} {y} 0"/><axis xyz="0 0 1"/>{limit}</joint><link name="{side}"/>{wheel}'
    )


def _model(folder: Path, wheels: str) -> Model:
    path = folder / "robot.urdf"
    path.write_text(URDF.replace("WHEELS", wheels))
    return model_of(path)


@pytest.mark.parametrize(
    "front",
    [
        _swivel(0.3, 0.15, 0, LIMIT, "fl") + _swivel(0.3, -0.15, 0, LIMIT, "fr"),
        _swivel(0.3, 0, 0, LIMIT, "front"),
        _swivel(0.3, 0, 0, LIMIT, "front", radius=0.03),
        _swivel(0.3, 0.15, 0, "", "fl") + _swivel(0.3, -0.15, 0, "", "fr"),  # a swerve drive
    ],
)
def test_find_wheels_rejects_steered_wheels(tmp_path: Path, front: str) -> None:
    with pytest.raises(FileError, match=r"is steered by hinge f.*_steer, expected a differential drive"):
        _model(tmp_path, TWO + front)


def test_find_wheels_rejects_wheels_fixed_on_steering_knuckles(tmp_path: Path) -> None:
    knuckle = _swivel(0.3, 0, 0, LIMIT, "front").replace(
        'name="front_wheel_joint" type="continuous"', 'name="f" type="fixed"'
    )
    with pytest.raises(FileError, match="wheel front is steered by hinge front_steer"):
        _model(tmp_path, TWO + knuckle)


@pytest.mark.parametrize("radius", [0.03, 0.05])
def test_find_wheels_leaves_out_casters(tmp_path: Path, radius: float) -> None:
    casters = _swivel(0.3, 0.15, 0.03, "", "cl", radius) + _swivel(0.3, -0.15, 0.03, "", "cr", radius)
    model = _model(tmp_path, TWO + casters)
    assert [wheel.link for side in model.wheels for wheel in side] == ["left", "right"]


def test_find_wheels_rejects_rollers(tmp_path: Path) -> None:
    rollers = "".join(
        f'<joint name="{side}{k}" type="continuous"><parent link="{side}"/><child link="{side}{k}"/>'
        f'<axis xyz="1 0 1"/></joint><link name="{side}{k}"/>'
        for side in ("left", "right")
        for k in range(6)
    )
    with pytest.raises(FileError, match="wheel left_joint has 6 rollers"):
        _model(tmp_path, TWO + rollers)


def test_find_wheels_takes_the_floor_from_wheels_above_a_hanging_arm(tmp_path: Path) -> None:
    """An elbow, round around y and lower than the wheels, is no wheel: the axle stays where it is."""
    elbow = WHEEL.format(side="elbow", x=0.5, y=0, axis=1).replace("0.5 0 0.04", "0.5 0 -0.3")
    assert _model(tmp_path, TWO + elbow).axle == pytest.approx(_model(tmp_path, TWO).axle)


def _aside(side: str, y: float, axis: float) -> str:
    """A wheel whose joint is 5 cm nearer to the middle than its tyre."""
    wheel = WHEEL.format(side=side, x=0, y=y - math.copysign(0.05, y), axis=axis)
    return wheel.replace("<collision>", f'<collision><origin xyz="0 0 {math.copysign(0.05, y)}"/>')


def test_find_wheels_takes_the_track_between_tyres(tmp_path: Path) -> None:
    """Joints 0.2 m and tyres 0.3 m apart: it is 0.3 m, and a turn of both kinds of file is as wide."""
    model = _model(tmp_path, _aside("left", 0.15, 2) + _aside("right", -0.15, -1))
    drawn = _model(tmp_path, TWO)
    assert [side[0].place[1] for side in model.wheels] == pytest.approx([0.15, -0.15])
    assert model.axle == pytest.approx(drawn.axle, abs=1e-6)
    np.testing.assert_allclose(model.outline_m, drawn.outline_m, atol=1e-6)
    path = tmp_path / "robot.urdf"
    path.write_text(URDF.replace("WHEELS", _aside("left", 0.15, 2) + _aside("right", -0.15, -1)))
    world = World(open_floor(), robot=read_model(path))
    world.reset(start := np.array([2.0, 2.0, 0.3]))
    world.move(np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(between(start, world.pose), [0, 0, 1], atol=2e-3)


def test_find_wheels_rejects_wheels_of_boxes(tmp_path: Path) -> None:
    """A square prism has no radius: 0.05 m to its sides, 0.071 m to its edges."""
    boxes = TWO.replace('<cylinder length="0.02" radius="0.05"/>', '<box size="0.1 0.1 0.02"/>')
    with pytest.raises(FileError, match="round wheels that turn around y on the floor are none"):
        _model(tmp_path, boxes)
