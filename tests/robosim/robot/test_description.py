"""Descriptions of robots: masses are those that files state; damaged files are rejected in one line."""

import os
from pathlib import Path

import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from robosim.robot.calibration import open_floor
from robosim.robot.dynamic import World
from robosim.robot.model_file import model_of, read_model
from robosim.support.reading import FileError
from tests.made_robots import MJCF, TWO, URDF

CART = URDF.replace("WHEELS", TWO)
BOX = '<box size="0.4 0.2 0.1"/>'
END = "</worldbody>"


def _write(folder: Path, text: str, name: str = "robot.urdf") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def _part(name: str, inside: str = "", joint: str = "fixed", of_joint: str = "") -> str:
    return (
        f'<link name="{name}">{inside}</link><joint name="{name}_j" type="{joint}"><parent link="base"/>'
        f'<child link="{name}"/>{of_joint}</joint></robot>'
    )


def _inertial(mass: str, inertia: str = 'ixx="1e-3" iyy="1e-3" izz="1e-3"') -> str:
    return f'<inertial><mass value="{mass}"/><inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial>'


@settings(max_examples=25, deadline=None)
@given(
    masses=st.lists(st.one_of(st.none(), st.just(0.0), st.floats(1e-3, 50)), min_size=1, max_size=5),
    has_shape=st.booleans(),
    joint=st.sampled_from(["fixed", "revolute", "continuous", "prismatic", "floating", "planar"]),
)
def test_model_of_sums_the_masses_of_the_file(
    tmp_path_factory: pytest.TempPathFactory, masses: list[float | None], has_shape: bool, joint: str
) -> None:
    """Links with and without inertials and shapes, on any joint: the sum of what is stated, to 1e-6."""
    text = CART
    for number, mass in enumerate(masses):
        inside = "" if mass is None else _inertial(str(mass))
        if has_shape:
            inside += "<collision><geometry><sphere radius='0.1'/></geometry></collision>"
        origin = '<origin xyz="0 0 0.4"/><axis xyz="0 0 1"/>'
        text = text.replace("</robot>", _part(f"p{number}", inside, joint, origin))
    model = model_of(_write(tmp_path_factory.mktemp("robot"), text))
    stated = [mass or 0.0 for mass in masses]
    assert model.mass_kg == pytest.approx(3 + sum(stated), rel=1e-6)
    assert sum(model.masses_kg.values()) == pytest.approx(3.4 + sum(stated), rel=1e-6)


def test_model_of_counts_the_mass_of_a_child_without_geometry(tmp_path: Path) -> None:
    start = CART.index("  <inertial><origin")
    stop = CART.index("</inertial>", start) + len("</inertial>")
    text = CART[:start] + CART[stop:]
    path = _write(tmp_path, text.replace("</robot>", _part("inertia_link", _inertial("5"))))
    assert model_of(path).masses_kg == pytest.approx({"inertia_link": 5.0, "left": 0.2, "right": 0.2})
    simulated = World(open_floor(), robot=read_model(path)).model
    bodies = [simulated.body(k) for k in range(simulated.nbody)]
    assert sum(body.mass[0] for body in bodies if "model/" in body.name) == pytest.approx(5.4)


