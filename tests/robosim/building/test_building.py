"""Buildings from plans: closed shells of the right volume, whose faces know what they are."""

import numpy as np
import pytest
import shapely
import trimesh
from scipy.ndimage import gaussian_filter

from robosim.building.building import KINDS, BuildingConfig, make_building
from tests.outlines import wall_lines
from tests.plans import plan_from, plan_of

CELL_M = 0.05
WALL_LINES = ["cell_edge", "cell_centre"]


def noise(seed, wall_line):
    """Ragged blobs of free cells with every awkward touching there is, on a turned plan."""
    rng = np.random.default_rng(seed)
    shape = rng.integers(3, 36, 2)
    free = gaussian_filter(rng.standard_normal(shape), rng.choice([0.0, 0.7, 1.5])) > rng.uniform(-0.3, 0.1)
    free[:3, :3] = True
    return plan_from(free, wall_line, CELL_M, (*rng.uniform(-20, 20, 2), rng.uniform(-np.pi, np.pi)))


def area(building, kind):
    return building.submesh(kind).area


def wall_length(plan, tolerance_m=0.0):
    return sum(shapely.LineString(line).length for line in wall_lines(plan, tolerance_m))


@pytest.mark.parametrize("tolerance_m", [0.0, 0.05])
@pytest.mark.parametrize("wall_line", WALL_LINES)
@pytest.mark.parametrize("seed", range(15))
def test_shell_is_watertight_with_the_volume_of_its_rooms(seed, wall_line, tolerance_m):
    """Each edge has two faces that agree on their side; volume = area x height, floor = ceiling = area.

    Normals point into free space, so the signed volume is negative. Walls have the area of the wall lines,
    both sides of passages without width included. To 1e-9 relative, even where rings touch at points.
    """
    plan = noise(seed, wall_line)
    building = make_building(plan, config=BuildingConfig(height_m=2.0, tolerance_m=tolerance_m))
    free_m2 = building.free.area
    assert building.mesh.is_watertight and building.mesh.is_winding_consistent
    assert building.mesh.volume == pytest.approx(-2.0 * free_m2, rel=1e-9)
    assert [area(building, "floor"), area(building, "ceiling")] == pytest.approx([free_m2, free_m2], rel=1e-9)
    walls = wall_length(plan, tolerance_m)
    assert area(building, "wall") + area(building, "furniture") == pytest.approx(2.0 * walls, rel=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_normals_point_into_free_space(seed):
    """A tenth of a millimetre before each wall is free, behind it is not; floor up, ceiling down."""
    building = make_building(noise(seed, "cell_edge"))
    walls = building.submesh("wall", "furniture")
    for step, inside in ((1e-4, True), (-1e-4, False)):
        xy = (walls.triangles_center + step * walls.face_normals)[:, :2]
        assert (shapely.contains_xy(building.free, xy) == inside).all()
    assert np.allclose(building.submesh("floor").face_normals, [0, 0, 1])
    assert np.allclose(building.submesh("ceiling").face_normals, [0, 0, -1])


def test_no_ray_leaves_the_building():
    """40 000 Embree rays from free floor to all sides end on a face inside of the bounds: no seams."""
    rng = np.random.default_rng(3)
    plan = noise(4, "cell_edge")
    building = make_building(plan)
    centres = plan.centres(plan.free)
    centres = centres[shapely.contains_xy(building.free, centres)]
    xy = centres[rng.integers(len(centres), size=40_000)]
    starts = np.column_stack([xy, np.full(len(xy), 1.0)])
    rays = rng.standard_normal((len(xy), 3))
    hit = building.mesh.ray.intersects_any(starts, rays / np.linalg.norm(rays, axis=1, keepdims=True))
    assert hit.all()


def test_vertices_are_corners_of_walls_only():
    """A room of 3 x 2 cells: 8 vertices, 12 triangles, whatever the cells."""
    building = make_building(plan_from(np.ones((2, 3), bool), resolution_m=CELL_M))
    assert len(building.mesh.vertices) == 8 and len(building.mesh.faces) == 12


@pytest.mark.parametrize("wall_line", WALL_LINES)
def test_walls_stand_on_the_free_polygons_to_the_last_bit(wall_line):
    """Floor vertices are the vertices of `free`, with no rounding between: what collides is what is seen."""
    building = make_building(noise(7, wall_line), config=BuildingConfig(tolerance_m=0.05))
    on_floor = {tuple(xy) for xy in building.submesh("floor").vertices[:, :2]}
    assert on_floor == {tuple(xy) for xy in shapely.get_coordinates(building.free)}


def test_building_stands_where_the_plan_is():
    """Turned by yaw and moved: the bounds of a 2 x 1 m2 room at (1, 2) turned by 90 degrees."""
    plan = plan_from(np.ones((1, 2), bool), resolution_m=1.0, origin=(1.0, 2.0, np.pi / 2))
    assert make_building(plan).bounds == pytest.approx(np.array([[0.0, 2.0, 0.0], [1.0, 4.0, 2.5]]))


def test_two_sides_of_a_touching_point_have_their_own_vertices():
    """Two cells that touch by a corner: a manifold of two boxes, 8 vertices each, touching along one line."""
    mesh = make_building(plan_of(["#.", ".#"])).mesh
    assert mesh.is_watertight and len(mesh.vertices) == 16
    merged = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    assert len(merged.vertices) == 14


def test_passage_without_width_keeps_both_walls():
    """Rooms 1 m apart: the passage stands as walls with a face on either side, 1 m x 2.5 m each."""
    plan = plan_of(["...##...", "........", "...##..."], "cell_centre")
    building = make_building(plan)
    assert building.mesh.is_watertight
    assert area(building, "wall") == pytest.approx(2.5 * wall_length(plan))
    middle = np.sort(
        building.walls_2d[np.isclose(building.walls_2d.mean(axis=1), (4.0, 1.5)).all(axis=1)], axis=1
    )
    assert np.allclose(middle, [[[3.5, 1.5], [4.5, 1.5]]] * 2)


def test_tolerance_drops_passages_without_width():
    """With a tolerance there are only the boundaries of free polygons."""
    plan = plan_of(["...##...", "........", "...##..."], "cell_centre")
    building = make_building(plan, config=BuildingConfig(tolerance_m=0.01))
    assert area(building, "wall") == pytest.approx(2.5 * building.free.length)


@pytest.mark.parametrize("seed", range(5))
def test_walls_from_above_enclose_free_space_on_their_left(seed):
    """The shoelace sum over all segments is the free area, and left of each one lies free floor."""
    building = make_building(noise(seed, "cell_edge"), config=BuildingConfig(furniture_height_m=1.0))
    start, end = building.walls_2d.transpose(1, 0, 2)
    cross = start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]
    assert cross.sum() / 2 == pytest.approx(building.free.area, rel=1e-9)
    left = np.column_stack([start[:, 1] - end[:, 1], end[:, 0] - start[:, 0]])
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    assert shapely.contains_xy(building.free, (start + end) / 2 + 1e-4 * left).all()


