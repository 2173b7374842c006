"""Storeys cut out of meshes: extruded plans come back, and odd meshes are seen through."""

import logging

import numpy as np
import pytest
import shapely
import trimesh

from robosim.building.building import BuildingConfig, make_building
from robosim.building.mesh_export import export_mesh
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan, MapError, ReadingOptions
from robosim.plans.formats.mesh_floors import find_floors
from robosim.plans.formats.mesh_slice import plan_from_triangles

#: '.' is free; one cell is 0.1 m. Two rooms with a door, a column, a wall one cell thick and a diagonal one.
PICTURE = """
##############################
#............................#
#............####............#
#............####............#
#............####............#
#.................#..........#
#..................#.........#
#...................#........#
#...................##########
#...................#........#
#...................#........#
#.......####........#........#
#.......####.................#
#.......####........#........#
#...................#........#
##############################
"""


def plan():
    free = np.array([[letter == "." for letter in row] for row in PICTURE.split()])[::-1]
    occupancy = np.where(free, FREE, OCCUPIED).astype(np.uint8)
    return FloorPlan(occupancy=occupancy, resolution_m=0.1, origin=(-1.7, 0.4, 0.0))


def solids(height_m=2.5, floor_m=0.0, roof=True):
    """The plan as closed solids: walls extruded by trimesh, standing on a slab and under another."""
    p = plan()
    corners = p.to_map(np.argwhere(~p.free)[:, ::-1].astype(float))
    walls = shapely.union_all(shapely.box(*corners.T, *(corners + p.resolution_m).T), grid_size=1e-6)
    parts = [trimesh.creation.extrude_polygon(part, height_m) for part in shapely.get_parts(walls)]
    (x0, y0), (x1, y1) = p.to_map(np.array([[0, 0], p.shape[::-1]], float))
    parts.append(trimesh.creation.box(bounds=[[x0, y0, -0.2], [x1, y1, 0.0]]))
    if roof:
        parts.append(trimesh.creation.box(bounds=[[x0, y0, height_m], [x1, y1, height_m + 0.2]]))
    mesh = trimesh.util.concatenate(parts)
    mesh.apply_translation([0, 0, floor_m])
    return mesh


def free_at(original, sliced):
    """Free cells of a sliced plan, at the centres of the original's cells."""
    cells = np.floor(sliced.to_cells(original.centres(np.ones(original.shape, bool)))).astype(int)
    inside = ((cells >= 0) & (cells < sliced.shape[::-1])).all(axis=1)
    free = np.zeros(len(cells), bool)
    free[inside] = sliced.free[cells[inside, 1], cells[inside, 0]]
    return free.reshape(original.shape)


def assert_same(sliced):
    np.testing.assert_array_equal(free_at(plan(), sliced), plan().free)
    assert sliced.free.sum() == plan().free.sum()


def as_gltf(mesh):
    turned = mesh.copy()
    turned.vertices = np.column_stack([mesh.vertices[:, 0], mesh.vertices[:, 2], -mesh.vertices[:, 1]])
    return turned


@pytest.mark.parametrize("suffix", ["glb", "gltf", "ply", "stl", "obj", "off"])
def test_extruded_plans_come_back_cell_by_cell(tmp_path, suffix):
    """Intersection over union is 1 in every format, though all walls lie on lines of the grid."""
    mesh = as_gltf(solids()) if suffix in ("glb", "gltf") else solids()
    if suffix == "gltf":
        for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh)).items():
            (tmp_path / name.replace("model.gltf", "plan.gltf")).write_bytes(content)
    else:
        mesh.export(tmp_path / f"plan.{suffix}")
    sliced = read_plan(tmp_path / f"plan.{suffix}", resolution_m=0.1)
    assert_same(sliced)
    assert sliced.name == "plan"