@pytest.mark.parametrize(
    "inside",
    [
        _part("f", _inertial("0.01"), "revolute", '<axis xyz="0 0 1"/><limit lower="0" upper="0"/>'),
        _part("f", _inertial("0.01"), "revolute", '<axis xyz="0 0 1"/><limit lower="1" upper="-1"/>'),
        _part("f", _inertial("0.01"), "revolute", '<axis xyz="0 0 0"/><limit lower="-1" upper="1"/>'),
        _part("f", _inertial("0.01", 'ixx="0" iyy="0" izz="0"')),
        _part("f", _inertial("0.01", 'ixx="1e-3" iyy="0" izz="-1e-6"')),
        _part("f", _inertial("0.01", 'ixx="1" iyy="1e-3" izz="1e-3"')),
        _part("f", _inertial("0.01"), "prismatic", '<axis xyz="0 0 1"/><limit lower="0" upper="0"/>'),
        _part(
            "f", _inertial("0.01") + '<collision><geometry><mesh filename="flat.stl"/></geometry></collision>'
        ),
        _part(
            "f",
            _inertial("0.01") + "<collision><geometry><box size='.02 .02 .6'/></geometry></collision>",
            "revolute",
            '<axis xyz="0 1 0"/><limit lower="-3" upper="3"/>',
        ),
    ],
)
def test_model_of_reads_parts_that_do_not_matter(tmp_path: Path, inside: str) -> None:
    """Limits, inertias, flat meshes and arms below the wheels change neither mass nor wheels."""
    square = trimesh.Trimesh(
        [[0, 0, 0.1], [0.1, 0, 0.1], [0.1, 0.1, 0.1], [0, 0.1, 0.1]], [[0, 1, 2], [0, 2, 3]]
    )
    square.export(tmp_path / "flat.stl")
    path = _write(tmp_path, CART.replace("</robot>", inside))
    model, drawn = model_of(path), model_of(_write(tmp_path, CART, "drawn.urdf"))
    assert model.mass_kg == pytest.approx(3.01, rel=1e-6)
    assert [wheel.joint for side in model.wheels for wheel in side] == ["left_joint", "right_joint"]
    assert model.axle == pytest.approx(drawn.axle)
    World(open_floor(), robot=read_model(path))