ROOMS = [
    "..............",
    ".#..####......",
    "....####..###.",
    "....####..#.#.",
    "..........###.",
    "..............",
]
"""Free-standing: a cell of 1 m2, a block of 12 m2, and a closet of 8 m2 around 1 m2 of free floor."""


def test_small_islands_are_furniture():
    """Of three islands one is at most 4 m2; a limit of 12 m2 takes the block, too, but never the closet."""
    for limit, perimeter in ((0.0, 0), (0.99, 0), (4.0, 4), (12.0, 4 + 14), (100.0, 4 + 14)):
        building = make_building(plan_of(ROOMS), config=BuildingConfig(furniture_max_m2=limit))
        assert area(building, "furniture") == pytest.approx(2.5 * perimeter)


def test_low_furniture_has_a_lid_and_the_shell_stays_closed():
    """One island of 1 m2, 0.8 m high: 4 x 0.8 + 1 m2 of furniture, and 1.7 m3 of air above it."""
    building = make_building(plan_of(ROOMS), config=BuildingConfig(furniture_height_m=0.8))
    assert building.mesh.is_watertight and building.mesh.is_winding_consistent
    assert area(building, "furniture") == pytest.approx(4 * 0.8 + 1)
    assert area(building, "ceiling") == pytest.approx(building.free.area + 1)
    assert building.mesh.volume == pytest.approx(-(2.5 * building.free.area + 1.7))
    points, _, faces = building.mesh.ray.intersects_location([[1.5, 4.5, 2.0]], [[0.0, 0.0, -1.0]], False)
    assert points[0][2] == pytest.approx(0.8) and KINDS[building.face_kind[faces[0]]] == "furniture"


