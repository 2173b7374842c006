"""Pieces of furniture, meshes sorted into bodies, and the file that says what is placed."""

import numpy as np
import pytest
import trimesh

from robosim.plans.files import read_plan, write_ros
from robosim.plans.formats.furnishing_file import (
    furnishing_from_file,
    read_furnishings,
    write_furnishings,
)
from robosim.plans.furnishings.furnishing import Furnishing, find_bodies
from robosim.plans.furnishings.pieces import (
    PIECES,
    Bed,
    Chair,
    Shelf,
    Sofa,
    Table,
    make_piece,
    solid_of_boxes,
)
from robosim.support.reading import FileError
from tests.plans import room


@pytest.mark.parametrize("piece", PIECES)
def test_pieces_are_closed_and_stand_on_the_floor(piece):
    """Watertight by trimesh, wound alike, of the sizes they say, around the origin, with a positive volume."""
    sizes = PIECES[piece]()
    mesh = sizes.mesh()
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    low, high = mesh.bounds
    tallest = getattr(sizes, "head_m", sizes.height_m)
    assert low[2] == pytest.approx(0, abs=1e-12) and high[2] == pytest.approx(tallest, abs=1e-9)
    np.testing.assert_allclose(high[0] - low[0], sizes.width_m, atol=1e-9)
    np.testing.assert_allclose((low + high)[:2], 0, atol=1e-9)
    bodies = make_piece(piece, at=(0.0, 0.0)).bodies
    assert bodies.oriented.all() and len(bodies.closed) == 1


def test_volumes_are_those_of_the_boards():
    """Table, chair, shelf, sofa and bed, from their sizes, counted once where boards cross."""
    t, c, s, f, b = Table(), Chair(), Shelf(), Sofa(), Bed()
    seat = c.seat_m - c.board_m
    sofa = f.width_m * f.depth_m * (f.seat_m - f.foot_m) + f.arm_m * f.width_m * (f.height_m - f.seat_m)
    sofa += 2 * f.arm_m * (f.depth_m - f.arm_m) * (f.height_m - f.seat_m) / 2 + 4 * 0.06**2 * f.foot_m
    inner = (s.width_m - 2 * s.board_m) * (s.depth_m - s.board_m)
    for piece, volume in (
        (t, t.width_m * t.depth_m * t.top_m + 4 * t.leg_m**2 * t.clearance_m),
        (c, c.width_m * c.board_m * (c.depth_m + c.height_m - c.seat_m) + 4 * c.leg_m**2 * seat),
        (s, s.width_m * s.depth_m * s.height_m - inner * (s.height_m - s.boards * s.board_m)),
        (f, sofa),
        (
            b,
            b.width_m * b.depth_m * (b.height_m - b.clearance_m)
            + b.width_m * 0.05 * (b.head_m - b.height_m)
            + 4 * 0.07**2 * b.clearance_m,
        ),
    ):
        assert piece.mesh().volume == pytest.approx(volume, rel=1e-9)


def test_a_union_of_boxes_has_no_face_inside():
    """Two cubes that overlap by half: volume 1.5, and the area of their union; in any order the same."""
    one, other = ((0, 0, 0), (1, 1, 1)), ((0.5, 0, 0), (1.5, 1, 1))
    for boxes in ((one, other), (other, one)):
        made = solid_of_boxes([*boxes])
        assert made.volume == pytest.approx(1.5) and made.area == pytest.approx(2 + 4 * 1.5)
        assert made.is_watertight


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: make_piece("tabel", at=(0.0, 0.0)),
            "piece is 'tabel'. Did you mean 'table'? Known: table, chair",
        ),
        (lambda: make_piece("table", at=(0.0, 0.0), widht_m=1.0), "Did you mean 'width_m'?"),
        (lambda: Table(top_m=0.8), "top_m is 0.8, expected less than height_m = 0.74 m of a table."),
        (lambda: Sofa(arm_m=0.95), "arm_m is 0.95, expected so little that a seat is left"),
        (lambda: Shelf(boards=50, board_m=0.04), "boards is 50, expected so few of 0.04 m"),
        (lambda: make_piece("chair", at=(np.nan, 0.0)), "x of chair is nan, expected -1e+07 to 1e+07 m."),
        (lambda: make_piece("chair", at=(0.0, 0.0), colour=(300, 0, 0)), "expected red, green and blue"),
        (lambda: make_piece("chair", at=(0.0, 0.0), material="wod"), "Did you mean 'wood'?"),
        (
            lambda: Furnishing(mesh=trimesh.creation.box((3000, 2, 2)), at=(0.0, 0.0)),
            "reaches 1500 m from its origin, expected at most 1000 m. Is it in millimetres? Give unit_m: 0.001.",
        ),
    ],
)
def test_what_makes_no_sense_is_rejected(make, words):
    with pytest.raises(ValueError) as rejected:
        make()
    assert words in str(rejected.value)