def test_own_buildings_come_back_cell_by_cell(tmp_path):
    """`make_building` gives sheets that face the rooms, and a floor under free cells only."""
    path = export_mesh(make_building(plan()), tmp_path / "building.glb")
    assert_same(read_plan(path, resolution_m=0.1))


def test_real_plans_come_back_cell_by_cell(shared, tmp_path):
    """A navigable area and a scanned house: 18 000 and 63 000 free cells, not one more or less."""
    for name in ("maps/ros/small_house.yaml", "maps/gibson/train/Colebrook.glb_topdownmap.out"):
        original = read_plan(shared / name)
        edges = FloorPlan(occupancy=original.occupancy, resolution_m=0.05, origin=original.origin)
        building = make_building(edges, config=BuildingConfig(tolerance_m=0))
        sliced = read_plan(export_mesh(building, tmp_path / "building.ply"))
        np.testing.assert_array_equal(free_at(original, sliced), original.free)


@pytest.mark.parametrize("turn", [0.2, 0.7])
def test_turned_buildings_lose_no_wall_and_less_than_a_cell(turn):
    """Walls at any angle: no free cell's centre lies in a wall, what is lost lies within a cell of one."""
    mesh = solids()
    matrix = trimesh.transformations.rotation_matrix(turn, [0, 0, 1])
    mesh.apply_transform(matrix)
    sliced = plan_from_triangles(np.array(mesh.triangles), ReadingOptions(resolution_m=0.05))
    c, s = np.cos(turn), np.sin(turn)

    def state(mask):
        cells = plan().to_cells(sliced.centres(mask) @ [[c, -s], [s, c]])
        return shapely.points(cells)

    iy, ix = np.nonzero(plan().free)
    free = shapely.union_all(shapely.box(ix, iy, ix + 1, iy + 1))
    shapely.prepare(free)
    assert shapely.contains(free, state(sliced.free)).all()
    lost = state(~sliced.free)
    lost = lost[shapely.contains(free, lost)]
    # In cells of the plan, twice as wide as those of the slice: half a diagonal is 0.36.
    assert shapely.distance(lost, free.boundary).max() < 0.5


def test_a_noisy_scan_with_holes_keeps_its_walls():
    """Triangles of 5 cm, 4 mm of noise, every tenth one missing: no path leads through any wall."""
    rng = np.random.default_rng(3)
    mesh = make_building(plan()).mesh
    vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, 0.05)
    vertices = vertices + rng.normal(0, 0.004, vertices.shape)
    triangles = vertices[faces][rng.random(len(faces)) > 0.1]
    sliced = plan_from_triangles(triangles, ReadingOptions(resolution_m=0.1))
    got = free_at(plan(), sliced)
    assert not (got & ~plan().free).any()
    assert (plan().free & ~got).sum() < 0.35 * plan().free.sum()


def two_storeys():
    upper = solids(floor_m=2.7)
    upper.apply_translation([0, 0, 0])
    lower = trimesh.creation.box(bounds=[[-1.7, 0.4, -0.2], [1.3, 2.0, 0.0]])
    walls = trimesh.creation.box(bounds=[[-0.3, 0.4, 0.0], [-0.2, 2.0, 2.5]])
    return trimesh.util.concatenate([upper, lower, walls])


def test_the_lowest_storey_is_taken_and_the_others_are_named(caplog):
    with caplog.at_level(logging.WARNING):
        sliced = plan_from_triangles(np.array(two_storeys().triangles), ReadingOptions(resolution_m=0.1))
    assert "0.00 m (5 m2), 2.70 m (5 m2)" in caplog.text
    assert sliced.free.sum() == 29 * 16


@pytest.mark.parametrize("height", [2.7, 2.3, 3.1])
def test_a_storey_is_chosen_by_about_its_height(tmp_path, caplog, height):
    two_storeys().export(tmp_path / "house.ply")
    with caplog.at_level(logging.WARNING):
        assert_same(read_plan(tmp_path / "house.ply", resolution_m=0.1, floor_height_m=height))
    assert not caplog.records