@pytest.mark.parametrize("seed", range(10))
def test_low_furniture_in_noise_keeps_the_shell_closed(seed):
    """Islands that touch others by a corner stay high, others get lids: watertight in any case."""
    building = make_building(noise(seed, "cell_edge"), config=BuildingConfig(furniture_height_m=1.0))
    assert building.mesh.is_watertight and building.mesh.is_winding_consistent
    lids_m2 = area(building, "ceiling") - building.free.area
    assert lids_m2 >= -1e-9
    assert building.mesh.volume == pytest.approx(-(2.5 * building.free.area + 1.5 * lids_m2), rel=1e-9)


def test_low_furniture_that_touches_a_wall_by_a_corner_stays_high():
    """Under its lid both sides of that corner would be apart, above it one: it goes up to the ceiling."""
    plan = plan_of(["#....", ".#...", "....."])
    building = make_building(plan, config=BuildingConfig(furniture_height_m=1.0))
    assert building.mesh.is_watertight
    assert area(building, "furniture") == pytest.approx(4 * 2.5)


def test_building_without_ceiling_is_open():
    """No face above; everything else as before."""
    plan = plan_of(ROOMS)
    building = make_building(plan, config=BuildingConfig(ceiling=False))
    assert not (building.face_kind == KINDS.index("ceiling")).any()
    assert "ceiling_board" not in building.materials
    assert not building.mesh.is_watertight
    assert area(building, "wall") == pytest.approx(area(make_building(plan), "wall"))


def test_faces_have_the_material_of_their_kind():
    """Four names on four kinds; faces by material are the faces by kind."""
    names = {"wall": "brick", "floor": "floorboard", "ceiling": "wood", "furniture": "metal"}
    config = BuildingConfig(**{f"{kind}_material": name for kind, name in names.items()})
    building = make_building(plan_of(ROOMS), config=config)
    assert set(building.materials) == set(names.values())
    for kind, name in names.items():
        of_kind = building.face_kind == KINDS.index(kind)
        assert {building.materials[i] for i in building.face_material[of_kind]} == {name}
        assert building.of_material(name).area == pytest.approx(area(building, kind))


def test_default_materials_are_those_of_the_reference():
    """Walls and furniture share boards on studs: three materials for four kinds."""
    building = make_building(plan_of(ROOMS))
    assert set(building.materials) == {"partition", "concrete", "ceiling_board"}
    assert building.of_material("partition").area == pytest.approx(building.submesh("wall", "furniture").area)


def test_same_plan_same_building():
    """Bit for bit, which episodes rely on."""
    one, two = (make_building(noise(1, "cell_centre")) for _ in range(2))
    assert np.array_equal(one.mesh.vertices, two.mesh.vertices)
    assert np.array_equal(one.mesh.faces, two.mesh.faces)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"height_m": 0.0}, "height_m is 0.0"),
        ({"height_m": np.nan}, "height_m is nan"),
        ({"tolerance_m": -1.0}, "tolerance_m is -1.0"),
        ({"furniture_height_m": 2.5}, "furniture_height_m is 2.5"),
        ({"furniture_height_m": np.nan}, "furniture_height_m is nan"),
        ({"furniture_max_m2": np.nan}, "furniture_max_m2 is nan"),
        ({"wall_material": "drywal"}, "wall_material is 'drywal'.*Did you mean 'drywall'"),
    ],
)
def test_impossible_options_are_rejected(options, message):
    """The message names the option, its value and what would do."""
    with pytest.raises(ValueError, match=message):
        BuildingConfig(**options)


def test_unknown_parts_are_rejected():
    """Kinds and materials that a building has not are named with those it has."""
    building = make_building(plan_of(["..", ".."]))
    with pytest.raises(ValueError, match="kind is 'roof', expected one of wall"):
        building.submesh("roof")
    with pytest.raises(ValueError, match="material is 'metal', expected one of partition"):
        building.of_material("metal")


def test_real_plans_become_buildings(shared):
    """Every eighth published grid: watertight, right volume, walls as long as OpenCV's contours."""
    for path in sorted((shared / "maps" / "gibson").rglob("*.out"))[::8]:
        cells = np.loadtxt(path, delimiter=",", dtype=int)[::-1] > 0
        plan = plan_from(cells, "cell_centre", CELL_M)
        building = make_building(plan, config=BuildingConfig(furniture_height_m=0.8))
        assert building.mesh.is_watertight, path.name
        assert area(building, "floor") == pytest.approx(building.free.area)
        walls = np.linalg.norm(np.diff(building.walls_2d, axis=1), axis=-1).sum()
        assert walls == pytest.approx(wall_length(plan))