def test_soup_of_triangles_is_sorted_into_bodies():
    """Two boxes and a sheet, no corner shared, one box inside out: two closed bodies with outward normals."""
    boxes = [trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1, 1, 1)).apply_translation((3, 0, 0))]
    triangles = np.concatenate(
        [boxes[0].triangles, boxes[1].triangles[:, ::-1], [[[0, 0, 5], [1, 0, 5], [0, 1, 5.0]]]]
    )
    found = find_bodies(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    assert sorted(found.closed.tolist()) == [False, True, True]
    for number in np.flatnonzero(found.oriented):
        part = trimesh.Trimesh(found.vertices, found.faces[found.body == number], process=False)
        assert part.volume == pytest.approx(1.0)
    # One triangle turned: closed still, but which side is out is unknown.
    triangles[0] = triangles[0, ::-1]
    found = find_bodies(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    assert found.closed.sum() == 2 and found.oriented.sum() == 1


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "glb"])
def test_a_mesh_is_the_same_from_any_format(tmp_path, suffix):
    """A chair in millimetres away from its origin: placed by the middle of its lowest level, with z upwards."""
    mesh = Chair().mesh()
    shifted = mesh.copy()
    shifted.vertices = (mesh.vertices + np.array([5.0, -3.0, 0.4])) * 1000
    if suffix == "glb":
        shifted.vertices = shifted.vertices[:, [0, 2, 1]] * (1, 1, -1)
    shifted.export(tmp_path / f"chair.{suffix}")
    made = furnishing_from_file(
        tmp_path / f"chair.{suffix}", at=(1.0, 2.0), yaw_rad=0.5, z_m=0.1, unit_m=0.001
    )
    exact = make_piece("chair", at=(1.0, 2.0), yaw_rad=0.5, z_m=0.1)
    assert made.bodies.oriented.all()
    np.testing.assert_allclose(made.bodies.vertices.min(axis=0), exact.bodies.vertices.min(axis=0), atol=2e-6)
    np.testing.assert_allclose(made.bodies.vertices.max(axis=0), exact.bodies.vertices.max(axis=0), atol=2e-6)
    part = trimesh.Trimesh(made.bodies.vertices, made.bodies.faces, process=False)
    assert part.volume == pytest.approx(mesh.volume, rel=1e-4)