def test_heights_without_a_floor_are_said(tmp_path):
    two_storeys().export(tmp_path / "house.ply")
    with pytest.raises(MapError, match=r"house\.ply.*1\.35 m.*0\.00 m \(5 m2\), 2\.70 m"):
        read_plan(tmp_path / "house.ply", floor_height_m=1.35)


def test_a_storey_is_a_floor_with_walls_and_no_table():
    """A room of 4 m x 3 m: 12 m2 with 14 m of wall; the table top in it is no storey."""
    (storey,) = find_floors(room(table=0.75), 0.2, 1.5)
    assert storey.height_m == pytest.approx(0.0, abs=1e-9)
    assert storey.area_m2 == pytest.approx(12.0)
    assert storey.walls_m == pytest.approx(14.0)


def test_a_high_shelf_in_a_hall_is_no_storey():
    """A surface of 1 m2 at 2 m, with 3 m of the hall's walls above it: too small compared with the floor's 12 m2."""
    assert len(find_floors(room(table=2.0, height_m=5.0), 0.2, 1.5)) == 1


def test_a_roof_has_no_walls():
    storeys = find_floors(np.array(solids().triangles), 0.2, 1.5)
    assert [(round(s.height_m, 6), s.has_walls) for s in storeys] == [(0.0, True), (2.7, False)]


def room(table=None, height_m=2.5):
    """A room of 4 m x 3 m as five sheets that face inwards, without a ceiling; a table top at choice."""
    box = trimesh.creation.box(bounds=[[0, 0, 0], [4, 3, height_m]])
    triangles = box.triangles[box.face_normals[:, 2] < 0.5][:, ::-1]
    if table is not None:
        top = np.array(
            [[[1, 1, table], [2, 1, table], [2, 2, table]], [[1, 1, table], [2, 2, table], [1, 2, table]]]
        )
        triangles = np.concatenate([triangles, top])
    return triangles


@pytest.mark.parametrize(("table", "n_missing"), [(None, 0), (0.1, 0), (0.75, 100), (1.6, 0)])
def test_only_what_stands_in_the_slice_counts(table, n_missing):
    """A rug at 0.1 m and a shelf at 1.6 m leave the floor free; a table top of 1 m2 at 0.75 m does not."""
    sliced = plan_from_triangles(room(table), ReadingOptions(resolution_m=0.1))
    assert sliced.free.sum() == 40 * 30 - n_missing


def test_the_slice_can_be_chosen():
    assert (
        plan_from_triangles(room(1.6), ReadingOptions(resolution_m=0.1, slice_m=(0.3, 1.7))).free.sum()
        == 40 * 30 - 100
    )


def test_meshes_inside_out_are_turned(caplog):
    with caplog.at_level(logging.WARNING):
        assert plan_from_triangles(room()[:, ::-1], ReadingOptions(resolution_m=0.1)).free.sum() == 40 * 30
    assert "inside out" in caplog.text


def test_rooms_under_single_sheets_stay(tmp_path):
    """A room whose roof is a sheet that faces up, and walls that face out: a shell, not a solid."""
    shell = trimesh.creation.box(bounds=[[0, 0, 0], [4, 3, 2.5]])
    triangles = np.array(shell.triangles)
    floor = shell.face_normals[:, 2] < -0.5
    triangles[floor] = triangles[floor][:, ::-1]
    assert plan_from_triangles(triangles, ReadingOptions(resolution_m=0.1)).free.sum() > 37 * 27


def box(low, high, inwards=False):
    made = trimesh.creation.box(bounds=[low, high])
    if inwards:
        made.invert()
    return np.array(made.triangles)