def test_load_description_takes_meshes_next_to_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also in single quotes, and with another mesh of that name in the current folder."""
    (tmp_path / "here").mkdir()
    (tmp_path / "there").mkdir()
    trimesh.creation.box((2, 2, 2)).export(tmp_path / "here" / "body.stl")
    trimesh.creation.box((0.4, 0.2, 0.1)).export(tmp_path / "there" / "body.stl")
    monkeypatch.chdir(tmp_path / "here")
    path = _write(tmp_path / "there", CART.replace(BOX, "<mesh filename='body.stl'/>"))
    drawn = model_of(_write(tmp_path, CART))
    assert model_of(path).height_m == pytest.approx(drawn.height_m)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (CART.replace('value="0.2"', 'value="2e8"'), "the mass of left is 2e\\+08 kg"),
        (CART.replace('value="3"', 'value="nan"'), "value of <mass> is 'nan'"),
        (CART.replace('value="3"', 'value="-3"'), "mass of link 'base' is -3"),
        (CART.replace('ixx="0.02"', 'ixx="1e999"'), "expected finite numbers"),
        (
            CART.replace("</robot>", _part("f", "", "revolute", '<limit lower="NaN" upper="1"/>')),
            "lower of <limit>",
        ),
        (CART.replace(BOX, "<mesh filename='pipe'/>"), "pipe: is a named pipe"),
        (CART.replace(BOX, "<mesh filename='missing.stl'/>"), "no mesh missing.stl"),
        (CART.replace("base_scan", "$(arg prefix)scan"), "is xacro"),
        (MJCF.replace(END, f"{END}<asset><model name='z' file='robot.xml'/></asset>"), "includes itself"),
        (MJCF.replace(END, f"{END}<include file='robot.xml'/>"), "includes itself"),
        (MJCF.replace(END, f"{END}<include file='other.xml'/>"), "includes itself"),
        (MJCF.replace(END, f"{END}<include file='pipe'/>"), "pipe: is a named pipe"),
        (MJCF.replace(END, f"{END}<asset><mesh name='m' file='pipe'/></asset>"), "pipe: is a named pipe"),
        (
            MJCF.replace(END, f"<replicate count='100000000'><geom size='1'/></replicate>{END}"),
            "elements, expected",
        ),
        (
            MJCF.replace(END, 3 * "<replicate count='1000'>" + "<geom size='1'/>" + 3 * "</replicate>" + END),
            "elements, expected",
        ),
        (MJCF.replace('mass="4"', 'mass="nan"'), "mass of <geom> is 'nan'"),
        (
            MJCF.replace("<worldbody>", '<compiler settotalmass="9"/><worldbody>'),
            "settotalmass is not supported",
        ),
        (MJCF.replace('mass="0.1"', 'mass="2e8"'), "the mass of l is 2e\\+08 kg"),
    ],
)
def test_model_of_rejects_damaged_files(tmp_path: Path, text: str, reason: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    _write(tmp_path, "<mujoco><include file='robot.xml'/></mujoco>", "other.xml")
    path = _write(tmp_path, text, "robot.urdf" if "<robot" in text else "robot.xml")
    with pytest.raises(FileError, match=reason) as error:
        model_of(path)
    assert path.name in str(error.value) and "\n" not in str(error.value)


def test_model_of_leaves_out_what_does_not_hang_on_the_robot(tmp_path: Path) -> None:
    table = '<body name="table" pos="0 3 0"><geom type="box" size="1 1 1"/></body>'
    drawn, model = (
        model_of(_write(tmp_path, text, "robot.xml")) for text in (MJCF, MJCF.replace(END, table + END))
    )
    assert model.mass_kg == pytest.approx(drawn.mass_kg) and model.outline_m == drawn.outline_m
    assert any("table" in note for note in model.notes)


def test_model_of_says_which_masses_are_of_water(tmp_path: Path) -> None:
    model = model_of(_write(tmp_path, MJCF.replace(' mass="4"', ""), "robot.xml"))
    assert any("no mass of base is stated" in note for note in model.notes)


def test_model_of_takes_masses_from_the_groups_that_mjcf_names(tmp_path: Path) -> None:
    """Geoms outside of `inertiagrouprange` have no mass."""
    shell = '<geom type="box" size=".1 .1 .02" mass="7" group="1"/><camera name="eye"'
    text = MJCF.replace('<camera name="eye"', shell).replace(
        "<worldbody>", '<compiler inertiagrouprange="0 0"/><worldbody>'
    )
    drawn = model_of(_write(tmp_path, MJCF, "robot.xml"))
    path = _write(tmp_path, text, "robot.xml")
    assert model_of(path).mass_kg == pytest.approx(drawn.mass_kg)
    simulated = World(open_floor(), robot=read_model(path)).model
    bodies = [simulated.body(k) for k in range(simulated.nbody)]
    assert sum(body.mass[0] for body in bodies if "model/" in body.name) == pytest.approx(4.22)


def test_model_of_reads_a_wheel_without_mass(tmp_path: Path) -> None:
    start = CART.index('<inertial><mass value="0.2"/>')
    stop = CART.index("</inertial>", start) + len("</inertial>")
    path = _write(tmp_path, CART[:start] + CART[stop:])
    model = model_of(path)
    assert model.masses_kg == {"base": 3.0, "right": 0.2}
    assert any("wheels left state no mass" in note for note in model.notes)
    World(open_floor(), robot=read_model(path))


def test_model_of_reads_bodies_and_joints_without_names(tmp_path: Path) -> None:
    """A table comes first: the robot that is simulated is the one that was read."""
    table = '<body pos="0 3 0"><geom type="box" size="1 1 1" mass="50"/></body>'
    text = (
        MJCF.replace('<body name="base"', table + "<body")
        .replace("<actuator>", "<!--")
        .replace("</sensor>", "-->")
    )
    for name in ("l", "r"):
        text = text.replace(f'body name="{name}"', "body").replace(f'joint name="{name}"', "joint")
    path = _write(tmp_path, text, "robot.xml")
    model, drawn = model_of(path), model_of(_write(tmp_path, MJCF, "drawn.xml"))
    assert sorted(model.masses_kg.values()) == pytest.approx(sorted(drawn.masses_kg.values()))
    simulated = World(open_floor(), robot=read_model(path)).model
    bodies = [simulated.body(k) for k in range(simulated.nbody)]
    assert sum(body.mass[0] for body in bodies if "model/" in body.name) == pytest.approx(4.22)