def test_plans_carry_what_is_placed_through_files(tmp_path):
    """A piece, a file and a mesh from memory come back at their places; meshes from memory bit for bit."""
    trimesh.creation.cone(0.2, 0.5).export(tmp_path / "cone.stl")
    things = (
        make_piece("table", at=(1.0, 1.5), yaw_rad=0.25, width_m=1.25, material="plywood"),
        furnishing_from_file(tmp_path / "cone.stl", at=(3.0, 1.0), name="a cone"),
        Furnishing(mesh=trimesh.creation.icosphere(radius=1 / 3), at=(2.0, 0.5), z_m=0.5, name="sphere"),
    )
    plan = room(furnishings=things)
    write_ros(plan, tmp_path / "room.yaml")
    again = read_plan(tmp_path / "room.yaml")
    assert [one.name for one in again.furnishings] == ["table", "a cone", "sphere"]
    for one, other in zip(things, again.furnishings, strict=True):
        assert (one.material, one.colour, one.z_m, one.at) == (
            other.material,
            other.colour,
            other.z_m,
            other.at,
        )
        np.testing.assert_allclose(other.triangles, one.triangles, atol=1e-12)
    np.testing.assert_array_equal(things[2].mesh.triangles, again.furnishings[2].mesh.triangles)
    assert plan.digest() != room().digest()
    assert read_plan(tmp_path / "room.yaml").digest() == again.digest()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("piece: table", "it holds no list"),
        ("- {piece: table}", "entry 1: 'at' is missing"),
        ("- {piece: tabel, at: [1, 1]}", "entry 1: piece is 'tabel'. Did you mean 'table'?"),
        ("- {piece: table, at: [1, 1]}\n- {at: [1, 1]}", "entry 2: expected one of piece and mesh"),
        ("- {piece: table, at: [1, 1], width: 2}", "a key is 'width'. Did you mean 'width_m'?"),
        ("- {piece: table, at: [1, 1], width_m: 0}", "width_m is 0, expected 0.05 to 20 m"),
        ("- {piece: table, at: [1, 1], width_m: wide}", "width_m is 'wide', expected a number"),
        ("- {piece: table, at: 1}", "at is 1, expected a list of 2 values"),
        ("- {piece: table, at: [.nan, 1]}", "at[0] is nan, expected a number"),
        ("- {piece: table, at: [1, 1], yaw_deg: 1.0e+9}", "yaw_rad of table is"),
        ("- {piece: table, at: [1, 1], colour: [1, 2]}", "colour is [1, 2], expected a list of 3 values"),
        ("- {piece: table, at: [1, 1], material: wod}", "material is 'wod'. Did you mean 'wood'?"),
        ("- {mesh: none.stl, at: [1, 1]}", "things.yaml: entry 1: "),
        ("- {mesh: none.stl, at: [1, 1]}", "none.stl: no such file, expected a mesh"),
        ("- {mesh: chair.stl, at: [1, 1], unit_m: 1.0e+4}", "chair.stl: not readable as a mesh (mesh of "),
        ("- {mesh: bad.stl, at: [1, 1]}", "bad.stl"),
        ("- {mesh: bad.stl, at: [1, 1], unit_m: 0}", "unit_m is 0, expected"),
        ("- {mesh: bad.stl, at: [1, 1], up: x}", "up is 'x'. Known: auto, y, z"),
        (
            "- {mesh: chair.stl, at: [1.0e+30, 1]}",
            "things.yaml: not readable as a list of what is placed in a ",
        ),
        (
            "- {mesh: chair.stl, at: [1.0e+30, 1]}",
            "(entry 1: x of chair is 1e+30, expected -1e+07 to 1e+07 m",
        ),
        ("- [1, 2]", "entry 1: a list, expected keys and values"),
    ],
)
def test_a_damaged_file_is_named_with_what_is_wrong(tmp_path, text, words):
    (tmp_path / "bad.stl").write_bytes(b"solid nothing\nendsolid\n")
    make_piece("chair", at=(0.0, 0.0)).mesh.export(tmp_path / "chair.stl")
    (tmp_path / "things.yaml").write_text(text)
    with pytest.raises(FileError) as rejected:
        read_furnishings(tmp_path / "things.yaml")
    assert words in str(rejected.value)
    assert ".yaml" in str(rejected.value) or ".stl" in str(rejected.value)
    assert "\n" not in str(rejected.value)


def test_writing_needs_no_folder(tmp_path):
    path = write_furnishings([make_piece("bed", at=(0.0, 0.0))], tmp_path / "new" / "things.yaml")
    assert read_furnishings(path)[0].said == {"piece": "bed"}