@pytest.mark.parametrize("room_inwards", [True, False])
@pytest.mark.parametrize("faces", ["out", "in", "both"])
def test_the_inside_of_a_closed_cupboard_is_not_free(room_inwards, faces):
    """2 m tall: neither top nor bottom is in the slice; whichever direction faces of room and cupboard point."""
    cupboard = box((1, 1, 0), (2, 2, 2), inwards=faces == "in")
    if faces == "both":
        cupboard = np.concatenate([cupboard, cupboard[:, ::-1]])
    whole = np.concatenate([box((0, 0, 0), (4, 3, 2.5), room_inwards), cupboard])
    sliced = plan_from_triangles(whole, ReadingOptions(resolution_m=0.1))
    assert 1000 <= sliced.free.sum() <= 1100
    cells = sliced.to_cells(np.mgrid[1.15:1.9:0.1, 1.15:1.9:0.1].reshape(2, -1).T)
    inside = np.floor(cells).astype(int)
    assert not sliced.free[inside[:, 1], inside[:, 0]].any()


@pytest.mark.parametrize("inwards", [(0, 1, 2, 3, 4), (0, 1)])
def test_walls_on_an_inverted_slab_stay_solid(inwards):
    """Four walls 0.3 m thick on a slab, all inside out, as after mirroring the axes; or the slab and a wall."""
    sizes = [((0, 0, -0.1), (6, 4, 0)), ((0, 0, 0), (6, 0.3, 2.5)), ((0, 3.7, 0), (6, 4, 2.5))]
    sizes += [((0, 0.3, 0), (0.3, 3.7, 2.5)), ((5.7, 0.3, 0), (6, 3.7, 2.5))]
    house = [box(low, high, number in inwards) for number, (low, high) in enumerate(sizes)]
    sliced = plan_from_triangles(np.concatenate(house), ReadingOptions(resolution_m=0.1))
    assert sliced.free.sum() == 54 * 34


def test_rooms_that_are_closed_surfaces_stay():
    """Two rooms as shells of their own, also next to open ground; a cupboard in the smaller one; a room in a room."""
    rooms = [box((0, 0, 0), (4, 3, 2.5), True), box((4.2, 0, 0), (7, 3, 2.5), True)]
    both = plan_from_triangles(np.concatenate(rooms), ReadingOptions(resolution_m=0.1)).free.sum()
    assert both > 38 * 28 + 26 * 28
    cupboard = box((5, 1, 0), (6, 2, 2))
    less = plan_from_triangles(
        np.concatenate([*rooms, cupboard]), ReadingOptions(resolution_m=0.1)
    ).free.sum()
    assert 100 <= both - less <= 144
    hollow = [box((1, 1, 0), (3, 2.5, 2.4)), box((1.1, 1.1, 0), (2.9, 2.4, 2.3), True)]
    with_pod = plan_from_triangles(np.concatenate([rooms[0], *hollow]), ReadingOptions(resolution_m=0.1))
    assert with_pod.free.sum() > 39 * 29 - 21 * 16 + 16 * 11
    ground = [[(-9, -9, 0), (9, -9, 0), (9, 9, 0)], [(-9, -9, 0), (9, 9, 0), (-9, 9, 0)]]
    outside = plan_from_triangles(np.concatenate([rooms[0], ground]), ReadingOptions(resolution_m=0.1))
    x, y = np.floor(outside.to_cells(np.array([[2.0, 1.5]]))[0]).astype(int)
    assert outside.free[y, x]


def test_small_holes_in_the_floor_are_closed_but_not_stairwells():
    """A hole of 0.2 m x 0.2 m in a scan is free; one of 1 m x 1 m is not."""
    walls = room()
    walls = walls[walls[:, :, 2].max(axis=1) > 0]
    assert len(walls) == 8
    for size, n_missing in ((0.2, 0), (1.0, 100)):
        a, b = 1.0, 1.0 + size
        strips = [((0, 0), (4, a)), ((0, b), (4, 3)), ((0, a), (a, b)), ((b, a), (4, b))]
        corners = [[(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0)] for (x0, y0), (x1, y1) in strips]
        floor = np.array([[c[i] for i in face] for c in corners for face in ((0, 1, 2), (0, 2, 3))], float)
        sliced = plan_from_triangles(np.concatenate([walls, floor]), ReadingOptions(resolution_m=0.1))
        assert sliced.free.sum() == 40 * 30 - n_missing


def test_the_up_axis_follows_the_format_the_option_and_the_larger_floor(tmp_path, caplog):
    """GLB is y-up, others z-up; a file that breaks the custom is found out by its floor, and that is said."""
    solids().export(tmp_path / "z.glb")
    as_gltf(solids()).export(tmp_path / "y.obj")
    for name, up in (("z.glb", "z"), ("y.obj", "y")):
        assert_same(read_plan(tmp_path / name, resolution_m=0.1, up=up))
    with caplog.at_level(logging.WARNING):
        big = trimesh.creation.box(bounds=[[0, 0, 0], [10, 8, 2.5]])
        big.faces = big.faces[:, ::-1]
        big.export(tmp_path / "big.glb")
        assert read_plan(tmp_path / "big.glb", resolution_m=0.1).free.sum() == 100 * 80
    assert "the z axis is taken to point up" in caplog.text


def test_names_in_other_encodings_do_not_matter(tmp_path):
    """OBJ files of older programs carry Latin-1 comments and names."""
    text = solids().export(file_type="obj")
    (tmp_path / "house.obj").write_bytes("# Küche\ng Küche\n".encode("latin-1") + text.encode())
    assert_same(read_plan(tmp_path / "house.obj", resolution_m=0.1))


PLY = "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ("", "empty"),
        (
            PLY.format(3) + "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
            "0 0 nan\n1 0 0\n0 1 0\n3 0 1 2\n",
            "not finite",
        ),
        (
            PLY.format(3) + "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
            "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n",
            "mesh",
        ),
        (PLY.format(1) + "end_header\n0 0 0\n", "no triangles in space"),
        ("garbage", "mesh"),
    ],
)
def test_bad_meshes_are_said(tmp_path, content, word):
    path = tmp_path / "bad.ply"
    path.write_text(content)
    with pytest.raises(MapError, match=path.name) as error:
        read_plan(path)
    assert word in str(error.value)


def test_millimetres_are_suspected(tmp_path):
    mesh = solids()
    mesh.apply_scale(1e6)
    mesh.export(tmp_path / "mm.ply")
    with pytest.raises(MapError, match=r"mm\.ply.*metres"):
        read_plan(tmp_path / "mm.ply")


@pytest.mark.parametrize("unit_m", [0.001, 0.0254])
def test_other_units_of_length_are_reported(tmp_path, unit_m):
    """Millimetres and inches, the floor of the storey still given in metres."""
    mesh = solids(floor_m=3.0)
    mesh.apply_scale(1 / unit_m)
    mesh.export(tmp_path / "house.stl")
    assert_same(read_plan(tmp_path / "house.stl", resolution_m=0.1, unit_m=unit_m, floor_height_m=3.0))
    with pytest.raises(ValueError, match="unit_m is -1"):
        read_plan(tmp_path / "house.stl", unit_m=-1.0)


def test_a_lone_wall_has_no_floor(tmp_path):
    wall = trimesh.Trimesh([[0, 0, 0], [4, 0, 0], [4, 0, 2.5], [0, 0, 2.5]], [[0, 1, 2], [0, 2, 3]])
    wall.export(tmp_path / "wall.ply")
    with pytest.raises(MapError, match=r"wall\.ply.*no floor.*pass up='y'"):
        read_plan(tmp_path / "wall.ply", up="z")


@pytest.mark.parametrize("slice_m", [(0.0, 1.0), (1.0, 0.5), (0.2, float("inf")), (0.2, float("nan"))])
def test_senseless_slices_are_rejected(slice_m):
    with pytest.raises(ValueError, match="slice_m"):
        plan_from_triangles(room(), ReadingOptions(slice_m=slice_m))
